# SPDX-License-Identifier: MIT
"""The robot in a booted image, as an operator sees it."""

import json
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tests.deploy.image.uml_machine import Machine

NODE = "segway-ecc-node.service"


class SwitchOn(Protocol):
    """Switches a machine on, with more words of the kernel's command line where there are any."""

    def __call__(self, folder: Path, *options: str) -> AbstractContextManager[Machine]: ...


@dataclass(frozen=True)
class Robot:
    """The robot's services on a machine."""

    machine: Machine

    def is_patient(self) -> None:
        """Give a node time that a busy host takes from the guest: what is seen is that it is watched, not how fast."""
        self.drop_in(NODE, "TimeoutStartSec=infinity\\nWatchdogSec=20s")

    def drop_in(self, unit: str, text: str) -> None:
        """Change a unit until the machine is off."""
        folder = f"/run/systemd/system/{unit}.d"
        self.machine.run(f"mkdir -p {folder} && printf '[Service]\\n{text}\\n' > {folder}/test.conf")
        self.machine.run("systemctl daemon-reload", 240)

    def mask_guard(self) -> None:
        """Do without the guard, which takes half of the guest's one slow processor."""
        self.machine.run("systemctl mask --quiet --runtime --now segway-ecc-guard", 240)

    def property(self, name: str, unit: str = NODE) -> str:
        """A property of a unit."""
        return self.machine.run(f"systemctl show -P {name} {unit}", 240).strip()

    def status(self) -> dict[str, object]:
        """What the node reports; nothing where it is just being started."""
        text = self.property("StatusText")
        return dict(json.loads(text)) if text else {"mode": ""}

    def wait_until_up(self) -> None:
        """Wait until the node is ready and reports its state."""
        self.machine.wait_until(f"systemctl is-active --quiet {NODE}", 600)
        self.machine.wait_until(f'[ -n "$(systemctl show -P StatusText {NODE})" ]', 600)

    def kill(self, name: str) -> int:
        """Send the node a signal and wait until it was started again; when, monotonic, ns."""
        before, pid = int(self.property("NRestarts")), self.property("MainPID")
        send = f"import os, signal, time; t = time.monotonic_ns(); os.kill({pid}, signal.{name}); print(t)"
        at_ns = int(self.machine.run(f"python3 -c '{send}'", 240))
        self.machine.run("sleep 3")  # to ask at once would take the time of the guest's one processor from the restart
        self.machine.wait_until(f'[ "$(systemctl show -P NRestarts {NODE})" -gt {before} ]', 600)
        return at_ns

    def stop(self) -> None:
        """Stop the node by its service manager, and wait until it has ended."""
        self.machine.run(f"systemctl stop {NODE}", 240)

    def start(self) -> None:
        """Start it again, as at boot."""
        self.machine.run(f"systemctl start --no-block {NODE}", 240)

    def journal(self) -> str:
        """What the node's unit has logged since the machine was switched on."""
        return self.machine.run(f"journalctl -b -u {NODE} -o short-monotonic --no-pager", 240)

    def logs(self) -> list[str]:
        """The logs of its runs."""
        return self.machine.run("ls /var/log/segway-ecc/logs", 240).split()

    def stamps(self, text: str) -> list[float]:
        """When it logged something, s since the machine was switched on."""
        return [float(line[1:].split("]")[0]) for line in self.journal().splitlines() if text in line]

    def times(self) -> str:
        """When the first cycles came."""
        starts, first = self.stamps("Starting segway-ecc-node"), self.stamps(" runs at ")
        again = ", ".join(f"{run - start:.1f}" for start, run in zip(starts, first, strict=False))
        return f"power-on to first cycle {first[0]:.1f} s, service start to first cycle {again} s"
