# SPDX-License-Identifier: MIT
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.node.safety.limiter import CommandLimiter, limit, not_finite, slew


@pytest.mark.parametrize(
    ("values", "index"),
    [
        ([], None),
        ([0.0, -1e308], None),
        ([1e308, 1e308, 1e308], None),
        ([1e308, 1e308, math.nan], 2),
        ([math.inf, -math.inf], 0),
        ([math.nan], 0),
        ([0.0, math.inf], 1),
        ([0.0, 1.0, -math.inf], 2),
        ([0.0, math.nan, math.inf], 1),
    ],
)
def test_the_first_value_that_is_not_finite_is_found(values: list[float], index: int | None) -> None:
    assert not_finite(values) == index


def test_each_command_has_its_own_limit() -> None:
    assert limit([5.0, -5.0, 5.0, -5.0, 0.0], [3.0, 3.0, 6.0, 6.0, 0.0]) == (3.0, -3.0, 5.0, -5.0, 0.0)


def test_a_limit_itself_is_still_allowed() -> None:
    assert limit([3.0, -3.0], [3.0, 3.0]) == (3.0, -3.0)


def test_a_command_without_a_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        limit([1.0, 2.0], [1.0])


@settings(derandomize=True)
@given(st.lists(st.tuples(st.floats(allow_nan=False), st.floats(0.0, 1e9))))
def test_nothing_passes_its_limit_and_nothing_within_it_is_changed(pairs: list[tuple[float, float]]) -> None:
    commands, bounds = [c for c, _ in pairs], [b for _, b in pairs]
    for (command, bound), limited in zip(pairs, limit(commands, bounds), strict=True):
        assert abs(limited) <= bound
        assert limited == command or (abs(command) > bound and math.copysign(limited, command) == limited)


def test_each_command_moves_by_no_more_than_a_step_from_what_it_was() -> None:
    assert slew([5.0, -5.0, 1.25, 0.75], [1.0, 1.0, 1.0, 1.0], 0.5) == (1.5, 0.5, 1.25, 0.75)


def test_a_command_without_a_previous_one_is_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        slew([1.0, 2.0], [1.0], 0.5)


def test_without_limits_of_its_own_only_those_of_the_drive_count() -> None:
    restraint = CommandLimiter([3.0, 9.0], None, None, 0.01)
    assert restraint.limits == (3.0, 9.0)
    assert restraint.apply([5.0, -5.0], [-3.0, 9.0]) == (3.0, -5.0)


def test_the_lower_of_the_drive_s_limit_and_the_robot_s_counts() -> None:
    restraint = CommandLimiter([3.0, 9.0], 4.0, None, 0.01)
    assert restraint.limits == (3.0, 4.0)
    assert restraint.apply([5.0, -5.0], [0.0, 0.0]) == (3.0, -4.0)


def test_the_slew_rate_is_per_second() -> None:
    restraint = CommandLimiter([30.0], None, 200.0, 0.01)
    sent: list[tuple[float, ...]] = [(0.0,)]
    for wanted in [9.0] * 6 + [-9.0] * 2:
        sent.append(restraint.apply([wanted], sent[-1]))
    assert sent[1:] == [(2.0,), (4.0,), (6.0,), (8.0,), (9.0,), (9.0,), (7.0,), (5.0,)]


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=30), st.floats(0.1, 100.0), st.floats(1.0, 1e4))
def test_neither_limit_nor_slew_is_ever_exceeded(wanted: list[float], bound: float, rate: float) -> None:
    restraint = CommandLimiter([50.0], bound, rate, 0.005)
    last = 0.0
    for value in wanted:
        (sent,) = restraint.apply([value], [last])
        assert abs(sent) <= min(bound, 50.0)
        assert abs(sent - last) <= rate * 0.005 * (1 + 1e-9)
        last = sent
