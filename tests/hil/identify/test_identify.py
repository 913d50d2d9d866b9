# SPDX-License-Identifier: MIT
"""How an interval reads: a share of a size, and plain digits of anything else."""

import math

import pytest

from segway_ecc.hil.identify.identify import Estimate, Origin


def estimate(value: float, half_width: float, *, is_size: bool) -> Estimate:
    ends = value * math.exp(-half_width), value * math.exp(half_width)
    least, most = ends if is_size else (value - half_width, value + half_width)
    return Estimate("Some", "1", value, value, least, most, is_size, True, Origin.RUNS, ())  # noqa: FBT003 - in a table


@pytest.mark.parametrize(
    ("half_width", "is_size", "text"),
    [
        (0.1049, True, "10.5 %"),
        (1.849, True, "184.9 %"),
        (0.0012345, False, "0.0012"),
        (0.0000142, False, "0.000014"),
        (123.4, False, "120"),
        (0.0, False, "0"),
    ],
)
def test_an_interval_is_read_at_a_glance(half_width: float, text: str, *, is_size: bool) -> None:
    assert estimate(0.5, half_width, is_size=is_size).interval_text == text
