# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.plausibility import Runaway
from segway_ecc.node.safety.settings import RunawaySettings

STEP = 0.01
RADIUS = 0.05
SETTINGS = RunawaySettings(wheel_radius=RADIUS, linear_window=0.3, distance_m=0.8, settle_s=1.0)


def runaway() -> Runaway:
    return Runaway(0, 1, SETTINGS, STEP)


def drive(
    check: Runaway, velocity: float, cycles: int = 1, asked: float | None = 0.0, *, valid: bool = True
) -> str | None:
    """Drive at a velocity, m/s, until a fault; the last thing that was found."""
    found = None
    for _ in range(cycles):
        wheel = velocity / RADIUS
        view = View((wheel, wheel), (valid, valid), 1, None if asked is None else (asked, 0.0))
        found = check.look(view)
        if found:
            break
    return found


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_robot_that_drives_off_is_a_fault_after_the_way_that_it_may_be_pushed(sign: float) -> None:
    check = runaway()
    assert drive(check, 1.3 * sign, 79) is None
    found = drive(check, 1.3 * sign, 2)
    assert found is not None
    assert found == (
        f"the robot runs away: it goes {1.3 * sign:.2f} m/s ahead, asked is 0.00 to 0.00 m/s, and it came "
        "0.80 m further than that"
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_asked_is_no_runaway_and_neither_is_resting(sign: float) -> None:
    check = runaway()
    assert drive(check, 1.2 * sign, 1000, asked=sign) is None
    assert drive(check, 0.0, 1000, asked=sign) is None
    assert drive(check, -0.2 * sign, 1000, asked=sign) is None


def test_the_other_way_than_asked_is_one() -> None:
    assert drive(runaway(), -1.0, 150, asked=1.0) is not None


def test_a_robot_has_time_to_settle() -> None:
    check = runaway()
    assert drive(check, 1.0, 200, asked=1.0) is None
    assert drive(check, 1.2, 100, asked=0.0) is None, "what was asked within settle_s is still allowed"
    assert drive(check, 1.0, 130, asked=0.0) is not None


def test_what_was_asked_before_it_had_to_follow_nothing_is_not_allowed_any_more() -> None:
    check = runaway()
    assert drive(check, 1.0, 10, asked=1.0) is None
    assert drive(check, 0.0, asked=None) is None
    assert drive(check, 1.2, 91, asked=0.0) is not None


def test_a_push_that_ends_begins_anew() -> None:
    check = runaway()
    for _ in range(10):
        assert drive(check, 1.3, 75) is None
        assert drive(check, 0.3) is None


def test_a_swing_to_and_fro_is_no_way() -> None:
    check = runaway()
    for _ in range(10):
        assert drive(check, 1.3, 70) is None
        assert drive(check, -1.3, 70) is None


def test_a_robot_that_follows_nothing_or_shows_nothing_is_not_looked_at() -> None:
    check = runaway()
    assert drive(check, 5.0, 1000, asked=None) is None
    assert drive(check, 5.0, 1000, valid=False) is None
    assert drive(check, 1.3, 75) is None
    assert drive(check, 1.3, asked=None) is None
    assert drive(check, 1.3, 75) is None


def test_skipped_cycles_count() -> None:
    check, wheel = runaway(), 1.3 / RADIUS
    found = [check.look(View((wheel, wheel), (True, True), 10, (0.0, 0.0))) for _ in range(9)]
    assert [fault is not None for fault in found] == [False] * 8 + [True]
