# SPDX-License-Identifier: MIT
"""A second sender of an identifier is found within cycles, and nothing that one sender does is taken for two."""

import itertools
from collections.abc import Iterable, Sequence
from typing import Final

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.sender_rate import SenderRate

MS: Final = 1_000_000
S: Final = 1_000 * MS
few = settings(max_examples=25, deadline=None)
periods = st.sampled_from([1 * MS, 2 * MS, 5 * MS, 10 * MS, 20 * MS])


def sent(period_ns: int, end_ns: int, since_ns: int = 0, mark: bytes = b"") -> list[Frame]:
    return [Frame(0x120, mark + ns.to_bytes(8, "big"), ns) for ns in range(since_ns, end_ns, period_ns)]


def alarms(frames: Iterable[Frame], exchanges_ns: Iterable[int], period_ns: int) -> list[int]:
    """When exchanges at these times find a second sender; a frame is taken in the first exchange after it arrived."""
    rate, before_ns, found = SenderRate(period_ns), 0, []
    waiting = sorted(frames, key=lambda frame: frame.received_ns)
    for now_ns in exchanges_ns:
        while waiting and waiting[0].received_ns <= now_ns:
            rate.take_frame(waiting.pop(0))
        if rate.finds_another(now_ns - before_ns):
            found.append(now_ns)
        before_ns = now_ns
    return found


def late(frames: Sequence[Frame], delays_ns: Sequence[int]) -> list[Frame]:
    """Frames that arrive later, each by its delay, in the order in which they were sent."""
    arrived, last_ns = [], 0
    for place, frame in enumerate(frames):
        last_ns = max(last_ns, frame.received_ns + delays_ns[place % len(delays_ns)])
        arrived.append(Frame(frame.arbitration_id, frame.data, last_ns))
    return arrived


@few
@given(period_ns=periods, since_ns=st.integers(1 * S, S + 20 * MS), loop_ms=st.sampled_from([5, 10]))
def test_a_second_sender_is_found_within_three_cycles_or_its_third_frame(
    period_ns: int, since_ns: int, loop_ms: int
) -> None:
    both = sent(period_ns, 2 * S) + sent(period_ns, 2 * S, since_ns, b"another")
    first_ns = alarms(both, range(0, 2 * S, loop_ms * MS), period_ns)[0]
    assert 0 <= first_ns - since_ns <= max(3 * loop_ms * MS, 2 * period_ns + loop_ms * MS)


def test_it_is_found_again_and_again_while_it_sends_and_not_after() -> None:
    another = sent(5 * MS, 2 * S, 1 * S + 2 * MS, b"another")
    found = alarms(sent(5 * MS, 3 * S) + another, range(0, 3 * S, 5 * MS), 5 * MS)
    assert found[0] == 1 * S + 10 * MS
    assert all(0 < after - before <= 15 * MS for before, after in itertools.pairwise(found))
    assert 1_980 * MS < found[-1] <= 2 * S


def test_one_at_half_the_rate_is_found_too() -> None:
    another = sent(10 * MS, 2 * S, 1 * S + 2 * MS, b"another")
    assert alarms(sent(5 * MS, 2 * S) + another, range(0, 2 * S, 10 * MS), 5 * MS)[0] <= S + 40 * MS


def test_a_second_device_that_sends_the_same_again_and_again_is_found() -> None:
    another = [Frame(0x120, b"at rest", ns) for ns in range(1 * S + 2 * MS, 2 * S, 5 * MS)]
    assert alarms(sent(5 * MS, 2 * S) + another, range(0, 2 * S, 5 * MS), 5 * MS)[0] <= S + 15 * MS


@few
@given(
    period_ns=periods,
    jitter=st.lists(st.floats(0.0, 0.6), min_size=1, max_size=40),
    late_loop=st.lists(st.floats(0.0, 0.9), min_size=1, max_size=40),
    loop_ms=st.sampled_from([1, 5, 10]),
    fast=st.sampled_from([1.0, 1.001, 1.03]),
)
def test_jitter_of_bus_and_loop_and_a_fast_clock_are_no_second_sender(
    period_ns: int, jitter: list[float], late_loop: list[float], loop_ms: int, fast: float
) -> None:
    frames = late(sent(round(period_ns / fast), 3 * S), [round(part * period_ns) for part in jitter])
    exchanges = [
        ns + round(late_loop[place % len(late_loop)] * loop_ms * MS)
        for place, ns in enumerate(range(0, 3 * S, loop_ms * MS))
    ]
    assert alarms(frames, exchanges, period_ns) == []


@few
@given(period_ns=periods, lost=st.sets(st.integers(0, 2_999), max_size=300), loop_ms=st.sampled_from([5, 10]))
def test_lost_frames_are_no_second_sender(period_ns: int, lost: set[int], loop_ms: int) -> None:
    frames = [frame for place, frame in enumerate(sent(period_ns, 3 * S)) if place not in lost]
    assert alarms(frames, range(0, 3 * S, loop_ms * MS), period_ns) == []


def test_of_one_frame_lost_in_a_hundred_a_second_sender_does_not_profit() -> None:
    frames = [frame for place, frame in enumerate(sent(5 * MS, 10 * S)) if place % 100]
    for since_ns in range(5 * S, 6 * S, 37 * MS):
        both = frames + sent(5 * MS, 10 * S, since_ns, b"another")
        assert alarms(both, range(0, 10 * S, 5 * MS), 5 * MS)[0] - since_ns <= 25 * MS


@few
@given(
    period_ns=periods,
    stalls=st.lists(st.tuples(st.integers(100, 2_800), st.integers(1, 100)), max_size=5),
    has_stamps=st.booleans(),
)
@example(period_ns=5 * MS, stalls=[(1_000, 100)], has_stamps=False)
def test_a_loop_that_stalls_finds_what_has_queued(
    period_ns: int, stalls: list[tuple[int, int]], *, has_stamps: bool
) -> None:
    exchanges = [
        ns for ns in range(0, 3 * S, 5 * MS) if not any(at * MS <= ns < (at + length) * MS for at, length in stalls)
    ]
    rate, before_ns, waiting = SenderRate(period_ns), 0, sent(period_ns, 3 * S)
    for now_ns in exchanges:
        while waiting and waiting[0].received_ns <= now_ns:
            frame = waiting.pop(0)
            # Without a stamp of its own a frame has that of the exchange before.
            rate.take_frame(frame if has_stamps else Frame(frame.arbitration_id, frame.data, before_ns))
        assert not rate.finds_another(now_ns - before_ns)
        before_ns = now_ns


@few
@given(
    period_ns=periods,
    gap_ms=st.integers(1, 900),
    spread=st.floats(0.0, 0.5),
    every_ms=st.sampled_from([1_000, 1_400]),
)
def test_frames_of_a_gap_may_come_together_after_it(period_ns: int, gap_ms: int, spread: float, every_ms: int) -> None:
    """A bus that was off and has recovered; the frames leave their queue at once, or at a higher rate than usual."""
    frames = sent(period_ns, 5 * S)
    delays_ns = [0] * len(frames)
    for begun_ns in range(1 * S, 5 * S, every_ms * MS):
        end_ns = begun_ns + gap_ms * MS
        for place, frame in enumerate(frames):
            if begun_ns <= frame.received_ns:
                behind_ns = round(spread * (frame.received_ns - begun_ns))
                delays_ns[place] = max(delays_ns[place], end_ns + behind_ns - frame.received_ns)
    assert alarms(late(frames, delays_ns), range(0, 5 * S, 5 * MS), period_ns) == []


@few
@given(period_ns=periods, gap_ms=st.integers(1, 900))
def test_frames_of_a_gap_may_be_lost_and_a_second_sender_is_found_later(period_ns: int, gap_ms: int) -> None:
    frames = [f for f in sent(period_ns, 6 * S) if not 1 * S <= f.received_ns < S + gap_ms * MS]
    assert alarms(frames, range(0, 6 * S, 5 * MS), period_ns) == []
    both = frames + sent(period_ns, 6 * S, 5 * S, b"another")
    assert alarms(both, range(0, 6 * S, 5 * MS), period_ns)[0] - 5 * S <= max(20 * MS, 4 * period_ns)


@pytest.mark.parametrize("late_ms", [2, 4, 5, 7, 10, 20, 30])
def test_frames_that_are_late_for_a_while_and_then_not_any_more(late_ms: int) -> None:
    frames = sent(5 * MS, 5 * S)
    delays_ns = [late_ms * MS if f.received_ns % (200 * MS) >= 170 * MS else 0 for f in frames]
    assert alarms(late(frames, delays_ns), range(0, 5 * S, 5 * MS), 5 * MS) == []


@pytest.mark.parametrize("back", [0, 1])
def test_frames_that_are_repeated_on_the_way_are_no_second_sender(back: int) -> None:
    frames = sent(5 * MS, 3 * S)
    copies = [Frame(0x120, frames[max(0, n - back)].data, f.received_ns + 1) for n, f in enumerate(frames)]
    assert alarms(frames + copies, range(0, 3 * S, 5 * MS), 5 * MS) == []


def test_what_was_queued_before_the_first_exchange_does_not_count() -> None:
    rate = SenderRate(5 * MS)
    for frame in sent(5 * MS, 2 * S):
        rate.take_frame(frame)
    rate.begin()
    for frame in sent(5 * MS, 3 * S, 2 * S):
        rate.take_frame(frame)
        assert not rate.finds_another(5 * MS)
