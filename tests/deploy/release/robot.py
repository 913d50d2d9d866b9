# SPDX-License-Identifier: MIT
"""A robot that lies in a folder of this machine, and ways to reach it."""

import contextlib
import dataclasses
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from segway_ecc.deploy.release.agent.files import is_locked
from segway_ecc.deploy.release.agent.journal import Journal
from segway_ecc.deploy.release.agent.store import Store, differences
from segway_ecc.deploy.release.host import Event, Host
from tests.deploy.release.parts import SYSTEMCTL, make_bundle


@dataclass(frozen=True)
class Robot:
    """Where the robot's files lie on this machine."""

    folder: Path

    @property
    def root(self) -> Path:
        return self.folder / "opt"

    @property
    def config(self) -> Path:
        return self.folder / "etc"

    @property
    def store(self) -> Store:
        return Store(self.root)

    @property
    def journal(self) -> Journal:
        return Journal(self.root)

    def node_is(self, **properties: str) -> None:
        """What systemd shows of the node until it is restarted."""
        new = self.folder / "state" / "node.new"
        new.write_text("".join(f"{k}={v}\n" for k, v in properties.items()))
        new.replace(self.folder / "state" / "node")  # whole at any moment: a trial may be looking at it

    def calls(self) -> list[str]:
        return (self.folder / "state" / "calls").read_text().splitlines()

    def check_works(self) -> None:
        """`current` leads to a complete release that is as it was pushed, and runs."""
        name = self.store.current()
        assert name is not None
        manifest = self.store.manifest(name)
        assert manifest is not None
        assert differences(self.store.folder(name), manifest.files) == []
        command = self.root / "current" / "venv" / "bin" / "segway-ecc"
        assert subprocess.check_output([command, "--version"], text=True).strip() == manifest.version

    def wait_until_settled(self) -> None:
        while is_locked(self.root):
            time.sleep(0.01)

    def push_request(self, version: str, **changes: Any) -> tuple[dict[str, Any], dict[str, Path]]:
        spec, files = make_bundle(self.folder, version, changes.pop("robot", None))
        request = {
            "verb": "push",
            "root": str(self.root),
            "config": str(self.config),
            "rules": {"trial_s": 0.1, "start_s": 0.3, "keep": 2},
            "again": False,
            "release": dataclasses.asdict(spec) | {"by": "tester"},
            **changes,
        }
        return request, dict(files)

    def push(
        self, host: Host, version: str, on_event: Callable[[Event], None] = lambda _: None, **changes: Any
    ) -> Event:
        request, files = self.push_request(version, **changes)
        return host.ask(request, on_event, files)

    def rollback(self, host: Host, to: str | None = None) -> Event:
        request, _ = self.push_request("1.0")
        return host.ask(request | {"verb": "rollback", "to": to, "by": "tester"}, lambda _: None)


def make_robot(folder: Path) -> Robot:
    for name in ("opt", "etc", "state", "bin"):
        (folder / name).mkdir(parents=True)
    script = folder / "bin" / "systemctl"
    script.write_text(SYSTEMCTL.replace("@STATE@", str(folder / "state")).replace("@ROOT@", str(folder / "opt")))
    script.chmod(0o755)
    (folder / "etc" / "robot.yaml").write_text("name: of the machine\n")
    robot = Robot(folder)
    robot.node_is(
        LoadState="loaded", ActiveState="inactive", SubState="dead", NRestarts="0", MainPID="0", StatusText=""
    )
    return robot


@dataclass(frozen=True)
class Sshd:
    """A running sshd and how to reach it."""

    config: Path
    pid: int

    def cut(self) -> None:
        """End every connection at once, as a pulled cable does: all of sshd but the one that listens."""
        connections = _sshd_children(self.pid)
        for connection in connections:  # of an ordinary user each has a process of its own below it
            connections += _sshd_children(connection)
        for connection in connections:
            with contextlib.suppress(ProcessLookupError):
                os.kill(connection, signal.SIGKILL)


def _sshd_children(pid: int) -> list[int]:
    children = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(child) for child in (children.read_text().split() if children.exists() else ()) if _is_sshd(child)]


def _is_sshd(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/comm").read_text().startswith("sshd")
    except OSError:  # it has ended meanwhile
        return False


class LocalHost(Host):
    """The robot's side as a process of this machine, which kills itself when a step begins."""

    def __init__(self, robot: Robot, kill_at: str = "", kill_after: int = 0) -> None:
        super().__init__("local")
        driver = Path(__file__).with_name("driver.py")
        path = f"PATH={robot.folder}/bin:/usr/bin:/bin"
        self._words = ["env", path, f"KILL_AT={kill_at}", f"KILL_AFTER={kill_after}", "python3", str(driver)]

    def command(self, *options: str) -> list[str]:
        return ["true"] if options else self._words
