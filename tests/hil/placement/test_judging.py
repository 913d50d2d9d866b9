# SPDX-License-Identifier: MIT
"""What is made of what was seen."""

import math

import pytest

from segway_ecc.hil.campaign.watch import Change
from segway_ecc.hil.design.balance import Truth
from segway_ecc.hil.placement.judging import RunOutcome, RunRecord, errors, outcome_of, reason_of, story
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

S = 1_000_000_000
STOOD = ((0.0, Posture.RESTING), (0.5, Posture.STANDING_UP), (1.6, Posture.BALANCING))
ARMED = Change(S, Mode.ARMED, "asked to arm")
SITS = (5.0, Posture.SITTING_DOWN)


def at(time: float, **values: float) -> Truth:
    rest = dict.fromkeys(Truth._fields[1:], 0.0)
    return Truth(time=time, **{**rest, **values})


def seen(
    *changes: Change,
    postures: tuple[tuple[float, Posture], ...] = STOOD,
    fallen_s: float = math.inf,
    zero_s: float | None = None,
    guard_s: float | None = None,
) -> RunRecord:
    """A run of 10 s, lying on its stop at 0.5 rad until 1.2 s and from `fallen_s` on."""
    times = [0.1 * i for i in range(101)]
    truth = [at(time, pitch=0.5 if time < 1.2 or time >= fallen_s else 0.01) for time in times]
    return RunRecord(truth, changes, postures, zero_s, guard_s, "digest")


def hold(at_s: float) -> Change:
    return Change(round(at_s * S), Mode.HOLD, "no set-point arrives any more")


def fault(at_s: float) -> Change:
    return Change(round(at_s * S), Mode.FAULT, "a is too old; b is too old; c is too old")


@pytest.mark.parametrize(
    ("run", "outcome"),
    [
        (seen(ARMED), RunOutcome.DROVE_ON),
        (seen(ARMED, hold(4.0)), RunOutcome.HELD),
        (seen(ARMED, hold(2.0)), RunOutcome.DROVE_ON),
        (seen(ARMED, hold(4.0), postures=(*STOOD, SITS), fallen_s=6.0), RunOutcome.SAT_DOWN),
        (seen(ARMED, hold(4.0), fallen_s=4.5), RunOutcome.FELL),
        (seen(ARMED, postures=(*STOOD, (4.0, Posture.FALLEN)), fallen_s=3.5), RunOutcome.FELL),
        (seen(ARMED, postures=STOOD[:2]), RunOutcome.NEVER_STOOD),
        (seen(postures=STOOD[:1], fallen_s=0.0), RunOutcome.NEVER_ARMED),
    ],
)
def test_the_worst_that_came_of_a_run_counts(run: RunRecord, outcome: RunOutcome) -> None:
    assert outcome_of(run, 3.0) is outcome


def test_errors_are_those_at_the_same_times() -> None:
    one = [at(0.0, x=1.0, linear_velocity=0.5), at(0.1, x=3.0, y=4.0, linear_velocity=1.0), at(0.2)]
    other = [at(0.0, x=1.0, linear_velocity=0.5), at(0.1, linear_velocity=0.7)]
    assert errors(one, other) == pytest.approx((5.0, 5.0 / math.sqrt(2.0), 0.3, 0.3 / math.sqrt(2.0)))
    assert errors([], []) == (0.0, 0.0, 0.0, 0.0)


def test_the_reason_is_the_first_one_the_guard_s_among_them() -> None:
    assert reason_of(seen(ARMED)) == ""
    assert reason_of(seen(ARMED, hold(4.0), fault(5.0))) == "no set-point arrives any more"
    assert reason_of(seen(ARMED, hold(4.0), fault(5.0)), 4.5) == "a is too old, and 2 more"
    assert (
        reason_of(seen(ARMED, fault(5.0), guard_s=4.9)) == "the guard stopped the drives: the node's heartbeats stopped"
    )


def test_a_story_shows_what_came_when() -> None:
    run = seen(ARMED, hold(4.0), fault(4.2), fallen_s=4.75, zero_s=4.25, guard_s=4.3)
    assert story(run, 4.0) == (
        "+0.00 s HOLD (no set-point arrives any more); +0.20 s FAULT (a is too old, and 2 more); "
        "+0.25 s torque zero for good; +0.30 s the guard stops the drives; +0.80 s lies"
    )
    assert story(seen(ARMED, hold(4.0), postures=(*STOOD, SITS), fallen_s=6.0), 4.5) == "+0.50 s sits down"
    assert story(seen(ARMED), 4.0) == "goes on as if nothing were"


@pytest.mark.parametrize(
    ("values", "calm"),
    [({}, True), ({"pitch": -0.16}, False), ({"pitch_rate": 0.51}, False), ({"linear_velocity": -0.31}, False)],
)
def test_who_leans_shakes_or_runs_at_the_end_is_not_calm(values: dict[str, float], calm: bool) -> None:  # noqa: FBT001 - a parameter of the test
    run = seen(ARMED)
    assert run._replace(truth=[*run.truth[:-3], at(9.8, **values), *run.truth[-2:]]).is_calm_at_the_end is calm
    assert run._replace(truth=[at(8.0, **values), *run.truth[81:]]).is_calm_at_the_end is True


def test_who_is_down_or_off_at_the_end_is_not_calm() -> None:
    assert seen(ARMED, fault(5.0)).is_calm_at_the_end is False
    assert seen(ARMED, postures=(*STOOD, (9.0, Posture.FALLEN))).is_calm_at_the_end is False
    assert seen(ARMED, hold(9.0)).is_calm_at_the_end is True
