# SPDX-License-Identifier: MIT
import math
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from segway_ecc.firmware_io.devices import TURN, WrappedCounter


def test_a_turn_is_two_pi() -> None:
    assert math.tau == TURN


def _wrap(count: int, bits: int, *, signed: bool) -> int:
    """What a counter of so many bits shows."""
    shown = count & ((1 << bits) - 1)
    return shown - (1 << bits) if signed and shown >> (bits - 1) else shown


@st.composite
def _walk(draw: st.DrawFn) -> tuple[int, bool, list[int]]:
    """Draw a counter and counts of which none is half its range or more from the one before."""
    bits = draw(st.sampled_from([2, 8, 12, 14, 16, 32]))
    reach = (1 << (bits - 1)) - 1
    counts = [draw(st.integers(-(10**12), 10**12))]
    for step in draw(st.lists(st.integers(-reach, reach), max_size=30)):
        counts.append(counts[-1] + step)
    return bits, draw(st.booleans()), counts


@settings(max_examples=1_000)
@given(_walk())
def test_a_counter_is_followed_exactly_through_its_wraps(walk: tuple[int, bool, list[int]]) -> None:
    bits, signed, counts = walk
    counter = WrappedCounter(bits)
    first = _wrap(counts[0], bits, signed=signed)
    for count in counts:
        assert counter.follow(_wrap(count, bits, signed=signed)) == first + count - counts[0]
        assert counter.total == first + count - counts[0]


@pytest.mark.parametrize(
    ("raws", "totals"),
    [
        ((254, 255, 0, 1), (254, 255, 256, 257)),
        ((1, 0, 255, 254), (1, 0, -1, -2)),
        ((126, 127, -128, -127), (126, 127, 128, 129)),
        ((0, 127, 254), (0, 127, 254)),
        ((0, -127), (0, -127)),
    ],
)
def test_eight_bits_by_hand(raws: Sequence[int], totals: Sequence[int]) -> None:
    counter = WrappedCounter(8)
    assert tuple(map(counter.follow, raws)) == totals


def test_total_is_kept_over_the_first_count_after_a_resume() -> None:
    counter = WrappedCounter(8)
    counter.follow(250)
    counter.follow(5)
    assert counter.total == 261
    counter.resume()
    assert counter.total == 261
    assert counter.follow(100) == 261, "the device may have begun at another count"
    assert counter.follow(101) == 262
    assert counter.follow(95) == 256


def test_a_new_counter_stands_at_nothing() -> None:
    assert WrappedCounter(16).total == 0
