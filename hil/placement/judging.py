# SPDX-License-Identifier: MIT
"""What was seen of one run (truth of the plant, node and guard), its errors against a reference, and its outcome."""

import enum
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.guard.watch import Cause
from segway_ecc.hil.campaign.watch import Change
from segway_ecc.hil.design.balance import Truth
from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

FALLEN_RAD: Final = 0.9 * PUBLISHED.stop_angle
"""A body that leans this far is about to lie."""
_CALM: Final = (0.15, 0.5, 0.3)
"""Pitch, rad; pitch rate, rad/s; velocity, m/s: far more than at rest, and far less than what shakes."""
_CALM_FOR_S: Final = 1.0
_NS_PER_S: Final = 1_000_000_000


class PostureRecorder(NoRecorder):
    """Keeps when the robot entered each posture, simulated time, s, oldest first; see `Recorder`."""

    def __init__(self, period_ns: int) -> None:
        """Keep those of a robot with this period, ns."""
        self.postures: list[tuple[float, Posture]] = []
        self._period_s = period_ns * 1e-9

    def write(self, record: CycleRecord) -> None:
        """Look at a cycle."""
        if record.posture is not None:
            self.postures.append((record.cycle * self._period_s, record.posture.posture))


class RunRecord(NamedTuple):
    """What was seen of a run.

    Attributes:
        truth: Where the robot really was at each tick.
        changes: What modes the node entered, ns of simulated time.
        zero_s: When the drives gave nothing any more, s; None where one still does at the end.
        guard_s: When the guard stopped the drives first, s; None where it never had to.
        digest: Over everything that the drives gave, and all truth.
    """

    truth: Sequence[Truth]
    changes: Sequence[Change]
    postures: Sequence[tuple[float, Posture]]
    zero_s: float | None
    guard_s: float | None
    digest: str

    def since(self, start_s: float) -> Sequence[Truth]:
        """The truth from a time on."""
        return [at for at in self.truth if at.time >= start_s]

    def max_tilt(self, start_s: float) -> float:
        """Largest tilt from a time on, rad."""
        return max((abs(at.pitch) for at in self.since(start_s)), default=0.0)

    def fell_s(self, start_s: float) -> float | None:
        """When it lay down though it was not sitting down, after a time; None where it never did."""
        for at in self.since(start_s):
            if abs(at.pitch) > FALLEN_RAD:
                return at.time if self.posture_at(at.time) is not Posture.SITTING_DOWN else None
        return None

    def posture_at(self, time_s: float) -> Posture:
        """What the robot was doing at a time."""
        return [Posture.RESTING, *(posture for at_s, posture in self.postures if at_s <= time_s)][-1]

    @property
    def end_s(self) -> float:
        """When the run ended."""
        return self.truth[-1].time

    @property
    def is_calm_at_the_end(self) -> bool:
        """Whether it balanced at the end, armed and still."""
        mode = self.changes[-1].mode if self.changes else None
        is_still = all(
            abs(value) < limit
            for at in self.since(self.end_s - _CALM_FOR_S)
            for value, limit in zip((at.pitch, at.pitch_rate, at.linear_velocity), _CALM, strict=True)
        )
        return is_still and self.posture_at(self.end_s) is Posture.BALANCING and mode in (Mode.ARMED, Mode.HOLD)


@enum.unique
class RunOutcome(enum.StrEnum):
    """What came of a run."""

    DROVE_ON = "drove on"
    HELD = "held"
    """It held its place for a while."""
    SAT_DOWN = "sat down"
    FELL = "fell"
    NEVER_STOOD = "never stood up"
    NEVER_ARMED = "never armed"


UPRIGHT: Final = frozenset({RunOutcome.DROVE_ON, RunOutcome.HELD, RunOutcome.SAT_DOWN})
"""What does not hurt anybody."""


class Errors(NamedTuple):
    """Largest distance and difference of the velocity ahead, and their root mean squares."""

    max_position_m: float
    rms_position_m: float
    max_velocity_m_s: float
    rms_velocity_m_s: float


def errors(truth: Sequence[Truth], reference: Sequence[Truth]) -> Errors:
    """How far apart two runs are at the same times, as long as both last."""
    pairs = list(zip(truth, reference, strict=False))
    apart = [math.hypot(a.x - b.x, a.y - b.y) for a, b in pairs]
    differences = [abs(a.linear_velocity - b.linear_velocity) for a, b in pairs]
    return Errors(max(apart, default=0.0), _rms(apart), max(differences, default=0.0), _rms(differences))


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(math.fsum(value * value for value in values) / len(values)) if values else 0.0


def outcome_of(seen: RunRecord, start_s: float) -> RunOutcome:
    """What came of a run whose manoeuvre began at `start_s`; the worst counts."""
    after = [change.mode for change in seen.changes if change.at_ns >= start_s * _NS_PER_S]
    is_sitting = any(posture is Posture.SITTING_DOWN for at_s, posture in seen.postures if at_s >= start_s)
    if not seen.changes:
        return RunOutcome.NEVER_ARMED
    if seen.posture_at(start_s) is not Posture.BALANCING:
        return RunOutcome.NEVER_STOOD
    if seen.fell_s(start_s) is not None:
        return RunOutcome.FELL
    if is_sitting:
        return RunOutcome.SAT_DOWN
    return RunOutcome.HELD if Mode.HOLD in after else RunOutcome.DROVE_ON


def reason_of(seen: RunRecord, since_s: float = 0.0) -> str:
    """The first reason for which the node was not armed after a time, or that the guard stopped the drives."""
    changes = [c for c in seen.changes if c.mode is not Mode.ARMED and c.at_ns >= since_s * _NS_PER_S]
    reasons = [(change.at_ns / _NS_PER_S, shortened(change.reason)) for change in changes]
    if seen.guard_s is not None:
        reasons.append((seen.guard_s, f"the guard stopped the drives: {Cause.SILENCE}"))
    return min(reasons)[1] if reasons else ""


def shortened(reason: str) -> str:
    """A reason without those that came with it: where a snapshot is missing, each of its values gives one."""
    first, *others = reason.split("; ")
    return f"{first}, and {len(others)} more" if others else first


def story(seen: RunRecord, since_s: float) -> str:
    """What the robot did by itself after a time, one thing after the other, with how much later it was."""
    events = [(c.at_ns / _NS_PER_S, f"{c.mode} ({shortened(c.reason)})") for c in seen.changes]
    events += [(at_s, "sits down") for at_s, posture in seen.postures if posture is Posture.SITTING_DOWN]
    if seen.guard_s is not None:
        events.append((seen.guard_s, "the guard stops the drives"))
    if (fell_s := seen.fell_s(since_s)) is not None:
        events.append((fell_s, "lies"))
    if seen.zero_s is not None:
        events.append((seen.zero_s, "torque zero for good"))
    later = sorted((at_s - since_s, what) for at_s, what in events if at_s >= since_s)
    return "; ".join(f"+{after_s:.2f} s {what}" for after_s, what in later) or "goes on as if nothing were"
