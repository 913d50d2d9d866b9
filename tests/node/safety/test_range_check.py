# SPDX-License-Identifier: MIT
import math

import pytest

from segway_ecc.node.safety.check import Signal, View
from segway_ecc.node.safety.range_check import RangeCheck

SUPPLY = RangeCheck(Signal("supply.voltage", 1), 20.0, 30.0, "V")


def look(value: float, *, valid: bool = True) -> str | None:
    return SUPPLY.look(View((99.0, value), (True, valid), 1))


@pytest.mark.parametrize("value", [20.0, 25.0, 30.0])
def test_the_window_and_its_ends_are_allowed(value: float) -> None:
    assert look(value) is None


def test_value_out_of_range_is_reported_with_the_range() -> None:
    assert look(19.99) == "supply.voltage is 19.99 V, allowed is 20 to 30 V"
    assert look(30.01) == "supply.voltage is 30.01 V, allowed is 20 to 30 V"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_outside(value: float) -> None:
    assert look(value) is not None


def test_a_value_that_is_not_valid_is_not_looked_at() -> None:
    assert look(99.0, valid=False) is None
    assert SUPPLY.needs == (1,)
