# SPDX-License-Identifier: MIT
"""A robot that does not go as it was told is found in its time, and one that does is left alone."""

import math
import random
from collections.abc import Iterator

import pytest

from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.plausibility import FollowingError
from segway_ecc.node.safety.settings import FollowingErrorSettings

STEP = 0.01
SETTLE = 50
FOR = 10
"""Half a second and a tenth, in periods."""
RADIUS = 0.05
TRACK = 0.3
SETTINGS = FollowingErrorSettings(
    track=TRACK, wheel_radius=RADIUS, linear_window=0.3, angular_window=0.75, settle_s=0.5, for_s=0.1
)


def following(**more: float | bool | None) -> FollowingError:
    options = {name: getattr(SETTINGS, name) for name in SETTINGS.__struct_fields__} | more
    return FollowingError(1, 0, FollowingErrorSettings(**options), STEP)


def see(
    linear: float, angular: float, asked: tuple[float, float] | None, periods: int = 1, *, valid: bool = True
) -> View:
    """A robot that goes like this; its right wheel comes first in the values."""
    left, right = ((linear - way * 0.5 * TRACK * angular) / RADIUS for way in (1.0, -1.0))
    return View((right, left), (True, valid), periods, asked)


def told(check: FollowingError, views: Iterator[View]) -> int | None:
    """The first view, counted from 1, at which it is told; None where it never is."""
    return next((n for n, view in enumerate(views, 1) if check.look(view) is not None), None)


def steady(*view: object, count: int = 300) -> Iterator[View]:
    return (see(*view) for _ in range(count))  # type: ignore[arg-type] # arguments of `see`


def test_a_robot_that_goes_as_asked_is_left_alone() -> None:
    assert told(following(), steady(1.0, 0.5, (1.0, 0.5))) is None
    assert told(following(), steady(1.0 + 0.29, 0.5 - 0.74, (1.0, 0.5))) is None


@pytest.mark.parametrize(
    ("linear", "angular", "text"),
    [
        (1.31, 0.5, "the robot goes 1.31 m/s ahead, asked is 1.00 to 1.00 m/s"),
        (0.69, 0.5, "the robot goes 0.69 m/s ahead, asked is 1.00 to 1.00 m/s"),
        (-1.0, 0.5, "the robot goes -1.00 m/s ahead, asked is 1.00 to 1.00 m/s"),
        (1.0, 1.26, "the robot goes 1.26 rad/s turning, asked is 0.50 to 0.50 rad/s"),
        (1.0, -0.26, "the robot goes -0.26 rad/s turning, asked is 0.50 to 0.50 rad/s"),
        (math.nan, 0.5, "the robot goes nan m/s ahead, asked is 1.00 to 1.00 m/s"),
    ],
)
def test_following_error_beyond_the_window_faults_after_its_time(linear: float, angular: float, text: str) -> None:
    check = following()
    assert told(check, steady(1.0, 0.5, (1.0, 0.5), count=100)) is None
    answers = [check.look(see(linear, angular, (1.0, 0.5))) for _ in range(FOR + 5)]
    assert answers == [None] * (FOR - 1) + [text] * 6


def test_one_good_cycle_ends_what_was_wrong() -> None:
    check = following()
    for _ in range(20):
        assert told(check, steady(2.0, 0.0, (1.0, 0.0), count=1)) is None
        assert told(check, steady(2.0, 0.0, (1.0, 0.0), count=FOR - 2)) is None
        assert check.look(see(1.0, 0.0, (1.0, 0.0))) is None


def test_so_does_a_wheel_that_has_lost_the_floor() -> None:
    check, spins = following(), see(2.0, 0.0, (1.0, 0.0))
    spins.spins = True
    assert told(check, steady(1.0, 0.0, (1.0, 0.0), count=100)) is None
    assert told(check, iter([spins] * 100)) is None
    assert told(check, steady(2.0, 0.0, (1.0, 0.0), count=FOR - 1)) is None
    assert check.look(spins) is None
    assert told(check, steady(2.0, 0.0, (1.0, 0.0), count=FOR)) == FOR


def test_skipped_deadlines_count() -> None:
    check = following()
    assert told(check, steady(1.0, 0.0, (1.0, 0.0), count=100)) is None
    assert check.look(see(2.0, 0.0, (1.0, 0.0), FOR - 1)) is None
    assert check.look(see(2.0, 0.0, (1.0, 0.0))) is not None


def test_between_two_set_points_it_may_go_as_it_likes_while_it_settles() -> None:
    check = following()
    assert told(check, steady(1.0, 0.5, (1.0, 0.5), count=100)) is None
    noise = random.Random(3)  # noqa: S311 - chance that can be repeated is what is wanted
    views = (see(noise.uniform(-0.4, 1.0), noise.uniform(-2.0, 0.5), (-0.4, -2.0)) for _ in range(SETTLE))
    assert told(check, views) is None


def test_robot_that_does_not_respond_faults_once_it_should_have_settled() -> None:
    check = following()
    assert told(check, steady(1.0, 0.0, (1.0, 0.0), count=100)) is None
    assert told(check, steady(1.0, 0.0, (0.4, 0.0))) == SETTLE + FOR


def test_robot_that_turns_the_wrong_way_faults_at_once() -> None:
    check = following()
    assert told(check, steady(1.0, 0.5, (1.0, 0.5), count=100)) is None
    assert told(check, steady(1.0, 1.3, (1.0, -0.5))) == FOR


def test_a_wheel_behind_a_lag_may_be_led_about_all_the_time() -> None:
    check, speed, told_speed = following(), [0.0, 0.0], (0.0, 0.0)
    chance = random.Random(5)  # noqa: S311 - chance that can be repeated is what is wanted
    for n in range(5000):
        if n % 13 == 0:
            told_speed = (chance.uniform(-3.0, 3.0), chance.uniform(-9.0, 9.0))
        speed = [v + STEP / 0.065 * (wanted - v) for v, wanted in zip(speed, told_speed, strict=True)]
        assert check.look(see(speed[0], speed[1], told_speed)) is None


@pytest.mark.parametrize("moving", [3.0, -3.0])
def test_one_that_begins_to_follow_may_still_move(moving: float) -> None:
    assert told(following(), steady(moving, 0.0, (0.0, 0.0))) == 1 + SETTLE + FOR
    assert told(following(), steady(0.0, moving, (0.0, 0.0))) == 1 + SETTLE + FOR


def test_one_that_follows_nothing_is_left_alone_and_begins_anew() -> None:
    check = following()
    assert told(check, steady(1.0, 0.0, (1.0, 0.0), count=100)) is None
    assert told(check, steady(1.0, 0.0, (0.0, 0.0), count=SETTLE + FOR - 1)) is None
    assert told(check, steady(1.0, 0.0, None)) is None
    assert told(check, steady(1.0, 0.0, (0.0, 0.0))) == 1 + SETTLE + FOR
    assert told(check, steady(9.0, 9.0, None)) is None
    check = following()
    assert told(check, steady(0.0, 0.0, (0.0, 0.0))) is None


@pytest.mark.parametrize("way", [5.0, -5.0])
def test_what_was_asked_before_it_followed_nothing_does_not_count_any_more(way: float) -> None:
    check = following()
    assert told(check, steady(way, way, (way, way), count=100)) is None
    assert check.look(see(0.0, 0.0, None)) is None
    assert told(check, steady(0.0, 0.0, (0.0, 0.0), count=5)) is None
    assert told(check, steady(way, 0.0, (0.0, 0.0), count=FOR)) == FOR
    assert told(check, steady(0.0, 0.0, (0.0, 0.0), count=5)) is None
    assert told(check, steady(0.0, way, (0.0, 0.0), count=FOR)) == FOR


def test_nan_velocity_while_it_begins_to_follow_faults_in_its_time() -> None:
    check = following()
    assert told(check, steady(math.nan, 0.0, (0.0, 0.0), count=FOR - 1)) is None
    assert told(check, steady(math.nan, 0.0, None)) is None
    assert told(check, steady(math.nan, 0.0, (0.0, 0.0))) == FOR
    assert told(following(), steady(math.nan, 0.0, (0.0, 0.0))) == FOR


@pytest.mark.parametrize("off", [0.25, -0.25])
@pytest.mark.parametrize(("left", "right", "asked"), [(2.0, 2.0, (1.0, 0.0)), (2.0, 4.0, (1.5, 1.0))])
def test_the_end_of_a_window_is_still_within_it(
    left: float, right: float, asked: tuple[float, float], off: float
) -> None:
    """All values are binary fractions: nothing is rounded."""
    settings = FollowingErrorSettings(
        track=1.0, wheel_radius=0.5, linear_window=0.25, angular_window=0.25, settle_s=0.5, for_s=STEP
    )
    check = FollowingError(0, 1, settings, STEP)

    def look(ahead: float, turning: float) -> str | None:
        wheels = (left + 2.0 * ahead - turning, right + 2.0 * ahead + turning)
        return check.look(View(wheels, (True, True), 1, asked))

    assert look(0.0, 0.0) is None, "it goes just as asked"
    assert look(off, 0.0) is None
    assert look(0.0, off) is None
    assert look(1.01 * off, 0.0) is not None
    assert look(0.0, 1.01 * off) is not None


def test_values_that_are_too_old_are_not_looked_at() -> None:
    check = following()
    assert told(check, steady(1.0, 0.0, (1.0, 0.0), count=100)) is None
    assert told(check, steady(2.0, 0.0, (1.0, 0.0), count=FOR - 1)) is None
    assert check.look(see(2.0, 0.0, (1.0, 0.0), valid=False)) is None
    assert told(check, steady(2.0, 0.0, (1.0, 0.0))) == FOR, "it was not forgotten what was asked"


@pytest.mark.parametrize(
    ("windows", "linear", "angular"),
    [({"linear_window": None}, 99.0, 0.5), ({"angular_window": None}, 1.0, 99.0)],
)
def test_a_velocity_without_a_window_is_not_looked_at(
    windows: dict[str, float | None], linear: float, angular: float
) -> None:
    check = following(**windows)
    assert told(check, steady(1.0, 0.5, (1.0, 0.5), count=100)) is None
    assert told(check, steady(linear, angular, (1.0, 0.5))) is None
    assert told(check, steady(angular, linear, (1.0, 0.5))) == FOR, "the other one is"


def test_one_that_may_rest_may_be_slower_than_asked_and_neither_faster_nor_backwards() -> None:
    check = following(may_rest=True)
    for asked in (2.0, -2.0):
        assert told(check, steady(0.0, 0.0, (asked, asked))) is None
        assert told(check, steady(0.5 * asked, 0.5 * asked, (asked, asked))) is None
    assert told(check, steady(2.0, 2.0, (-2.0, -2.0), count=60)) == FOR


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(
    ("linear", "angular", "is_told"),
    [
        (-0.29, 0.0, False),
        (-0.31, 0.0, True),
        (1.29, 0.0, False),
        (1.31, 0.0, True),
        (0.0, -0.74, False),
        (0.0, -0.76, True),
        (0.0, 1.74, False),
        (0.0, 1.76, True),
    ],
)
def test_one_that_may_rest_has_the_window_at_rest_and_at_what_is_asked(
    way: float,
    linear: float,
    angular: float,
    is_told: bool,  # noqa: FBT001 - a column of the table
) -> None:
    check = following(may_rest=True)
    assert told(check, steady(0.0, 0.0, (way, way), count=100)) is None
    assert told(check, steady(way * linear, way * angular, (way, way))) == (FOR if is_told else None)


def test_what_was_asked_is_remembered_as_one_would_who_kept_all_of_it() -> None:
    chance = random.Random(7)  # noqa: S311 - chance that can be repeated is what is wanted
    for _ in range(20):
        check, kept = following(for_s=STEP), [0.0]
        check.look(see(0.0, 0.0, (0.0, 0.0)))
        for _ in range(200):
            kept.append(chance.choice([chance.uniform(-5.0, 5.0), kept[-1]]))
            recent = kept[-SETTLE - 1 :]
            velocity = chance.choice(
                [min(recent) - 0.301, min(recent) - 0.299, max(recent) + 0.299, max(recent) + 0.301]
            )
            is_wrong = not min(recent) - 0.3 <= velocity <= max(recent) + 0.3
            assert (check.look(see(velocity, 0.0, (kept[-1], 0.0))) is not None) == is_wrong
