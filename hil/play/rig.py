# SPDX-License-Identifier: MIT
"""What a person can do to the plant: push it, and break its bus."""

import os
from collections.abc import Callable
from typing import Final

PUSH_N: Final = 50.0
PUSH_S: Final = 0.1
"""With `PUSH_N` 5 N s: the segway of the case study recovers from 7.5 N s at rest."""
FORCE: Final = "PushForce"


class PlantControls:
    """Sends commands to the plant's process, without waiting for it.

    Attributes:
        has_ros: Whether ROS reaches the robot.
        guard_runs: Whether the guard runs.
        can_be_pushed: Whether the plant can be pushed.
        is_bus_broken: Whether the bus was broken by hand.
    """

    def __init__(
        self,
        control: int,
        period_ns: int,
        guard_runs: Callable[[], bool],
        *,
        has_ros: bool = False,
        can_be_pushed: bool,
    ) -> None:
        """Write to the plant's control, a descriptor; `work` is called once in `period_ns`."""
        self.has_ros = has_ros
        self.guard_runs = guard_runs
        self.can_be_pushed = can_be_pushed
        self.is_bus_broken = False
        self._control = control
        self._push_cycles = max(round(PUSH_S * 1e9 / period_ns), 1)
        self._left = 0
        os.set_blocking(control, False)

    def push(self) -> None:
        """Push the robot ahead for a moment, where it can be pushed."""
        if self.can_be_pushed and self._send(f"write {FORCE} {PUSH_N}"):
            self._left = self._push_cycles

    def toggle_bus(self) -> None:
        """Cut the bus; or restore it, where it was cut."""
        if self._send("heal" if self.is_bus_broken else "cut"):
            self.is_bus_broken = not self.is_bus_broken

    def work(self) -> None:
        """End a push whose time is over."""
        if self._left == 1 and not self._send(f"write {FORCE} 0"):
            return
        self._left = max(self._left - 1, 0)

    def _send(self, line: str) -> bool:
        try:
            return os.write(self._control, f"{line}\n".encode()) > 0
        except OSError:  # full, or the plant is gone
            return False
