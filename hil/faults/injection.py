# SPDX-License-Identifier: MIT
"""When faults are there, in lock step with the robot."""

import random
from collections.abc import Sequence
from typing import Final

from segway_ecc.hil.faults.fault import Fault, Target
from segway_ecc.hil.rig.simulated_bus import NowNs

_NS_PER_S: Final = 1_000_000_000
_SPREAD_S: Final = 0.02
"""How much later than declared a seed other than zero may make a fault: anywhere in a cycle."""


class Timeline:
    """Time since the robot was armed.

    Attributes:
        started_ns: When that was; None before.
    """

    def __init__(self, now_ns: NowNs) -> None:
        """Count on this clock once `start` was called."""
        self.started_ns: int | None = None
        self._now_ns = now_ns

    def start(self) -> None:
        """The robot was armed now, if it had not been before."""
        if self.started_ns is None:
            self.started_ns = self._now_ns()

    @property
    def elapsed_ns(self) -> int:
        """Time since the start; before it, negative."""
        return -1 if self.started_ns is None else self._now_ns() - self.started_ns


class Injection:
    """A declared fault in one run.

    Attributes:
        at_ns: When it begins, ns after the robot was armed.
    """

    def __init__(self, fault: Fault, timeline: Timeline, seed: str) -> None:
        """Inject a fault on a timeline; equal seeds inject equally."""
        self.fault = fault
        self.random = random.Random(seed)  # noqa: S311 - chance that can be repeated is what is wanted
        self.at_ns = round(fault.at_s * _NS_PER_S)
        self._timeline = timeline

    @property
    def size(self) -> float:
        """The fault's amount; 0 where it means something else than any number would."""
        return self.fault.size or 0.0

    @property
    def is_active(self) -> bool:
        """Whether the fault is there now."""
        since_ns = self.since_ns
        for_s = self.fault.for_s
        return since_ns >= 0 and (for_s is None or since_ns < for_s * _NS_PER_S)

    @property
    def since_ns(self) -> int:
        """How long ago the fault began; negative before."""
        return self._timeline.elapsed_ns - self.at_ns

    def happens(self) -> bool:
        """Whether chance, at the fault's probability, has it happen this time."""
        return self.random.random() < self.size


class Injections:
    """All faults of one run."""

    def __init__(self, faults: Sequence[Fault], seed: int, now_ns: NowNs) -> None:
        """Make the faults of a run; seed 0 makes each exactly when declared, others up to 20 ms later."""
        self.timeline = Timeline(now_ns)
        self._all = [Injection(fault, self.timeline, f"{seed}/{place}") for place, fault in enumerate(faults)]
        offset_s = random.Random(seed).uniform(0.0, _SPREAD_S) if seed else 0.0  # noqa: S311 - as above
        for injection in self._all:
            injection.at_ns += round(offset_s * _NS_PER_S)

    @property
    def first_ns(self) -> int | None:
        """When the first fault begins, ns after the robot was armed; None where there is none."""
        return min((injection.at_ns for injection in self._all), default=None)

    def of(self, *targets: Target) -> list[Injection]:
        """The faults of some parts."""
        return [injection for injection in self._all if injection.fault.target in targets]


def active(injections: Sequence[Injection]) -> list[Injection]:
    """Those that are there now."""
    return [injection for injection in injections if injection.is_active]
