# SPDX-License-Identifier: MIT
"""When a deviation is warned of, in which words, and which of two that look alike is named."""

from collections.abc import Sequence

import pytest

from segway_ecc.node.safety.deviations import CAUSES, UNITS, Deviations

LIMITS = (0.4, 0.03, 0.008, 0.06)
NONE = (0.0, 0.0, 0.0, 0.0)
PAYLOAD, SLOPE, FRICTION, RADIUS = range(4)


def only(cause: int, size: float) -> tuple[float, ...]:
    return tuple(size if each == cause else 0.0 for each in range(4))


def judged(watch: Deviations, estimates: Sequence[float], times: int) -> list[str | None]:
    return [watch.judge(estimates, is_radius_known=True) for _ in range(times)]


@pytest.mark.parametrize(
    ("cause", "estimate", "text"),
    [
        (PAYLOAD, 0.5, "payload +0.5 kg, beyond 0.4 kg"),
        (SLOPE, -0.031234, "slope -0.0312 rad, beyond 0.03 rad"),
        (FRICTION, 0.009, "friction +0.009 N m, beyond 0.008 N m"),
        (RADIUS, -0.07, "radius -0.07 1, beyond 0.06 1"),
    ],
)
def test_it_warns_of_what_lasts_and_says_when_it_is_over(cause: int, estimate: float, text: str) -> None:
    watch = Deviations(LIMITS, 3)
    said = [*judged(watch, only(cause, estimate), 10), *judged(watch, NONE, 10)]
    begins, ends = f"the robot does not move as designed: {text}", "the robot moves as designed again: "
    assert said[2] == begins
    assert said[12] == f"{ends}{CAUSES[cause]} +0 {UNITS[cause]}"
    assert [text for text in said if text is not None] == [said[2], said[12]]


def test_whom_it_warns_of_can_be_read_until_it_is_over() -> None:
    watch = Deviations(LIMITS, 2)
    found = []
    for estimates in (NONE, only(SLOPE, 0.05), only(SLOPE, 0.05), NONE, NONE, NONE):
        watch.judge(estimates, is_radius_known=True)
        found.append(list(watch.warned))
    assert [warned[SLOPE] for warned in found] == [False, False, True, True, False, False]
    assert not any(warned[cause] for warned in found for cause in (PAYLOAD, FRICTION, RADIUS))


@pytest.mark.parametrize("cause", range(4))
@pytest.mark.parametrize(("share", "begins"), [(1.0, False), (1.0001, True), (-1.0, False), (-1.0001, True)])
def test_a_deviation_at_its_limit_is_none(cause: int, share: float, *, begins: bool) -> None:
    watch = Deviations(LIMITS, 1)
    assert (judged(watch, only(cause, share * LIMITS[cause]), 1) != [None]) is begins


@pytest.mark.parametrize("cause", range(4))
@pytest.mark.parametrize(("share", "ends"), [(0.5, False), (0.4999, True), (-0.5, False), (-0.4999, True)])
def test_a_warning_is_over_below_half_of_the_limit(cause: int, share: float, *, ends: bool) -> None:
    watch = Deviations(LIMITS, 1)
    judged(watch, only(cause, 1.1 * LIMITS[cause]), 1)
    judged(watch, only(cause, share * LIMITS[cause]), 5)
    assert watch.warned[cause] is not ends


def test_between_the_two_limits_what_was_counted_stays() -> None:
    watch, large, between = Deviations(LIMITS, 3), only(SLOPE, 0.04), only(SLOPE, 0.02)
    said = [*judged(watch, large, 2), *judged(watch, between, 5), *judged(watch, large, 1)]
    assert [text is not None for text in said] == [False] * 7 + [True]


def test_what_comes_and_goes_is_counted_up_and_down() -> None:
    watch, large = Deviations(LIMITS, 3), only(SLOPE, 0.04)
    said = [*judged(watch, large, 2), *judged(watch, NONE, 1), *judged(watch, large, 1)]
    assert said == [None] * 4
    assert judged(watch, large, 1) != [None]
    assert judged(watch, NONE, 2) == [None, None]
    assert judged(watch, large, 1) == [None]
    said = judged(watch, NONE, 3)
    assert [text is not None for text in said] == [False, True, False]


def test_two_that_begin_at_once_are_one_warning() -> None:
    (said,) = judged(Deviations(LIMITS, 1), (0.0, 0.04, 0.0, 0.07), 1)
    begins = "the robot does not move as designed: "
    assert said == f"{begins}slope +0.04 rad, beyond 0.03 rad; {begins}radius +0.07 1, beyond 0.06 1"


@pytest.mark.parametrize(
    ("beside", "is_radius_known", "named"),
    [
        (NONE, True, (True, True)),
        (NONE, False, (False, True)),
        (only(SLOPE, 0.015), True, (True, True)),
        (only(SLOPE, 0.0151), True, (False, False)),
        (only(SLOPE, -0.0151), True, (False, False)),
        (only(RADIUS, 0.0299), True, (True, True)),
        (only(RADIUS, 0.03), True, (False, True)),
        (only(RADIUS, -0.03), True, (False, True)),
    ],
)
def test_of_what_looks_alike_the_other_is_not_named(
    beside: tuple[float, ...], named: tuple[bool, bool], *, is_radius_known: bool
) -> None:
    for cause, is_named in zip((PAYLOAD, FRICTION), named, strict=True):
        watch = Deviations(LIMITS, 1)
        estimates = [other + own for other, own in zip(beside, only(cause, 2.0 * LIMITS[cause]), strict=True)]
        watch.judge(estimates, is_radius_known=is_radius_known)
        assert watch.warned[cause] is is_named


@pytest.mark.parametrize("cause", [SLOPE, RADIUS])
def test_a_slope_and_a_tyre_are_named_whatever_is_beside_them(cause: int) -> None:
    watch = Deviations(LIMITS, 1)
    watch.judge([10.0 * limit for limit in LIMITS], is_radius_known=False)
    assert watch.warned[cause]
