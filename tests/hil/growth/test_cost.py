# SPDX-License-Identifier: MIT
"""What is made of the CPU time of cycles."""

import pytest

from segway_ecc.hil.growth.cost import Cost, cost_of, together


def test_the_median_p99_and_the_spread_of_the_parts() -> None:
    taken = [1000] * 40 + [2000] * 40 + [3000] * 40 + [3000] * 40 + [9000] * 40
    cost = cost_of(taken, {"mode": "ARMED"})
    assert (cost.p50_us, cost.p99_us, cost.spread_us, cost.notes) == (3.0, 9.0, 8.0, {"mode": "ARMED"})
    assert cost_of([1000] * 98 + [5000] * 2).p99_us == 5.0
    assert cost_of([1000] * 99 + [5000]).p99_us == 5.0
    assert cost_of([1000] * 199 + [5000]).p99_us == 1.0


def test_fewer_cycles_than_parts_are_too_few() -> None:
    with pytest.raises(ValueError, match="4 cycles are too few"):
        cost_of([1, 2, 3, 4])


def test_of_several_the_worst_p99_and_the_larger_spread() -> None:
    one = Cost(p50_us=10.0, p99_us=20.0, spread_us=1.0, notes={"a": "1"})
    two = Cost(p50_us=12.0, p99_us=50.0, spread_us=0.5, notes={"a": "2"})
    both = together([one, two])
    assert (both.p50_us, both.p99_us, both.spread_us, both.notes) == (11.0, 50.0, 2.0, {"a": "2"})
    assert together([one]).spread_us == 1.0
