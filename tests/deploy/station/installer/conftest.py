# SPDX-License-Identifier: MIT
"""A machine in a folder, whose commands write down that they were called."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from segway_ecc.deploy.station.installer.machine import TargetMachine
from segway_ecc.node.cli.main import main

COMMAND = "/opt/venv/bin/segway-ecc"

_FAKE = """#!/bin/sh
echo "$(basename "$0") $*" >> "{folder}/calls"
grep -qxF "$(basename "$0") $*" "{folder}/failing" 2> /dev/null && echo "no such luck" >&2 && exit 1
case "$(basename "$0") $*" in
    systemd-sysusers*) grep -q ^segway: {root}/etc/passwd || echo "{user}" >> {root}/etc/passwd ;;
    *is-active*) [ -e "{folder}/running" ] ;;
    *"restart segway-ecc-station"* | *" start segway-ecc-station"*) touch "{folder}/running" ;;
    *"disable --now segway-ecc-station"*) rm -f "{folder}/running" ;;
esac
"""


class Outcome(NamedTuple):
    """How a command went: exit code, standard output, and the lines of standard error."""

    code: int
    out: str
    errors: list[str]


class Fake:
    """A machine with systemd, and what was run on it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.root = folder / "root"
        for name in ("etc", "run/systemd/system", "var/lib", str(Path(COMMAND).parent)[1:]):
            (self.root / name).mkdir(parents=True)
        (self.root / "etc/passwd").write_text("root:x:0:0:root:/root:/bin/bash\n")
        (self.root / COMMAND[1:]).write_text("")
        self.machine = TargetMachine(self.root)
        self.bin = folder / "bin"
        self.bin.mkdir()
        self.fake("systemctl", "systemd-sysusers", "nft")

    def fake(self, *names: str) -> None:
        user = f"segway:x:{os.geteuid()}:{os.getegid()}::/:/usr/sbin/nologin"
        for name in names:
            (self.bin / name).write_text(_FAKE.format(folder=self._folder, root=self.root, user=user))
            (self.bin / name).chmod(0o755)

    def fail(self, call: str) -> None:
        (self._folder / "failing").write_text(call + "\n")

    def succeed(self) -> None:
        (self._folder / "failing").unlink()

    def calls(self) -> list[str]:
        """What was run since the last time."""
        path = self._folder / "calls"
        said = path.read_text().splitlines() if path.exists() else []
        path.unlink(missing_ok=True)
        return said

    def text(self, name: str) -> str:
        return (self.root / name.lstrip("/")).read_text()

    def files(self) -> dict[str, tuple[bytes, int]]:
        """Every file and link, with content and time of change."""
        found = (path for path in sorted(self.root.rglob("*")) if path.is_file() or path.is_symlink())
        return {str(path): (path.read_bytes() if path.is_file() else b"", path.lstat().st_mtime_ns) for path in found}


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fake:
    """A running machine whose environment is fit, and whose service is well as soon as it is started."""
    made = Fake(tmp_path)
    monkeypatch.setenv("PATH", f"{made.bin}:{os.environ['PATH']}")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr("segway_ecc.deploy.station.installer.install.check_environment", lambda _command: None)
    monkeypatch.setattr(
        "segway_ecc.deploy.station.installer.install.wait_until_healthy", lambda _settings, _timeout_ns: None
    )
    monkeypatch.setattr("segway_ecc.deploy.verbs.station_install._THIS", made.root)
    monkeypatch.setattr("segway_ecc.deploy.verbs.station_install._is_root", lambda: True)
    return made


@pytest.fixture
def base_station(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Called with the words after `segway-ecc station install`."""

    def call(*words: str) -> Outcome:
        capsys.readouterr()
        try:
            code = main(["station", "install", *words])
        except SystemExit as exited:  # how argparse ends a command
            code = exited.code if isinstance(exited.code, int) else 0
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err.splitlines())

    return call
