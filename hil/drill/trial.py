"""One fault, done to a robot that drives, and what came of it."""

import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.drill import trace
from segway_ecc.hil.drill.faults import LIMIT_S, DrillFault, DrillOutcome
from segway_ecc.hil.drill.parts import DrillSetup, Parts, running, small_disk, wait_until_driven
from segway_ecc.hil.drill.trace import Torque
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
    """What came of a fault.

    Attributes:
        fault: What was done.
        expected: What was to come of it.
        guard: Whether the guard ran.
        torque: What became of the torque; None where the trial failed.
        said: What node and guard said after the fault.
        note: How the harm was done, where that is not plain; or why the trial failed.
        within_s: Longest time to the last torque, where torque was to end, s.
    """

    fault: str
    expected: DrillOutcome
    guard: bool
    torque: Torque | None
    said: Sequence[str]
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
    """Start the robot, do the harm and look on."""
    try:
        with contextlib.ExitStack() as disk:
            setup.log_folder.mkdir(parents=True, exist_ok=True)
            is_small = fault.disk and disk.enter_context(small_disk(setup.log_folder, _DISK_BYTES))
            with running(setup) as parts:
                wait_until_driven(parts, _DRIVEN_S)
                torque, said = _harm(fault, parts)
    except ProcessFailedError as error:
        return DrillResult(fault.name, fault.expected, setup.guard, None, [], str(error), fault.within_s)
    return DrillResult(
        fault.name, fault.expected, setup.guard, torque, said, _note(fault, is_small=is_small), fault.within_s
    )


def _harm(fault: DrillFault, parts: Parts) -> tuple[Torque, list[str]]:
    before = parts.said()
    with contextlib.ExitStack() as undo:
        fault_ns = fault.harm(parts, undo)
        time.sleep(_LOOK_S)
    time.sleep(_AFTER_S)
    until_ns = time.monotonic_ns()
    torque = trace.torque_after(trace.read(parts.setup.trace), fault_ns, until_ns)
    return torque, _new(parts.said(), before)


def _new(lines: Sequence[str], before: Sequence[str]) -> list[str]:
    """The lines that were not there before, each as often as it is new."""
    left = list(before)
    new = []
    for line in lines:
        if line in left:
            left.remove(line)
        else:
            new.append(line)
    return new


def _note(fault: DrillFault, *, is_small: bool) -> str:
    if fault.disk:
        return "a tmpfs filled to the last byte" if is_small else "no tmpfs to be had: the recorder's file size limited"
    if fault.stepped:
        return "as the processes read it: the machine's own clock is not set"
    return ""


def worst(trials: Sequence[DrillResult]) -> DrillResult:
    """The trial that tells most against the robot: one not as expected first, then the longest."""
    return max(trials, key=lambda t: (not t.is_as_expected, t.torque is None, _longest(t)))


def _longest(trial: DrillResult) -> float:
    if trial.torque is None:
        return 0.0
    return trial.torque.last_s if trial.expected is DrillOutcome.ENDS else trial.torque.gap_s
