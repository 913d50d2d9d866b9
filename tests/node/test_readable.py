# SPDX-License-Identifier: MIT
import math

import pytest

from segway_ecc.node.readable import scaled_unit, short, with_unit


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (9.69712345, "9.697"),
        (-0.30000000000000004, "-0.3"),
        (1234567.0, "1235000"),
        (99999.0, "100000"),
        (1.46e-8, "0.0000000146"),
        (1e15, "1000000000000000"),
        (math.inf, "inf"),
        (math.nan, "nan"),
    ],
)
def test_a_number_has_four_digits_and_no_exponent(value: float, text: str) -> None:
    assert short(value) == text


@pytest.mark.parametrize(("value", "text"), [(1.46e-8, "0"), (-1e-6, "0"), (1.1e-6, "0.0000011")])
def test_what_is_no_larger_than_the_least_is_none(value: float, text: str) -> None:
    assert short(value, 1e-6) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (1.46e-8, "rad", "14.6 nrad"),
        (-0.0042, "m/s", "-4.2 mm/s"),
        (0.02, "N m", "0.02 N m"),
        (9999.0, "V", "9999 V"),
        (12345.0, "V", "12.35 kV"),
        (1.5e-6, "kg m2", "1.5 10\u207b\u2076 kg m2"),
        (2e5, "1", "200 10\u00b3"),
        (3.5, "1", "3.5"),
        (0.0, "m", "0 m"),
        (5e-324, "m", "0 m"),
        (1e308, "m", "100 10\u00b3\u2070\u2076 m"),
        (math.inf, "m", "inf m"),
    ],
)
def test_a_unit_has_a_prefix_where_the_number_alone_is_hard_to_read(value: float, unit: str, text: str) -> None:
    assert with_unit(value, unit) == text


def test_the_power_that_is_taken_out_is_that_of_the_prefix() -> None:
    assert scaled_unit(0.25, "m") == (0, "m")
    assert scaled_unit(0.0025, "m") == (-3, "mm")
    assert scaled_unit(2.5e4, "m2") == (3, "10\u00b3 m2")


def test_what_is_nothing_beside_others_has_no_prefix() -> None:
    assert with_unit(1.46e-8, "rad", least=1e-7) == "0 rad"
