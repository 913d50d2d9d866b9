# SPDX-License-Identifier: MIT
import array

from segway_ecc.hil.bench.ours import COLUMNS, SamplingClock, whole


def test_a_sample_is_taken_each_time_it_has_slept() -> None:
    before = len(SamplingClock.samples)
    clock = SamplingClock()
    deadline_ns = clock.now_ns()
    clock.sleep_until_ns(deadline_ns)
    due_ns, woken_ns, cpu_ns = SamplingClock.samples[before:]
    assert due_ns == deadline_ns <= woken_ns
    assert cpu_ns > 0


def test_what_was_not_taken_is_zero_in_the_file() -> None:
    samples = whole(array.array("q", (1, 2, 3, 4, 5, 6)))
    none = [0] * (len(COLUMNS) - 3)
    assert samples.tolist() == [1, 2, 3, *none, 4, 5, 6, *none]
