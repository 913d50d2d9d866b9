"""What is made of a run: errors against the same manoeuvre with everything on the robot, and what came of it."""

import enum
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.campaign.watch import Change
from segway_ecc.hil.design.balance import Truth
from segway_ecc.hil.placement.seen import RunRecord
from segway_ecc.node.models.segway_phases import Phase
from segway_ecc.node.safety.modes import Mode

_NS_PER_S: Final = 1_000_000_000


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
    """Largest and root mean square, m and m/s."""

    max_position: float
    rms_position: float
    max_velocity: float
    rms_velocity: float


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
    is_sitting = any(phase is Phase.SITTING_DOWN for at_s, phase in seen.phases if at_s >= start_s)
    if not seen.changes:
        return RunOutcome.NEVER_ARMED
    if seen.phase_at(start_s) is not Phase.BALANCING:
        return RunOutcome.NEVER_STOOD
    if seen.fell_s(start_s) is not None:
        return RunOutcome.FELL
    if is_sitting:
        return RunOutcome.SAT_DOWN
    return RunOutcome.HELD if Mode.HOLD in after else RunOutcome.DROVE_ON


def reason_of(seen: RunRecord, since_s: float = 0.0) -> str:
    """The first reason for which the node was not armed after a time, or that the guard stopped the drives."""
    reasons = [_of_change(c) for c in seen.changes if c.mode is not Mode.ARMED and c.at_ns >= since_s * _NS_PER_S]
    guarded_s = seen.guard_s
    reasons += [(guarded_s, "the guard stopped the drives: commands stopped")] if guarded_s is not None else []
    return min(reasons)[1] if reasons else ""


def _of_change(change: Change) -> tuple[float, str]:
    return change.at_ns / _NS_PER_S, shortened(change.reason)


def shortened(reason: str) -> str:
    """A reason without those that came with it: where a snapshot is missing, each of its values gives one."""
    first, *others = reason.split("; ")
    return f"{first}, and {len(others)} more" if others else first


def story(seen: RunRecord, since_s: float) -> str:
    """What the robot did by itself after a time, one thing after the other, with how much later it was."""
    events = [(c.at_ns / _NS_PER_S, f"{c.mode} ({shortened(c.reason)})") for c in seen.changes]
    events += [(at_s, "sits down") for at_s, phase in seen.phases if phase is Phase.SITTING_DOWN]
    if seen.guard_s is not None:
        events.append((seen.guard_s, "the guard stops the drives"))
    if (fell_s := seen.fell_s(since_s)) is not None:
        events.append((fell_s, "lies"))
    if seen.zero_s is not None:
        events.append((seen.zero_s, "torque zero for good"))
    later = sorted((at_s - since_s, what) for at_s, what in events if at_s >= since_s)
    return "; ".join(f"+{after_s:.2f} s {what}" for after_s, what in later) or "goes on as if nothing were"
