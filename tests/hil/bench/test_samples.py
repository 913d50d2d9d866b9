# SPDX-License-Identifier: MIT
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from segway_ecc.hil.bench.ours import COLUMNS
from segway_ecc.hil.bench.samples import cycles_of, read_samples, spread

MS = 1_000_000
PERIOD_NS = 10 * MS


def rows(*cycles: tuple[int, int, int], bus_ns: int = 0) -> npt.NDArray[np.int64]:
    """Samples of which deadline, lateness and CPU time are given, ns."""
    return np.array([(due, due + late, cpu, bus_ns, 0, 0, 0) for due, late, cpu in cycles], dtype=np.int64)


def test_a_file_of_samples_is_read_in_rows_of_all_columns(tmp_path: Path) -> None:
    file = tmp_path / "x.samples"
    file.write_bytes(np.arange(14, dtype=np.int64).tobytes())
    assert read_samples(file).tolist() == [[0, 1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12, 13]]
    assert len(COLUMNS) == 7


@pytest.mark.parametrize("count", [0, 8])
def test_a_file_without_whole_samples_is_refused(tmp_path: Path, count: int) -> None:
    file = tmp_path / "x.samples"
    file.write_bytes(bytes(8 * count))
    with pytest.raises(ValueError, match="holds no whole samples"):
        read_samples(file)


def test_percentiles_are_values_that_occurred_and_never_too_low() -> None:
    found = spread(np.arange(1, 1001, dtype=np.int64) * 1000)  # 1 to 1000 us
    assert (found.p50_s, found.p99_s, found.max_s) == pytest.approx((501e-6, 991e-6, 1000e-6))
    assert found.p999_s == pytest.approx(1000e-6)
    assert found.mean_s == pytest.approx(500.5e-6)


def test_cost_is_what_the_thread_used_from_one_start_to_the_next() -> None:
    found = cycles_of([rows((0, 0, 5_000), (PERIOD_NS, 0, 8_000), (2 * PERIOD_NS, 0, 15_000))], PERIOD_NS, 0)
    assert (found.cost.p50_s, found.cost.max_s) == pytest.approx((7e-6, 7e-6))
    assert found.cost.mean_s == pytest.approx(5e-6)  # of 3 us and 7 us


def test_cost_is_not_counted_from_one_run_into_the_next() -> None:
    run = rows((0, 0, 0), (PERIOD_NS, 0, 3_000))
    later = rows((0, 0, 900_000), (PERIOD_NS, 0, 905_000))
    assert cycles_of([run, later], PERIOD_NS, 0).cost.max_s == pytest.approx(5e-6)


def test_the_warm_up_of_each_run_is_left_out() -> None:
    run = rows((0, 9 * MS, 0), (PERIOD_NS, 0, 1), (2 * PERIOD_NS, 0, 2))
    found = cycles_of([run, run], PERIOD_NS, 1)
    assert (found.count, found.late) == (4, 0)


def test_a_cycle_is_late_from_a_tenth_of_the_period_on() -> None:
    run = rows((0, MS, 0), (PERIOD_NS, MS + 1, 1), (2 * PERIOD_NS, 3 * MS, 2))
    found = cycles_of([run], PERIOD_NS, 0)
    assert found.late == 2
    assert not found.is_held
    assert found.lateness.max_s == pytest.approx(3e-3)


def test_deadlines_without_a_cycle_are_lost() -> None:
    run = rows((0, 0, 0), (PERIOD_NS, 0, 1), (4 * PERIOD_NS, 0, 2))
    found = cycles_of([run], PERIOD_NS, 0)
    assert (found.lost, found.late) == (2, 0)
    assert not found.is_held


def test_a_start_before_its_deadline_is_not_late_at_all() -> None:
    assert cycles_of([rows((0, -500, 0), (PERIOD_NS, -500, 1))], PERIOD_NS, 0).lateness.p50_s == 0.0


def test_parts_that_a_program_does_not_measure_are_left_out() -> None:
    assert list(cycles_of([rows((0, 0, 0), (PERIOD_NS, 0, 1), bus_ns=7)], PERIOD_NS, 0).phases) == ["bus"]


def test_where_cpu_time_is_counted_in_coarse_ticks_the_mean_is_the_typical_cost() -> None:
    ticking = rows(*((cycle * PERIOD_NS, 0, cycle // 10 * 10 * MS) for cycle in range(101)))
    fine = rows(*((cycle * PERIOD_NS, 0, cycle * 3_000) for cycle in range(101)))
    coarse = cycles_of([ticking], PERIOD_NS, 0)
    assert coarse.is_coarse
    assert coarse.typical_cost_s == pytest.approx(1e-3)
    assert cycles_of([fine], PERIOD_NS, 0).typical_cost_s == pytest.approx(3e-6)


def test_a_run_that_is_too_short_is_refused() -> None:
    with pytest.raises(ValueError, match="fewer than 3 cycles"):
        cycles_of([rows((0, 0, 0), (PERIOD_NS, 0, 1))], PERIOD_NS, 1)
