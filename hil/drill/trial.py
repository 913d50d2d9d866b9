# SPDX-License-Identifier: MIT
"""One fault, done to a robot that drives, and its outcome."""

import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.drill.faults import LIMIT_S, DrillFault, DrillOutcome
from segway_ecc.hil.drill.parts import DrillSetup, Parts, running, small_disk, wait_until_driven
from segway_ecc.hil.drill.plant_control import Torque, read_trace, torque_after
from segway_ecc.hil.processes import ProcessFailedError

GAP_LIMIT_S: Final = 0.1
"""A robot that drives on may be without torque for no longer, as while it passes to its other line."""
_DRIVEN_S: Final = 1.5
_LOOK_S: Final = 1.0
_AFTER_S: Final = 0.5
"""Looked on for after a stopped process goes on: what it does then counts too."""
_DISK_BYTES: Final = 4 << 20


@dataclass(frozen=True, slots=True)
class DrillResult:
    """The outcome of a fault.

    Attributes:
        torque: What became of the torque; None where the drill failed.
        messages: The messages of node and guard after the fault.
        note: How the harm was done, where that is not plain; or why the drill failed.
        within_s: Longest time to the last torque, where torque was to end, s.
    """

    fault: str
    expected: DrillOutcome
    guard: bool
    torque: Torque | None
    messages: Sequence[str]
    note: str = ""
    within_s: float = LIMIT_S

    @property
    def is_as_expected(self) -> bool:
        """Whether the robot did what it must."""
        if self.torque is None:
            return False
        if self.expected is DrillOutcome.ENDS:
            return self.torque.zero_s is not None and self.torque.last_s <= self.within_s
        return self.torque.zero_s is None and self.torque.gap_s <= GAP_LIMIT_S

    @property
    def outcome(self) -> str:
        """What happened."""
        if self.torque is None:
            return "failed"
        return str(DrillOutcome.DRIVES_ON if self.torque.zero_s is None else DrillOutcome.ENDS)


def run(fault: DrillFault, setup: DrillSetup) -> DrillResult:
    """Start the robot, do the harm and observe it."""
    torque, messages, note = None, list[str](), ""
    try:
        with contextlib.ExitStack() as disk:
            setup.log_folder.mkdir(parents=True, exist_ok=True)
            is_small = fault.disk and disk.enter_context(small_disk(setup.log_folder, _DISK_BYTES))
            with running(setup) as parts:
                wait_until_driven(parts, _DRIVEN_S)
                torque, messages = _harm(fault, parts)
    except ProcessFailedError as error:
        note = str(error)
    else:
        if fault.disk:
            note = (
                "a tmpfs filled to the last byte"
                if is_small
                else "no tmpfs to be had: the recorder's file size limited"
            )
        elif fault.stepped:
            note = "as the processes read it: the machine's own clock is not set"
    return DrillResult(fault.name, fault.expected, setup.guard, torque, messages, note, fault.within_s)


def _harm(fault: DrillFault, parts: Parts) -> tuple[Torque, list[str]]:
    before = parts.log_lines()
    with contextlib.ExitStack() as undo:
        fault_ns = fault.harm(parts, undo)
        time.sleep(_LOOK_S)
    time.sleep(_AFTER_S)
    until_ns = time.monotonic_ns()
    torque = torque_after(read_trace(parts.setup.trace), fault_ns, until_ns)
    new = []
    for line in parts.log_lines():
        if line in before:
            before.remove(line)
        else:
            new.append(line)
    return torque, new


def worst(results: Sequence[DrillResult]) -> DrillResult:
    """The result that counts most against the robot: one not as expected first, then the longest."""

    def badness(result: DrillResult) -> tuple[bool, bool, float]:
        torque = result.torque
        if torque is None:
            return not result.is_as_expected, True, 0.0
        ends = result.expected is DrillOutcome.ENDS
        return not result.is_as_expected, False, torque.last_s if ends else torque.gap_s

    return max(results, key=badness)
