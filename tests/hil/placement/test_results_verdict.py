# SPDX-License-Identifier: MIT
"""Which placements are fit, and which one is recommended."""

import pytest

from segway_ecc.hil.placement.judging import RunOutcome
from segway_ecc.hil.placement.results import Drive, overall, recommended, unfit
from tests.hil.placement.scripted import R, S, cut, drive, found, stop

ALL_ON_ROBOT, COMMANDED, ALL_AWAY = (R, R, R), (S, R, S), (S, S, S)


@pytest.mark.parametrize(
    ("row", "reasons"),
    [
        (drive(COMMANDED, off_m=0.1), []),
        (drive(COMMANDED, off_m=0.11), ["0.11 m off"]),
        (drive(COMMANDED, outcome=RunOutcome.FELL), ["fell"]),
        (drive(COMMANDED, outcome=RunOutcome.HELD), ["held"]),
        (drive(COMMANDED, outcome=RunOutcome.NEVER_ARMED), ["never armed"]),
    ],
)
def test_what_falls_holds_or_is_far_off_is_unfit(row: Drive, reasons: list[str]) -> None:
    assert unfit(found(row), row.placement, "n") == reasons


@pytest.mark.parametrize(
    ("times", "reasons"),
    [((0.1, 0.5), []), ((0.1, 0.51), ["stops after 0.51 s"]), ((0.1, None), ["no stop"])],
)
def test_a_stop_must_come_and_in_time_with_every_press(times: tuple[float | None, ...], reasons: list[str]) -> None:
    row = drive(COMMANDED, setpoints="cmd_vel")
    assert unfit(found(row, stop(COMMANDED, *times, setpoints="cmd_vel_stamped")), row.placement, "n") == reasons
    assert unfit(found(row, stop(COMMANDED, *times, network="other")), row.placement, "n") == []


def test_what_fell_before_the_press_counts_as_fallen_only() -> None:
    row = drive(COMMANDED, outcome=RunOutcome.FELL)
    assert unfit(found(row, stop(COMMANDED, None, outcome=RunOutcome.FELL)), row.placement, "n") == ["fell"]


def test_who_falls_in_a_partition_is_unfit_on_every_network() -> None:
    row = drive(ALL_AWAY)
    rows = (
        row,
        cut(ALL_AWAY, RunOutcome.SAT_DOWN, partition_s=0.3),
        cut(ALL_AWAY, RunOutcome.FELL),
        cut(ALL_AWAY, RunOutcome.FELL),
    )
    assert unfit(found(*rows), row.placement, "n") == ["falls in a partition of 2 s"]
    assert unfit(found(row, cut(COMMANDED, RunOutcome.FELL)), row.placement, "n") == []


def test_recommended_is_what_is_fit_with_the_most_on_the_station() -> None:
    rows = [drive(ALL_ON_ROBOT), drive(COMMANDED, setpoints="cmd_vel"), drive(COMMANDED, setpoints="cmd_vel_stamped")]
    assert recommended(found(*rows), "n") == (*COMMANDED, "cmd_vel_stamped")
    assert recommended(found(*rows, drive(ALL_AWAY)), "n") == (*ALL_AWAY, "")
    assert recommended(found(*rows, drive(ALL_AWAY, outcome=RunOutcome.FELL)), "n") == (*COMMANDED, "cmd_vel_stamped")
    assert recommended(found(drive(ALL_AWAY, outcome=RunOutcome.FELL)), "n") is None


def test_of_as_many_supervision_belongs_where_the_people_are() -> None:
    rows = [drive((R, R, S)), drive((S, R, R), setpoints="cmd_vel_stamped")]
    assert recommended(found(*rows), "n") == (R, R, S, "")


def test_overall_is_what_is_fit_on_the_most_networks() -> None:
    rows = [drive(places, name) for places in (ALL_ON_ROBOT, (R, R, S)) for name in ("a", "b")]
    rows += [drive(COMMANDED, "a"), drive(COMMANDED, "b", off_m=0.3)]
    assert overall(found(*rows)) == (R, R, S, "")
    assert recommended(found(*rows), "a") == (*COMMANDED, "")
    assert recommended(found(*rows), "b") == (R, R, S, "")
    assert overall(found(drive(ALL_AWAY, outcome=RunOutcome.FELL))) is None


def test_a_choice_is_reported_in_words() -> None:
    assert str(drive(ALL_ON_ROBOT).placement) == "all on the robot"
    assert str(drive(COMMANDED, setpoints="cmd_vel").placement) == "sequence and supervision on the station, cmd_vel"
