# SPDX-License-Identifier: MIT
import math

import pytest

from segway_ecc.node.safety.posture import Body, Posture, PostureWatch
from segway_ecc.node.safety.settings import PostureSettings

STEP = 0.01
SETTINGS = PostureSettings(down_rad=0.4, up_rad=0.2, fall_s=0.3, stand_up_s=2.0, sit_down_s=1.5)
LYING = Body(0.5, is_still=True)
LEANING = Body(0.5, is_still=False)
UPRIGHT = Body(0.01, is_still=False)
BLIND = Body(None, is_still=False)


def now(watch: PostureWatch) -> Posture:
    """What it is by now; mypy takes an attribute to stay what it was."""
    return watch.posture


def look(watch: PostureWatch, body: Body, cycles: int = 1, *, wants_up: bool = True) -> list[str]:
    found = [watch.look(body, active=True, wants_up=wants_up) for _ in range(cycles)]
    return [fault for fault in found if fault is not None]


def balancing() -> PostureWatch:
    watch = PostureWatch(SETTINGS, STEP)
    look(watch, LYING)
    assert not look(watch, UPRIGHT, 10)
    assert now(watch) is Posture.BALANCING
    return watch


def sitting() -> PostureWatch:
    watch = balancing()
    look(watch, UPRIGHT, wants_up=False)
    assert now(watch) is Posture.SITTING_DOWN
    return watch


def fallen() -> PostureWatch:
    watch = balancing()
    assert look(watch, LEANING, 30)
    return watch


def test_the_postures_have_the_names_that_are_published() -> None:
    assert list(Posture) == ["RESTING", "STANDING UP", "BALANCING", "SITTING DOWN", "FALLEN"]


def test_a_robot_that_is_not_active_rests_whatever_is_asked() -> None:
    watch = PostureWatch(SETTINGS, STEP)
    assert watch.look(UPRIGHT, active=False, wants_up=True) is None
    assert (watch.posture, watch.reason) == (Posture.RESTING, "")


def test_it_rests_while_it_is_not_asked_to_stand() -> None:
    watch = PostureWatch(SETTINGS, STEP)
    look(watch, LYING, 1000, wants_up=False)
    assert now(watch) is Posture.RESTING


def test_it_stands_up_in_the_cycle_in_which_it_is_asked_and_is_up_after_a_tenth_of_a_second() -> None:
    watch = PostureWatch(SETTINGS, STEP)
    look(watch, LYING)
    assert now(watch) is Posture.STANDING_UP
    look(watch, UPRIGHT, 9)
    look(watch, Body(0.21, is_still=False))
    look(watch, UPRIGHT, 9)
    assert now(watch) is Posture.STANDING_UP
    look(watch, Body(0.2, is_still=False))
    assert now(watch) is Posture.BALANCING


@pytest.mark.parametrize("body", [LYING, LEANING, BLIND])
def test_it_has_fallen_where_it_does_not_stand_up_in_time(body: Body) -> None:
    watch = PostureWatch(SETTINGS, STEP)
    assert not look(watch, body, 201)
    assert look(watch, body) == ["the robot did not stand up within 2 s"]
    assert (watch.posture, watch.reason) == (Posture.FALLEN, "the robot did not stand up within 2 s")


def test_a_lean_that_lasts_is_a_fall_and_a_shorter_one_is_not() -> None:
    watch = balancing()
    assert not look(watch, LEANING, 29)
    assert not look(watch, Body(0.4, is_still=False))
    assert not look(watch, LEANING, 29)
    assert now(watch) is Posture.BALANCING
    assert look(watch, LEANING) == ["the robot has fallen: it leans 0.50 rad, beyond 0.4 rad for 0.3 s"]
    assert now(watch) is Posture.FALLEN


def test_cycles_that_were_skipped_count() -> None:
    watch = balancing()
    assert look(watch, LEANING._replace(periods=30))


def test_a_cycle_without_a_tilt_neither_begins_nor_ends_a_fall() -> None:
    watch = balancing()
    assert not look(watch, LEANING, 29)
    assert not look(watch, BLIND, 50)
    assert look(watch, LEANING)


def test_it_sits_down_when_asked_and_rests_when_it_lies_still() -> None:
    watch = sitting()
    look(watch, LEANING, 20, wants_up=False)
    assert now(watch) is Posture.SITTING_DOWN
    look(watch, LYING, wants_up=False)
    assert now(watch) is Posture.RESTING


def test_it_has_not_sat_down_while_it_is_still_but_no_further_than_up() -> None:
    watch = sitting()
    look(watch, Body(0.2, is_still=True), wants_up=False)
    assert now(watch) is Posture.SITTING_DOWN
    look(watch, Body(0.21, is_still=True), wants_up=False)
    assert now(watch) is Posture.RESTING


def test_it_sits_down_also_while_it_stands_up() -> None:
    watch = PostureWatch(SETTINGS, STEP)
    look(watch, LYING)
    look(watch, LEANING, wants_up=False)
    assert now(watch) is Posture.SITTING_DOWN


@pytest.mark.parametrize("body", [LEANING, UPRIGHT, Body(0.1, is_still=True), BLIND])
def test_it_has_fallen_where_it_does_not_sit_down_in_time(body: Body) -> None:
    watch = sitting()
    assert not look(watch, body, 150, wants_up=False)
    assert look(watch, body, wants_up=False) == ["the robot did not sit down within 1.5 s"]
    assert now(watch) is Posture.FALLEN


def test_a_robot_that_sits_down_ends_that_before_it_stands_up_again() -> None:
    watch = sitting()
    look(watch, LEANING)
    assert now(watch) is Posture.SITTING_DOWN
    look(watch, LYING)
    look(watch, LYING)
    assert now(watch) is Posture.STANDING_UP


@pytest.mark.parametrize("make", [balancing, sitting])
def test_a_robot_that_loses_its_torque_falls(make: object) -> None:
    watch = make()  # type: ignore[operator] # one of two functions
    watch.lose_torque(UPRIGHT, "asked to disarm")
    assert (watch.posture, watch.reason) == (Posture.FALLEN, "asked to disarm")
    watch.lose_torque(LYING, "another")
    assert watch.reason == "asked to disarm"


def test_a_robot_that_lies_when_it_loses_its_torque_rests() -> None:
    watch = sitting()
    watch.lose_torque(LYING, "asked to disarm")
    assert (watch.posture, watch.reason) == (Posture.RESTING, "")


def test_a_fall_is_latched_until_it_is_cleared() -> None:
    watch = fallen()
    for _ in range(1000):
        assert watch.look(UPRIGHT, active=False, wants_up=True) is None
    assert now(watch) is Posture.FALLEN
    watch.clear()
    assert (watch.posture, watch.reason) == (Posture.RESTING, "")


@pytest.mark.parametrize(("wants_up", "then"), [(False, Posture.RESTING), (True, Posture.STANDING_UP)])
def test_a_robot_that_fell_and_is_armed_again_does_as_it_is_asked(wants_up: bool, then: Posture) -> None:  # noqa: FBT001 - a column of the table
    watch = fallen()
    look(watch, LYING, wants_up=wants_up)
    assert (watch.posture, watch.reason) == (then, "")


def test_clearing_is_for_a_robot_that_fell() -> None:
    watch = balancing()
    watch.clear()
    assert now(watch) is Posture.BALANCING


def test_angles_must_be_in_their_order() -> None:
    with pytest.raises(ValueError, match=r"up_rad 0.4 is not below down_rad 0.4"):
        PostureSettings(up_rad=0.4, down_rad=0.4)


def test_an_angle_that_is_no_number_is_no_way_to_be_up() -> None:
    watch = PostureWatch(SETTINGS, STEP)
    look(watch, LYING)
    look(watch, Body(math.nan, is_still=True), 100)
    assert now(watch) is Posture.STANDING_UP
