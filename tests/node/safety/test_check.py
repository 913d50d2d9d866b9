# SPDX-License-Identifier: MIT
"""What a check sees of a cycle, and durations in periods."""

import pytest

from segway_ecc.node.safety.check import View, periods_in

VIEW = View((1.0, 2.0, 3.0, 4.0), (True, False, True, True), 1)


@pytest.mark.parametrize(
    ("indices", "may_be_used"),
    [([0], True), ([0, 2, 3], True), ([], True), ([1], False), ([0, 1], False), ([1, 0], False), ([2, 1, 3], False)],
)
def test_signals_may_be_used_only_where_each_of_them_is_valid(indices: list[int], may_be_used: bool) -> None:  # noqa: FBT001 - a column of the table
    assert VIEW.has(indices) is may_be_used


@pytest.mark.parametrize("indices", [[0], [0, 1, 2], []])
def test_where_every_signal_is_valid_any_of_them_may_be_used(indices: list[int]) -> None:
    assert View((1.0, 2.0, 3.0), [True] * 3, 1).has(indices)


@pytest.mark.parametrize(("duration", "periods"), [(0.1, 20), (0.001, 1), (0.012, 2), (0.013, 3)])
def test_a_duration_is_at_least_one_period(duration: float, periods: int) -> None:
    assert periods_in(duration, 0.005) == periods


def test_nobody_balances_or_idles_of_whom_it_is_not_said() -> None:
    view = View((), (), 1)
    assert (view.balances, view.is_idle, view.spins) == (False, False, False)
