# SPDX-License-Identifier: MIT
"""A service manager of its own: systemd as the first process of its namespaces, at this machine's full speed.

It has our units as they are shipped, but for what a checkout lacks: a user `segway`, and the units of a whole system.
What it writes lies in memory; only the messages of the services are left.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.patience import PATIENCE_S

ROOT: Final = Path(__file__).parents[3]
MANAGER: Final = "/usr/lib/systemd/systemd"
NODE: Final = "segway-ecc-node.service"
_TARGET: Final = "[Unit]\nDefaultDependencies=no\nAllowIsolate=yes\n"
# The units of a whole system would set this machine up anew. What a checkout lies in, the sandbox may hide.
_DROP_IN: Final = """[Unit]
DefaultDependencies=no
[Service]
User=
SupplementaryGroups=
PrivateTmp=no
ProtectHome=no
StandardError=append:{messages}
"""
_BEGIN: Final = """set -eu
mount -t tmpfs tmpfs /run
mkdir -p /run/etc
cp -a /etc/. /run/etc/
rm -rf /run/etc/systemd/system /run/etc/systemd/system.conf.d
mkdir -p /run/etc/systemd/system /run/etc/segway-ecc
cp -a {folder}/units/. /run/etc/systemd/system/
cp {folder}/environment {robot} /run/etc/segway-ecc/
mount --bind /run/etc /etc
for place in /var/lib /var/log /var/cache /opt; do mount -t tmpfs tmpfs $place; done
mkdir -p /opt/segway-ecc/current
ln -s {environment} /opt/segway-ecc/current/venv
umount -R -l /sys/fs/cgroup
mount -t cgroup2 none /sys/fs/cgroup
exec env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 container=test {manager} --system --unit=test.target \\
    --log-target=null --show-status=no > {folder}/manager.txt 2>&1
"""


def lacking() -> str | None:
    """What is not here of what it takes; None where all is."""
    if os.geteuid() != 0:
        return "not root"
    if not Path(MANAGER).exists() or not all(map(shutil.which, ("unshare", "nsenter", "systemctl"))):
        return "no systemd, or no unshare or nsenter"
    groups = _control_groups()
    return None if groups is not None and os.access(groups, os.W_OK) else "no control groups (cgroup2) to write to"


def _control_groups() -> Path | None:
    """Where this machine has them."""
    for line in Path("/proc/mounts").read_text("ascii", "replace").splitlines():
        _, place, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(place)
    return None


class ServiceManager:
    """One that runs; `messages` is the file with what the services report."""

    def __init__(self, pid: int, messages: Path) -> None:
        """Know it by its process."""
        self.messages = messages
        self._enter = ["nsenter", f"--target={pid}", "--mount", "--pid", "--cgroup"]

    def systemctl(self, *words: str) -> str:
        """Call systemctl, and return what it prints."""
        command = [*self._enter, "systemctl", *words]
        return subprocess.run(command, check=True, capture_output=True, text=True, timeout=PATIENCE_S).stdout

    def property(self, name: str, unit: str = NODE) -> str:
        """A property of a unit."""
        return self.systemctl("show", "-P", name, unit).strip()

    def lines(self) -> list[str]:
        """What the services have reported so far."""
        return self.messages.read_text("utf-8", "replace").splitlines() if self.messages.exists() else []

    def wait_for(self, text: str) -> str:
        """Wait until a line has this in it, and return that."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for line in self.lines():
                if text in line:
                    return line
            time.sleep(0.05)
        raise AssertionError(f"no '{text}' in: {self.lines()}; {self.property('StatusText')}")


@contextlib.contextmanager
def service_manager(robot: str, options: str, folder: Path) -> Iterator[ServiceManager]:
    """One whose services are node and guard of a robot file, called with these options, on this machine's network."""
    messages, units = folder / "messages.txt", folder / "units"
    units.mkdir()
    for name in ("node", "guard"):
        unit = f"segway-ecc-{name}.service"
        shutil.copy(ROOT / "deploy" / "systemd" / unit, units)
        (units / f"{unit}.d").mkdir()
        (units / f"{unit}.d" / "test.conf").write_text(_DROP_IN.format(messages=messages), "utf-8")
    (units / "test.target").write_text(_TARGET, "utf-8")
    (folder / "environment").write_text(f"RUN_OPTIONS={options} --no-ros\nGUARD_OPTIONS={options}\n", "utf-8")
    (folder / "robot.yaml").write_text(robot, "utf-8")
    groups = _control_groups()
    assert groups is not None
    group = groups / f"segway-ecc-test-{os.getpid()}"
    group.mkdir()
    begin = _BEGIN.format(folder=folder, robot=folder / "robot.yaml", environment=sys.prefix, manager=MANAGER)
    enter = f"echo $$ > {group}/cgroup.procs && exec unshare --mount --pid --ipc --uts --cgroup --fork --kill-child"
    process = subprocess.Popen(["/bin/sh", "-c", f'{enter} --mount-proc sh -c "$0"', begin])
    try:
        manager = ServiceManager(_child(process.pid), messages)
        _wait_until_ready(manager, folder / "manager.txt")
        yield manager
    finally:
        process.kill()  # and with it, by --kill-child, the first process and all that it has started
        process.wait()
        _remove(group)


def _child(pid: int) -> int:
    """The one process that a process has started, once it has."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        found = Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()
        if found:
            return int(found[0])
        time.sleep(0.01)
    raise AssertionError("no namespaces were made")


def _wait_until_ready(manager: ServiceManager, log: Path) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        with contextlib.suppress(subprocess.CalledProcessError):
            manager.systemctl("show", "-P", "Version")
            return
        time.sleep(0.1)
    raise AssertionError(f"systemd does not answer: {log.read_text('utf-8', 'replace') if log.exists() else 'no log'}")


def _remove(group: Path) -> None:
    """Remove a control group and those in it, whose processes have ended or are about to."""
    deadline = time.monotonic() + PATIENCE_S
    while group.exists() and time.monotonic() < deadline:
        for place in sorted((path for path in group.rglob("*") if path.is_dir()), reverse=True):
            _kill_all(place)
            with contextlib.suppress(OSError):
                place.rmdir()
        _kill_all(group)
        with contextlib.suppress(OSError):
            group.rmdir()
        time.sleep(0.01)


def _kill_all(group: Path) -> None:
    with contextlib.suppress(OSError):
        for pid in (group / "cgroup.procs").read_text("ascii").split():
            os.kill(int(pid), signal.SIGKILL)
