# SPDX-License-Identifier: MIT
"""Where a cost stops being linear."""

import pytest

from segway_ecc.hil.growth.cost import Measured, line


def points(*costs: float, spread: float = 0.5) -> list[Measured]:
    return [Measured(size, cost, spread) for size, cost in zip((1, 2, 4, 8, 16, 32), costs, strict=False)]


def test_a_line_goes_through_all_that_is_on_it() -> None:
    found = line(points(12, 14, 18, 26, 42, 74))
    assert found.at_zero == pytest.approx(10.0)
    assert found.per_one == pytest.approx(2.0)
    assert (found.up_to, found.left_at, found.off) == (32, None, 0.0)


def test_the_first_size_that_is_off_by_more_than_the_spread_is_reported_and_laid_through_no_more() -> None:
    found = line(points(12, 14, 18, 26, 43.0, 90))
    assert (found.up_to, found.left_at) == (8, 16)
    assert found.off == pytest.approx(1.0)
    assert found.per_one == pytest.approx(2.0)


def test_within_the_spread_of_the_size_or_of_the_line_is_on_it() -> None:
    assert line(points(12, 14, 18, 26.4)).left_at is None
    assert line([*points(12, 14, 18, 26), Measured(16, 52, 10.5)]).left_at is None
    assert line([*points(12, 14, 18, 26), Measured(16, 52, 9.5)]).left_at == 16
    assert line(points(12, 14, 18, 26, 52, spread=10.0)).left_at is None


def test_one_that_is_off_while_the_next_is_on_is_chance() -> None:
    found = line(points(12, 14, 18, 40, 42, 74))
    assert (found.left_at, found.up_to) == (None, 32)
    assert found.per_one == pytest.approx(2.0)


def test_less_than_the_line_gives_is_off_it_too() -> None:
    assert line(points(12, 14, 18, 18, 18)).left_at == 8


def test_the_spread_is_at_least_the_distance_of_what_it_was_laid_through() -> None:
    # Least squares through (1, 0), (2, 3), (4, 0) by hand: slope -1.5/7, mean 1 at 7/3.
    found = line([Measured(1, 0, 0.0), Measured(2, 3, 0.0), Measured(4, 0, 0.0)])
    assert found.per_one == pytest.approx(-1.5 / 7)
    assert found.spread == pytest.approx(3 - (1 + 1.5 / 7 * (7 / 3 - 2)))


def test_a_line_begins_with_as_many_as_differ_by_more_than_their_spread() -> None:
    """Else the first three, which fall here by chance, would be told to cost less and less."""
    found = line(points(13.0, 12.6, 12.3, 13.4, 15.8, 19.0))
    assert found.per_one == pytest.approx(0.21, abs=0.01)
    assert (found.up_to, found.left_at) == (32, None)
    assert line(points(13.0, 12.6, 12.3, 13.4, 15.8, 26.0)).left_at == 32


def test_two_sizes_are_no_line() -> None:
    with pytest.raises(ValueError, match="2 sizes are too few"):
        line(points(1, 2))
