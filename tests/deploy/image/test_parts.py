# SPDX-License-Identifier: MIT
"""The parts of the builder that take no image: recipe, manifest, disk, and the configuration folder."""

import json
import os
import struct
import subprocess
from pathlib import Path

import pytest

from segway_ecc.deploy.image import disk
from segway_ecc.deploy.image.recipe import (
    ImageError,
    Recipe,
    differences,
    files_of,
    read_manifest,
    recipe_of,
    run,
    write_manifest,
)

FILES = Path(__file__).parents[3] / "deploy" / "image" / "files"


def test_a_kernel_brings_its_package_unless_that_is_pinned() -> None:
    assert "linux-image-rt-amd64" in Recipe(kernel="rt").all_packages
    assert not any("linux" in name for name in Recipe(kernel="none").all_packages)
    pinned = Recipe(kernel="rt", packages=("linux-image-rt-amd64=6.1.1-1",))
    assert pinned.all_packages == ("linux-image-rt-amd64=6.1.1-1",)


@pytest.mark.parametrize("change", [{"suite": "trixie"}, {"mirror": "http://else"}, {"kernel": "none"}, {"epoch": 1}])
def test_what_changes_the_packages_changes_the_name_of_what_is_kept(change: dict[str, object]) -> None:
    assert Recipe(**change).base_digest != Recipe().base_digest  # type: ignore[arg-type]


def test_what_does_not_change_the_packages_does_not() -> None:
    assert Recipe(vcan=True, extras=()).base_digest == Recipe().base_digest


def a_tree(folder: Path) -> Path:
    (folder / "bin").mkdir(parents=True)
    (folder / "bin" / "tool").write_text("one", "ascii")
    (folder / "bin" / "link").symlink_to("tool")
    for path in (folder / "bin" / "tool", folder / "bin" / "link", folder / "bin"):
        os.utime(path, (1000, 1000), follow_symlinks=False)
    return folder


def a_manifest(folder: Path, root: Path, packages: dict[str, str]) -> Path:
    path = folder / "manifest.json"
    write_manifest(path, Recipe(extras=("ros",), vcan=True), packages, {"a.whl": "00"}, root)
    return path


def test_a_manifest_makes_the_same_recipe_with_each_version(tmp_path: Path) -> None:
    path = a_manifest(tmp_path, a_tree(tmp_path / "root"), {"zlib": "1.2-3", "bash": "5.2"})
    again = recipe_of(read_manifest(path))
    assert again.packages == ("bash=5.2", "zlib=1.2-3")
    assert (again.extras, again.vcan, again.epoch) == (("ros",), True, Recipe().epoch)


def test_the_same_tree_has_the_same_manifest_and_any_change_is_listed(tmp_path: Path) -> None:
    one = read_manifest(a_manifest(tmp_path, a_tree(tmp_path / "one"), {"bash": "5.2"}))
    other = read_manifest(a_manifest(tmp_path, a_tree(tmp_path / "other"), {"bash": "5.2"}))
    assert one == other
    assert differences(one, other) == []
    (tmp_path / "other" / "bin" / "tool").write_text("two", "ascii")
    os.utime(tmp_path / "other" / "bin" / "tool", (1000, 1000))
    changed = read_manifest(a_manifest(tmp_path, tmp_path / "other", {"bash": "5.3"}))
    assert changed["digest"] != one["digest"]
    assert [text.partition(":")[0] for text in differences(one, changed)] == [
        "package bash",
        "file bin/tool",
    ]


@pytest.mark.parametrize("change", ["mode", "time", "link"])
def test_mode_time_and_where_a_link_leads_are_part_of_it(change: str, tmp_path: Path) -> None:
    root = a_tree(tmp_path / "root")
    before = files_of(root)
    if change == "mode":
        (root / "bin" / "tool").chmod(0o755)
    elif change == "time":
        os.utime(root / "bin" / "tool", (1000, 1001))
    else:
        (root / "bin" / "link").unlink()
        (root / "bin" / "link").symlink_to("else")
        os.utime(root / "bin", (1000, 1000))
    after = files_of(root)
    assert [name for name in before if before[name] != after[name]] == ["bin/link" if change == "link" else "bin/tool"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"recipe": 1, "packages": {}}', '{"recipe": {"suite": "x"}}'])
def test_what_is_no_manifest_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "manifest.json"
    path.write_text(text, "ascii")
    with pytest.raises(ImageError, match="is no manifest of an image"):
        read_manifest(path)


def test_partitions_lie_where_the_partition_table_has_them(tmp_path: Path) -> None:
    parts = []
    for name, content in (("root", b"r" * 100), ("data", bytes(3 * disk.MIB + 1)), ("conf", b"\0" * disk.MIB + b"c")):
        parts.append(tmp_path / name)
        parts[-1].write_bytes(content)
    disk.disk(tmp_path / "disk", parts)
    made = (tmp_path / "disk").read_bytes()
    assert made[510:512] == b"\x55\xaa"
    entries = [struct.unpack("<B3sB3sII", made[446 + 16 * n : 462 + 16 * n]) for n in range(4)]
    assert [entry[4:] for entry in entries] == [(2048, 2048), (4096, 8192), (12288, 4096), (0, 0)]
    assert [entry[2] for entry in entries] == [0x83, 0x83, 0x83, 0]
    assert made[disk.MIB :].startswith(b"r" * 100 + b"\0")
    assert made[6 * disk.MIB : 8 * disk.MIB] == b"\0" * disk.MIB + b"c" + bytes(disk.MIB - 1)
    assert len(made) == 8 * disk.MIB


def test_a_copy_is_the_same_and_leaves_out_what_is_empty(tmp_path: Path) -> None:
    source = tmp_path / "source"
    source.write_bytes(b"x" + bytes(8 * disk.MIB) + b"y" + bytes(8 * disk.MIB))
    disk.copy_sparse(source, tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == source.read_bytes()
    assert (tmp_path / "copy").stat().st_blocks * 512 < source.stat().st_size // 2


def test_failed_program_raises_with_its_last_lines() -> None:
    with pytest.raises(ImageError, match=r"^sh failed with status 3: no room$"):
        run(["sh", "-c", "echo no room >&2; exit 3"])


def configure(folder: Path, root: Path) -> list[str]:
    words = ["sh", str(FILES / "segway-ecc-configure"), str(folder), str(root)]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    return [line.split()[1] for line in done.stdout.splitlines()]


def test_the_configuration_is_taken_over_once_and_again_where_it_changes(tmp_path: Path) -> None:
    folder, root = tmp_path / "config", tmp_path / "root"
    for name, text in {
        "hostname": "one",
        "robot.yaml": "name: x",
        "authorized_keys": "ssh-ed25519 A",
        "robot/model.py": "pass",
        "network/10-wifi.network": "[Match]",
        "README": "not this",
    }.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "ascii")
    assert configure(folder, root) == [
        "/etc/hostname",
        "/etc/segway-ecc/robot.yaml",
        "/etc/ssh/authorized_keys/root",
        "/etc/segway-ecc/model.py",
        "/etc/systemd/network/10-wifi.network",
    ]
    assert (root / "etc/ssh/authorized_keys/root").stat().st_mode & 0o777 == 0o600
    assert configure(folder, root) == []
    (folder / "robot.yaml").write_text("name: y", "ascii")
    assert configure(folder, root) == ["/etc/segway-ecc/robot.yaml"]
    assert (root / "etc/segway-ecc/robot.yaml").read_text("ascii") == "name: y"
    assert not list(root.rglob("*.new"))


def test_a_robot_file_that_was_pushed_stays_until_the_one_of_the_configuration_changes(tmp_path: Path) -> None:
    folder, etc = tmp_path / "config", tmp_path / "root" / "etc" / "segway-ecc"
    folder.mkdir()
    (folder / "robot.yaml").write_text("name: machine", "ascii")
    assert configure(folder, tmp_path / "root") == ["/etc/segway-ecc/robot.yaml"]
    (etc / "robot.yaml").rename(etc / "robot.yaml.before-deploy")
    (tmp_path / "pushed.yaml").write_text("name: pushed", "ascii")
    (etc / "robot.yaml").symlink_to(tmp_path / "pushed.yaml")
    assert configure(folder, tmp_path / "root") == []
    assert (etc / "robot.yaml").read_text("ascii") == "name: pushed"
    (folder / "robot.yaml").write_text("name: edited", "ascii")
    assert configure(folder, tmp_path / "root") == ["/etc/segway-ecc/robot.yaml"]
    assert (etc / "robot.yaml").read_text("ascii") == "name: edited"
    assert (tmp_path / "pushed.yaml").read_text("ascii") == "name: pushed"


def test_an_empty_configuration_changes_nothing(tmp_path: Path) -> None:
    (tmp_path / "config").mkdir()
    assert configure(tmp_path / "config", tmp_path / "root") == []
    assert not (tmp_path / "root").exists()


def test_a_manifest_is_json_that_others_can_read(tmp_path: Path) -> None:
    path = a_manifest(tmp_path, a_tree(tmp_path / "root"), {"bash": "5.2"})
    assert set(json.loads(path.read_text("utf-8"))) == {"recipe", "packages", "wheels", "digest", "files"}


def test_a_copy_of_nothing_is_as_long(tmp_path: Path) -> None:
    (tmp_path / "source").touch()
    os.truncate(tmp_path / "source", 3 * disk.MIB + 5)
    disk.copy_sparse(tmp_path / "source", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == bytes(3 * disk.MIB + 5)
