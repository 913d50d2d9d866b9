# SPDX-License-Identifier: MIT
"""The cells of the grid: each is a run or a few, and what is made of them."""

import functools
from collections.abc import Sequence
from typing import Final

import msgspec

from segway_ecc.hil.placement.bench import START_S, PlacementRun, run
from segway_ecc.hil.placement.judging import (
    UPRIGHT,
    Errors,
    RunOutcome,
    RunRecord,
    errors,
    outcome_of,
    reason_of,
    story,
)
from segway_ecc.hil.placement.network import PERFECT, Network, Partition
from segway_ecc.hil.placement.placement import ON_THE_ROBOT, Placement
from segway_ecc.hil.placement.results import Cut, Drive, Stop
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

MANOEUVRE: Final = Manoeuvre(
    segments=(Segment(linear=0.5, duration=2.0), Segment(linear=0.5, angular=0.8, duration=2.0))
)
"""Ahead, then a curve, then rest."""
_REST_S: Final = 1.5
_CUT_AT_S: Final = START_S + 1.5
"""When a partition begins, s."""
_AFTER_CUT_S: Final = 3.0
_STOP_AT_S: Final = START_S + 1.5
_STOP_EVERY_S: Final = 0.0237
"""How much later each further seed presses: anywhere in a cycle, and between heartbeats."""
_STOPPED_WITHIN_S: Final = 2.5
UNSTAMPED: Final = "cmd_vel"
STAMPED: Final = "cmd_vel_stamped"
_remembered_run: Final = functools.lru_cache(maxsize=16)(run)
"""For the references, runs with everything on the robot, which many cells share."""


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """What a cell is run with.

    Attributes:
        robot: The robot.
        placement: Where the parts run.
        name: Of the network.
        network: The network.
        stamped: Whether set-points are sent ahead.
    """

    robot: str
    placement: Placement
    name: str
    network: Network
    stamped: bool

    @property
    def row(self) -> dict[str, str]:
        """As the results name it."""
        setpoints = (STAMPED if self.stamped else UNSTAMPED) if self.placement.sequence_crosses else ""
        places = {name: str(place) for name, place in self.placement._asdict().items()}
        return {**places, "network": self.name, "setpoints": setpoints}

    def job(self, manoeuvre: Manoeuvre, until_s: float) -> PlacementRun:
        """A run with it."""
        return PlacementRun(
            robot=self.robot,
            placement=self.placement,
            network=self.network,
            manoeuvre=manoeuvre,
            until_s=until_s,
            stamped=self.stamped,
        )


def drive(setting: Setting) -> Drive:
    """Drive the manoeuvre."""
    job = setting.job(MANOEUVRE, START_S + MANOEUVRE.duration_ns * 1e-9 + _REST_S)
    seen, apart = _against_reference(job)
    return Drive(
        **setting.row,
        outcome=outcome_of(seen, START_S),
        reason=reason_of(seen),
        max_position_m=apart.max_position,
        rms_position_m=apart.rms_position,
        max_velocity_m_s=apart.max_velocity,
        rms_velocity_m_s=apart.rms_velocity,
        max_tilt_rad=seen.max_tilt(START_S),
        digest=seen.digest,
    )


def stop(setting: Setting, seeds: Sequence[int]) -> Stop:
    """Press stop while it drives, once for each seed."""
    times, outcomes = [], []
    for place, seed in enumerate(seeds):
        pressed_s = _STOP_AT_S + place * _STOP_EVERY_S
        job = setting.job(MANOEUVRE, pressed_s + _STOPPED_WITHIN_S)
        seen = run(msgspec.structs.replace(job, seed=seed, stop_at_s=pressed_s))
        before = seen._replace(
            truth=[at for at in seen.truth if at.time < pressed_s],
            changes=[change for change in seen.changes if change.at_ns < pressed_s * 1e9],
            phases=[phase for phase in seen.phases if phase[0] < pressed_s],
        )
        outcome = outcome_of(before, START_S)
        outcomes.append(outcome)
        is_measured = outcome in UPRIGHT and seen.zero_s is not None
        times.append((seen.zero_s or 0.0) - pressed_s if is_measured else None)
    return Stop(**setting.row, zero_s=tuple(times), outcome=max(outcomes, key=list(RunOutcome).index))


def cut(setting: Setting, partition_s: float) -> Cut:
    """Cut the network while it drives."""
    network = msgspec.structs.replace(setting.network, partitions=(Partition(_CUT_AT_S, partition_s),))
    lasts_s = _CUT_AT_S - START_S + partition_s + _AFTER_CUT_S
    manoeuvre = Manoeuvre(segments=(Segment(linear=0.3, angular=0.4, duration=lasts_s),))
    job = msgspec.structs.replace(setting, network=network).job(manoeuvre, START_S + lasts_s + _REST_S)
    seen, apart = _against_reference(job)
    return Cut(
        **setting.row,
        partition_s=partition_s,
        outcome=outcome_of(seen, START_S),
        did=story(seen, _CUT_AT_S),
        max_position_m=apart.max_position,
        max_tilt_rad=seen.max_tilt(START_S),
    )


def _against_reference(job: PlacementRun) -> tuple[RunRecord, Errors]:
    seen = run(job)
    reference = _remembered_run(msgspec.structs.replace(job, placement=ON_THE_ROBOT, network=PERFECT, stamped=True))
    return seen, errors(seen.since(START_S), reference.since(START_S))
