# SPDX-License-Identifier: MIT
"""From what was said and seen to how long it took."""

import pytest

from segway_ecc.hil.latency.measure import Latency, Where, quantile, took_s
from segway_ecc.hil.latency.setpoints import Timed

MS = 1_000_000


def latency(said: list[Timed], seen: list[Timed]) -> Latency:
    return Latency.of(Where.OTHER_PROCESS, "immediately", 0.01, said, seen)


def test_the_first_frame_of_each_set_point_after_its_publication_counts() -> None:
    said = [Timed(1, 100 * MS), Timed(2, 200 * MS), Timed(3, 300 * MS)]
    seen = [Timed(2, 150 * MS), Timed(1, 104 * MS), Timed(1, 114 * MS), Timed(2, 207 * MS), Timed(0, 301 * MS)]
    assert took_s(said, sorted(seen, key=lambda frame: frame.at_ns)) == pytest.approx([0.004, 0.007])
    found = latency(said, sorted(seen, key=lambda frame: frame.at_ns))
    assert (found.trials, found.missed) == (3, 1)
    assert not found.is_within


def test_quantiles_are_values_that_were_seen() -> None:
    values = [float(n) for n in range(1, 201)]
    assert (quantile(values, 0.5), quantile(values, 0.99), quantile([3.0], 0.99)) == (100.0, 198.0, 3.0)


def test_a_period_and_a_millisecond_is_the_limit() -> None:
    said = [Timed(n, 100 * n * MS) for n in range(1, 101)]
    seen = [Timed(n, 100 * n * MS + 11 * MS) for n in range(1, 101)]
    assert latency(said, seen).is_within
    assert "(1.10 periods at p99)" in latency(said, seen).text()
    late = [frame._replace(at_ns=frame.at_ns + MS) if frame.number <= 2 else frame for frame in seen]
    assert not latency(said, late).is_within
    once = [frame._replace(at_ns=frame.at_ns + MS) if frame.number <= 1 else frame for frame in seen]
    assert latency(said, once).is_within


def test_the_text_is_one_line() -> None:
    found = latency([Timed(1, 0)], [Timed(1, 5 * MS)])
    assert found.text() == (
        "other process, actuate immediately: p50 5.00 ms, p99 5.00 ms, max 5.00 ms (0.50 periods at p99) of 1 "
        "set-points, 0 missed"
    )


def test_nothing_seen_is_no_result() -> None:
    with pytest.raises(ValueError, match="no set-point came through"):
        latency([Timed(1, 0)], [])
