# SPDX-License-Identifier: MIT
"""The shell scripts: clean by shellcheck, and parse.sh refuses in one line what it cannot do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

MACHINES = ["qemux86-64", "raspberrypi4-64"]


def _tools(folder: Path, **scripts: str) -> Path:
    """A PATH with nothing on it but what parse.sh uses and these stand-ins."""
    folder.mkdir()
    for name in ("sh", "dirname", "mkdir", "grep"):
        (folder / name).symlink_to(f"/bin/{name}" if Path(f"/bin/{name}").exists() else f"/usr/bin/{name}")
    for name, body in scripts.items():
        (folder / name).write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
        (folder / name).chmod(0o755)
    return folder


def _parse(notes: Path, path: Path, work: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PATH": str(path), "KAS_WORK_DIR": str(work)}
    return subprocess.run([notes / "parse.sh", *words], env=environment, capture_output=True, text=True, check=False)


def test_shellcheck_finds_nothing(notes: Path, layer: Path) -> None:
    scripts = [*notes.glob("*.sh"), *layer.rglob("*.sh.in"), *layer.glob("recipes-*/*/files/segway-ecc-data")]
    assert len(scripts) == 3

    done = subprocess.run(
        [Path(sys.executable).parent / "shellcheck", *scripts], capture_output=True, text=True, check=False
    )

    assert (done.returncode, done.stdout) == (0, "")


def test_root_is_refused(notes: Path, tmp_path: Path) -> None:
    done = _parse(notes, _tools(tmp_path / "bin", id="echo 0"), tmp_path / "work")

    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "parse.sh: bitbake refuses to run as root: run this as an ordinary user\n"


def test_without_kas_it_is_refused(notes: Path, tmp_path: Path) -> None:
    done = _parse(notes, _tools(tmp_path / "bin", id="echo 1000"), tmp_path / "work")

    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "kas is missing" in done.stderr


def test_without_the_locale_it_is_refused(notes: Path, tmp_path: Path) -> None:
    tools = _tools(tmp_path / "bin", id="echo 1000", kas="echo fetched", locale="echo C.utf8")

    done = _parse(notes, tools, tmp_path / "work")

    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "en_US.UTF-8" in done.stderr


def test_without_a_key_it_is_refused(notes: Path, tmp_path: Path) -> None:
    tools = _tools(tmp_path / "bin", id="echo 1000", kas="echo fetched", locale="echo en_US.utf8")

    done = _parse(notes, tools, tmp_path / "work")

    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert str(tmp_path / "work" / "authorized_keys") in done.stderr


def test_another_machine_is_refused(notes: Path, tmp_path: Path) -> None:
    done = _parse(notes, _tools(tmp_path / "bin", id="echo 1000"), tmp_path / "work", "toaster")

    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "toaster" in done.stderr


@pytest.mark.parametrize("machine", MACHINES)
def test_with_all_there_bitbake_parses_and_resolves(notes: Path, tmp_path: Path, machine: str) -> None:
    tools = _tools(tmp_path / "bin", id="echo 1000", kas='printf "%s\\n" "$@"', locale="echo en_US.utf8")
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "authorized_keys").touch()

    done = _parse(notes, tools, tmp_path / "work", machine)

    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[:4] == [
        "shell",
        str(notes / "kas" / f"segway-ecc-{machine}.yml"),
        "--command",
        "bitbake -p && bitbake -g segway-ecc-image",
    ]


def test_what_bitbake_refuses_is_refused(notes: Path, tmp_path: Path) -> None:
    tools = _tools(tmp_path / "bin", id="echo 1000", kas="exit 1", locale="echo en_US.utf8")
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "authorized_keys").touch()

    done = _parse(notes, tools, tmp_path / "work")

    assert (done.returncode, done.stdout) == (1, "")


def _bind(layer: Path, folder: Path, mounted: str) -> tuple[int, list[str]]:
    """The script's exit status and the commands it gave, with nothing really mounted."""
    calls = folder / "calls"
    calls.touch()
    note = f'echo "${{0##*/}} $*" >> {calls}'
    tools = _tools(
        folder / "bin", install=note, mount=note, mountpoint=f'case "$2" in {mounted}) exit 0;; esac; exit 1'
    )
    (tools / "mkdir").unlink()
    (tools / "mkdir").write_text(f"#!/bin/sh\n{note}\n", encoding="utf-8")
    (tools / "mkdir").chmod(0o755)
    script = layer / "recipes-robot" / "segway-ecc-data" / "files" / "segway-ecc-data"

    done = subprocess.run([script, "/data"], env={"PATH": str(tools)}, capture_output=True, text=True, check=False)

    return done.returncode, calls.read_text(encoding="utf-8").splitlines()


def test_state_and_logs_are_bound_to_the_data_partition(layer: Path, tmp_path: Path) -> None:
    assert _bind(layer, tmp_path, "/data") == (
        0,
        [
            "install -d -o segway -g segway -m 0750 /data/segway-ecc/state",
            "mkdir -p /var/lib/segway-ecc",
            "mount --bind /data/segway-ecc/state /var/lib/segway-ecc",
            "install -d -o segway -g segway -m 0750 /data/segway-ecc/logs",
            "mkdir -p /var/log/segway-ecc",
            "mount --bind /data/segway-ecc/logs /var/log/segway-ecc",
        ],
    )


def test_what_is_bound_already_is_not_bound_again(layer: Path, tmp_path: Path) -> None:
    status, calls = _bind(layer, tmp_path, "/data|/var/lib/segway-ecc|/var/log/segway-ecc")

    assert status == 0
    assert not [call for call in calls if call.startswith("mount ")]


def test_without_a_data_partition_nothing_is_bound(layer: Path, tmp_path: Path) -> None:
    assert _bind(layer, tmp_path, "/elsewhere") == (1, [])
