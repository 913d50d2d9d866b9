"""What is seen of one run: the truth of the plant, what the node did, and what the guard did."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.campaign.watch import Change
from segway_ecc.hil.design.balance import Truth
from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.models.segway_phases import Phase
from segway_ecc.node.safety.modes import Mode

FALLEN_RAD: Final = 0.9 * PUBLISHED.stop_angle
"""A body that leans this far is about to lie."""
_CALM: Final = (0.15, 0.5, 0.3)
"""Pitch, rad; pitch rate, rad/s; velocity, m/s: far more than at rest, and far less than what shakes."""
_CALM_FOR_S: Final = 1.0


class PhaseRecorder(NoRecorder):
    """Keeps when the model entered each phase; see `Recorder`.

    Attributes:
        phases: Simulated time, s, and phase, oldest first.
    """

    def __init__(self, place: int, period_ns: int) -> None:
        """Find the phase at a place among the model's outputs."""
        self.phases: list[tuple[float, Phase]] = []
        self._place = place
        self._period_s = period_ns * 1e-9

    def write(self, record: CycleRecord) -> None:
        """Look at a cycle."""
        phase = Phase(round(record.y[self._place]))
        if not self.phases or phase is not self.phases[-1][1]:
            self.phases.append((record.cycle * self._period_s, phase))


class RunRecord(NamedTuple):
    """What was seen of a run.

    Attributes:
        truth: Where the robot really was at each tick.
        changes: What modes the node entered, ns of simulated time.
        phases: What the model was doing.
        zero_s: When the drives gave nothing any more, s; None where one still does at the end.
        guard_s: When the guard stopped the drives first, s; None where it never had to.
        digest: Over everything that the drives gave, and all truth.
    """

    truth: Sequence[Truth]
    changes: Sequence[Change]
    phases: Sequence[tuple[float, Phase]]
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
                return at.time if self.phase_at(at.time) is not Phase.SITTING_DOWN else None
        return None

    def phase_at(self, time_s: float) -> Phase:
        """What the model was doing at a time."""
        return [Phase.RESTING, *(phase for at_s, phase in self.phases if at_s <= time_s)][-1]

    @property
    def end_s(self) -> float:
        """When the run ended."""
        return self.truth[-1].time

    @property
    def is_calm_at_the_end(self) -> bool:
        """Whether it balanced at the end, armed and still."""
        last = self.since(self.end_s - _CALM_FOR_S)
        mode = self.changes[-1].mode if self.changes else None
        most = [max(map(abs, column)) for column in ([a.pitch for a in last], [a.pitch_rate for a in last])]
        most.append(max(abs(a.linear_velocity) for a in last))
        is_up = self.phase_at(self.end_s) is Phase.BALANCING and mode in (Mode.ARMED, Mode.HOLD)
        return is_up and all(value < limit for value, limit in zip(most, _CALM, strict=True))
