# SPDX-License-Identifier: MIT
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.station.installer.machine import Owner, TargetMachine, acting_as
from segway_ecc.node.errors import ConfigurationError, NodeError
from tests.deploy.station.installer.conftest import Fake


def test_a_file_is_written_whole_for_everybody_to_read_and_only_where_it_differs(tmp_path: Path) -> None:
    machine = TargetMachine(tmp_path, is_live=False)
    old = os.umask(0o077)
    try:
        assert machine.write("/etc/a/b", "one\n")
    finally:
        os.umask(old)
    path = tmp_path / "etc/a/b"
    assert (path.read_text(), stat.S_IMODE(path.stat().st_mode)) == ("one\n", 0o644)
    number = path.stat().st_ino
    assert not machine.write("/etc/a/b", "one\n")
    assert path.stat().st_ino == number
    assert machine.write("/etc/a/b", "two\n")
    assert path.stat().st_ino != number  # a new file in the place of the old one
    path.chmod(0o666)
    assert machine.write("/etc/a/b", "two\n")
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert [entry.name for entry in path.parent.iterdir()] == ["b"]


def test_a_link_in_the_place_of_a_file_is_replaced_and_not_followed(tmp_path: Path) -> None:
    (tmp_path / "target").write_text("text")
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/x").symlink_to(tmp_path / "target")
    assert TargetMachine(tmp_path, is_live=False).write("/etc/x", "text")
    assert not (tmp_path / "etc/x").is_symlink()
    assert (tmp_path / "target").read_text() == "text"


def test_a_link_does_not_lead_out_of_a_root_file_system(tmp_path: Path) -> None:
    (tmp_path / "root").mkdir()
    (tmp_path / "root/etc").symlink_to(tmp_path)
    with pytest.raises(ConfigurationError, match="leads out of"):
        TargetMachine(tmp_path / "root", is_live=False).write("/etc/x", "text")
    assert not (tmp_path / "x").exists()


def test_unwritable_or_undeletable_file_raises(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    machine = TargetMachine(tmp_path, is_live=False)
    with pytest.raises(NodeError, match="cannot be written: Not a directory"):
        machine.write("/file/x", "text")
    with pytest.raises(NodeError, match="cannot be deleted: Is a directory"):
        machine.delete("/folder")


def test_delete_returns_whether_file_existed(tmp_path: Path) -> None:
    machine = TargetMachine(tmp_path, is_live=False)
    machine.write("/etc/x", "")
    assert [machine.delete("/etc/x"), machine.delete("/etc/x"), machine.delete("/no/x")] == [True, False, False]


def test_the_user_is_that_of_the_machine_s_own_list(tmp_path: Path) -> None:
    machine = TargetMachine(tmp_path)
    assert machine.owner() is None
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/passwd").write_text("root:x:0:0:r:/root:/bin/sh\nsegwayfan:x:1:1:::\nsegway:x:998:997::/:/x\n")
    assert machine.owner() == (998, 997)


def test_failing_command_raises_last_line_and_missing_one_its_name(fake: Fake) -> None:
    fake.fail("systemctl daemon-reload")
    with pytest.raises(NodeError, match=r"^systemctl daemon-reload: no such luck$"):
        fake.machine.run(["systemctl", "daemon-reload"])
    fake.machine.run(["systemctl", "start", "x"])
    with pytest.raises(NodeError, match="no-such-command is not installed here"):
        fake.machine.run(["no-such-command"])


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that any user gets to, unlike pytest's own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        yield folder


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become somebody else")
def test_acting_as_a_user_makes_their_files_and_reads_no_others(open_folder: Path) -> None:
    (open_folder / "secret").write_text("root's")
    (open_folder / "secret").chmod(0o600)
    (open_folder / "theirs").mkdir()
    os.chown(open_folder / "theirs", 4242, 4243)
    before = os.getgroups()
    os.setgroups([4, 7])
    with acting_as(Owner(4242, 4243)):
        (open_folder / "theirs/x").write_text("")
        with pytest.raises(PermissionError):
            (open_folder / "secret").read_text()
        with pytest.raises(PermissionError):
            (open_folder / "y").write_text("")
        assert os.getgroups() == []
    made = (open_folder / "theirs/x").stat()
    assert (made.st_uid, made.st_gid) == (4242, 4243)
    assert (os.geteuid(), os.getegid(), os.getgroups()) == (0, 0, [4, 7])
    os.setgroups(before)
    assert (open_folder / "secret").read_text() == "root's"
