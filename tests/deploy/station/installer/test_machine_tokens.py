# SPDX-License-Identifier: MIT
import os
import stat
import tempfile
from pathlib import Path

import pytest

from segway_ecc.deploy.station.installer.machine import Owner, TargetMachine, delete_tokens, has_tokens, make_tokens
from segway_ecc.deploy.station.web.access import Role, load_access
from segway_ecc.node.errors import ConfigurationError, NodeError

ACCESS = "var/lib/segway-ecc/station/access.json"
ME = Owner(os.geteuid(), os.getegid())


@pytest.mark.parametrize("is_live", [True, False])
def test_tokens_are_made_once_and_only_their_hashes_are_kept(tmp_path: Path, *, is_live: bool) -> None:
    machine = TargetMachine(tmp_path, is_live=is_live)
    assert not has_tokens(machine)
    tokens = make_tokens(machine, ME, anew=False)
    path = tmp_path / ACCESS
    assert has_tokens(machine)
    assert set(tokens) == {Role.OPERATOR, Role.VIEWER}
    access = load_access(path)
    assert access is not None
    assert all(access.role(token) is role for role, token in tokens.items())
    assert not any(token in path.read_text() for token in tokens.values())
    modes = [stat.S_IMODE(each.stat().st_mode) for each in (path, path.parent, path.parent.parent)]
    assert modes == [0o600, 0o700, 0o750]
    kept = path.read_bytes()
    assert make_tokens(machine, ME, anew=False) == {}
    assert path.read_bytes() == kept
    assert set(make_tokens(machine, ME, anew=True).values()).isdisjoint(tokens.values())


def test_foreign_token_file_raises_and_is_replaced_on_request(tmp_path: Path) -> None:
    machine = TargetMachine(tmp_path)
    make_tokens(machine, ME, anew=False)
    (tmp_path / ACCESS).write_text("nonsense")
    with pytest.raises(ConfigurationError, match="--new-tokens"):
        make_tokens(machine, ME, anew=False)
    assert len(make_tokens(machine, ME, anew=True)) == 2


def test_uncreatable_folder_raises(tmp_path: Path) -> None:
    (tmp_path / "var").write_text("")
    with pytest.raises(NodeError, match="cannot be made ready: Not a directory"):
        make_tokens(TargetMachine(tmp_path), ME, anew=False)


def test_a_link_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "var/lib/segway-ecc").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir(mode=0o755)
    (tmp_path / "var/lib/segway-ecc/station").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigurationError, match="is a link"):
        make_tokens(TargetMachine(tmp_path), ME, anew=False)
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become somebody else")
@pytest.mark.parametrize("is_live", [True, False])
def test_root_makes_files_of_the_service_s_user(*, is_live: bool) -> None:
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        make_tokens(TargetMachine(Path(name), is_live=is_live), Owner(4242, 4243), anew=False)
        path = Path(name) / ACCESS
        owners = [(each.stat().st_uid, each.stat().st_gid) for each in (path, path.parent, path.parent.parent)]
        assert owners == [(4242, 4243)] * 3


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may become somebody else")
def test_root_is_not_led_by_the_service_s_user_to_files_of_its_own() -> None:
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        root.chmod(0o755)
        machine = TargetMachine(root)
        make_tokens(machine, Owner(4242, 4243), anew=False)
        (root / "secret").write_text("root's")
        (root / "secret").chmod(0o640)
        (root / ACCESS).unlink()
        (root / ACCESS).symlink_to(root / "secret")
        with pytest.raises(ConfigurationError, match="cannot be read: Permission denied"):
            make_tokens(machine, Owner(4242, 4243), anew=False)
        assert stat.S_IMODE((root / "secret").stat().st_mode) == 0o640
        make_tokens(machine, Owner(4242, 4243), anew=True)
        assert (root / "secret").read_text() == "root's"


def test_deleting_tokens_returns_whether_there_were_any(tmp_path: Path) -> None:
    machine = TargetMachine(tmp_path)
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/passwd").write_text(f"segway:x:{ME.uid}:{ME.gid}::/:/x\n")
    make_tokens(machine, ME, anew=False)
    assert [delete_tokens(machine), delete_tokens(machine)] == [True, False]
