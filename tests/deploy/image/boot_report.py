# SPDX-License-Identifier: MIT
"""Where the time of a boot goes, from the kernel, systemd and the journal."""

import re
from dataclasses import dataclass

from tests.deploy.image.robot import NODE, Robot

_SHOWN = 10
_US = 1e-6


@dataclass(frozen=True)
class Boot:
    """When each stage of a boot was over, s since the machine was switched on.

    Attributes:
        kernel: The kernel has started the first program.
        init: Our init has mounted the data partition and started systemd.
        queued: systemd has come to the node.
        first_cycle: Its loop runs, and the journal has it.
        ready: It has met its deadlines for a second.
    """

    kernel: float
    init: float
    queued: float
    first_cycle: float
    ready: float

    def text(self) -> str:
        """What it comes to, and each stage's part."""
        ends = (self.kernel, self.init, self.queued, self.first_cycle)
        names = ("kernel", "init", "systemd and other services", "node")
        parts = [f"{name} {end - begin:.2f}" for name, begin, end in zip(names, (0.0, *ends), ends, strict=False)]
        return (
            f"power-on to first cycle {self.first_cycle:.2f} s: {', '.join(parts)}\n"
            f"service start to first cycle {self.first_cycle - self.queued:.2f} s, "
            f"to ready {self.ready - self.queued:.2f} s"
        )


def boot_of(robot: Robot) -> Boot:
    """The boot of a machine whose node has not been started again."""
    shown = robot.machine.run("dmesg | grep 'as init process'", 240)
    kernel = float(re.findall(r"\[ *([\d.]+)\]", shown)[0])
    init = int(robot.machine.run("systemctl show -P UserspaceTimestampMonotonic", 240)) * _US
    # Not when the unit left `inactive`, nor the journal's "Starting": on one processor the node is above systemd's
    # priority, so that it gets to write these down once the node's loop sleeps for the first time.
    queued, ready = (int(robot.property(f"{name}TimestampMonotonic")) * _US for name in ("Condition", "ActiveEnter"))
    return Boot(kernel, init, queued, robot.stamps(" runs at ")[0], ready)


def analysis(robot: Robot) -> str:
    """What systemd-analyze shows of a boot, once it is finished."""
    machine = robot.machine
    machine.run("timeout 300 systemctl is-system-running --wait > /dev/null || true", 360)
    words = ("time", f"blame | head -{_SHOWN}", f"critical-chain {NODE}")
    return "\n".join(machine.run(f"systemd-analyze --no-pager {word}", 240).strip() for word in words)
