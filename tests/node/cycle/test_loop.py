# SPDX-License-Identifier: MIT
import gc
from collections import Counter
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.status import Level
from segway_ecc.node.cycle.timing import LoopCounters
from segway_ecc.node.model.sectioned import SectionedModel
from segway_ecc.testing import START_NS, WALL_START_NS, Bench, RecordingHardware

MS = 1_000_000
PERIOD = 10 * MS
FAST = Setpoint(2.0, 1.0)


def starts(bench: Bench) -> list[float]:
    """When each cycle started, in periods since the loop did."""
    return [(woken - START_NS) / PERIOD for woken in bench.clock.woken_ns]


def stamps(bench: Bench) -> list[float]:
    """The stamp of each cycle, in periods since the loop started."""
    return [(record.stamp_ns - WALL_START_NS) / PERIOD for record in bench.recorder.records]


def counts(bench: Bench) -> dict[str, int]:
    counters = bench.loop.counters
    return {name: getattr(counters, name) for name in ("cycles", "late", "overrun", "skipped")}


def test_deadlines_are_absolute_whatever_a_cycle_takes(bench: Bench) -> None:
    bench.stage.costs_ns = {n: n * MS % PERIOD for n in range(30)}
    bench.clock.late_ns = dict.fromkeys(range(0, 30, 3), 10_000)
    bench.loop.run(cycles=30)
    assert starts(bench) == [n + 1.0 + (0.001 if n % 3 == 0 else 0.0) for n in range(30)]
    assert bench.loop.timing()["lateness"].max_s == pytest.approx(10e-6)


# Costs and late waking in tenths of a period, by cycle; starts in periods. Cycle 0 is that of deadline 1.
@pytest.mark.parametrize(
    ("costs", "late", "expected_starts", "expected"),
    [
        pytest.param({}, {}, [1, 2, 3, 4], (0, 0, 0), id="punctual"),
        pytest.param({}, {1: 1}, [1, 2.1, 3, 4], (0, 0, 0), id="a tenth late is not yet late"),
        pytest.param({}, {1: 2}, [1, 2.2, 3, 4], (1, 0, 0), id="late"),
        pytest.param({1: 10}, {}, [1, 2, 3, 4], (0, 0, 0), id="ends just at the next deadline"),
        pytest.param({1: 10.5}, {}, [1, 2, 3.05, 4], (0, 1, 0), id="overrun by less than a tenth"),
        pytest.param({1: 15}, {}, [1, 2, 3.5, 4], (1, 1, 0), id="overrun"),
        pytest.param({1: 20}, {}, [1, 2, 4, 5], (0, 1, 1), id="overrun by one whole period"),
        pytest.param({1: 35}, {}, [1, 2, 5.5, 6], (1, 1, 2), id="stalled"),
        pytest.param({1: 5}, {1: 8}, [1, 2.8, 3.3, 4], (2, 1, 0), id="late and overrun"),
        pytest.param({1: 1}, {1: 10}, [1, 3, 4, 5], (1, 1, 1), id="woken a whole period late"),
        pytest.param({1: 1}, {1: 25}, [1, 4.5, 5, 6], (1, 1, 2), id="woken late by more than two periods"),
        pytest.param({1: 6}, {1: 25}, [1, 4.5, 5.1, 6], (1, 1, 2), id="woken late and then overrun"),
        pytest.param({1: 16}, {1: 25}, [1, 4.5, 6.1, 7], (1, 1, 3), id="woken late and then stalled"),
    ],
)
def test_late_overrun_and_skipped_are_counted_apart(
    bench: Bench,
    costs: dict[int, float],
    late: dict[int, float],
    expected_starts: list[float],
    expected: tuple[int, int, int],
) -> None:
    bench.stage.costs_ns = {n: round(cost * MS) for n, cost in costs.items()}
    bench.clock.late_ns = {n: round(tenths * MS) for n, tenths in late.items()}
    bench.loop.run(cycles=4)
    assert starts(bench) == expected_starts
    assert counts(bench) == dict(zip(("cycles", "late", "overrun", "skipped"), (4, *expected), strict=True))


@settings(
    derandomize=True, deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.dictionaries(st.integers(0, 7), st.integers(1, 5 * PERIOD)),
    st.dictionaries(st.integers(0, 7), st.integers(0, 5 * PERIOD)),
)
def test_no_period_sees_two_cycles_and_every_deadline_is_a_cycle_or_skipped(
    make_bench: Callable[..., Bench], costs: dict[int, int], late: dict[int, int]
) -> None:
    bench = make_bench()
    bench.stage.costs_ns = dict.fromkeys(range(12), 1) | costs  # no cycle takes no time at all
    bench.clock.late_ns = late
    bench.loop.run(cycles=12)  # the last ones are punctual again, so that none is pending at the end
    periods = [(woken - START_NS) // PERIOD for woken in bench.clock.woken_ns]
    assert len(set(periods)) == len(periods)
    assert bench.loop.counters.cycles + bench.loop.counters.skipped == periods[-1]
    lateness = [record.lateness_ns for record in bench.recorder.records]
    assert bench.loop.counters.late == sum(late_ns > PERIOD // 10 for late_ns in lateness)
    told = bench.loop.timing()["lateness"]
    assert told.max_s == pytest.approx(max(lateness) * 1e-9)
    assert told.count == 12


def test_the_mean_rate_is_that_of_the_starts(bench: Bench) -> None:
    bench.stage.costs_ns[3] = 25 * MS  # 10 cycles in the 11 periods between the first start and the last
    bench.loop.run(cycles=11)
    assert bench.loop.counters.skipped == 1
    assert bench.loop.counters.mean_rate_hz == pytest.approx(10 / 0.11)


def test_the_mean_rate_of_punctual_cycles_is_the_wanted_one(bench: Bench) -> None:
    bench.loop.run(cycles=100)
    assert bench.loop.counters.mean_rate_hz == pytest.approx(100.0, rel=1e-12)


def test_there_is_no_mean_rate_before_the_second_cycle(bench: Bench) -> None:
    assert LoopCounters().mean_rate_hz == 0.0
    bench.loop.run(cycles=1)
    assert bench.loop.counters.mean_rate_hz == 0.0


def test_stamps_are_the_wall_clock_of_the_deadlines_however_late_a_cycle_starts(bench: Bench) -> None:
    bench.clock.late_ns = {0: 3 * MS, 2: 4 * MS}
    bench.loop.run(cycles=4)
    assert stamps(bench) == [1, 2, 3, 4]


def test_stamps_follow_the_wall_clock_over_a_gap_while_nothing_waits(bench: Bench) -> None:
    bench.stage.costs_ns[1] = 35 * MS
    bench.loop.run(cycles=5)
    assert stamps(bench) == [1, 2, 5, 6, 7]
    assert bench.cycle.time_base.realigned == 1


def test_stamps_advance_by_one_period_over_a_gap_while_a_set_point_waits(bench: Bench) -> None:
    bench.stage.send_setpoint(1, FAST, WALL_START_NS + 5 * PERIOD)
    bench.stage.costs_ns[2] = 35 * MS
    bench.loop.run(cycles=7)
    # The set-point comes into force in the cycle that bears its stamp, two skipped deadlines notwithstanding.
    assert stamps(bench) == [1, 2, 3, 4, 5, 6, 7]
    assert [record.setpoint == FAST for record in bench.recorder.records] == [False] * 4 + [True] * 3


def test_stamps_follow_the_wall_clock_again_a_time_out_after_the_last_set_point_that_waited(bench: Bench) -> None:
    bench.stage.send_setpoint(1, FAST, WALL_START_NS + 5 * PERIOD)
    bench.stage.costs_ns[2] = 35 * MS
    bench.loop.run(cycles=70)
    # In force from cycle 4 on; the time-out of half a second is 50 cycles.
    assert stamps(bench) == [*range(1, 56), *range(58, 73)]
    assert bench.cycle.time_base.realigned == 1


@pytest.mark.parametrize("step", [-3_600 * 10**9, 7 * MS])
def test_stamps_follow_a_wall_clock_that_is_set(bench: Bench, step: int) -> None:
    bench.clock.events[2] = lambda: bench.clock.jump_wall(step)
    bench.loop.run(cycles=4)
    assert stamps(bench) == [1, 2, 3 + step / PERIOD, 4 + step / PERIOD]
    assert starts(bench) == [1, 2, 3, 4]


def reported(bench: Bench, suffix: str) -> list[tuple[Level, str]]:
    return [
        (status.level, status.message)
        for _, statuses in bench.stage.diagnostics
        for status in statuses
        if status.name.endswith(suffix)
    ]


def test_diagnostics_come_once_a_second(bench: Bench) -> None:
    bench.loop.run(cycles=500)
    gaps = {b[0] - a[0] for a, b in zip(bench.stage.diagnostics, bench.stage.diagnostics[1:], strict=False)}
    assert len(bench.stage.diagnostics) == 5
    assert gaps == {100 * PERIOD}
    assert bench.recorder.diagnostics == bench.stage.diagnostics
    assert set(reported(bench, ": timing")) == {(Level.OK, "100.00 Hz")}


def test_every_cycle_that_is_late_or_skipped_is_reported_once(bench: Bench) -> None:
    bench.clock.late_ns = dict.fromkeys((3, 50, 150, 151, 320), 3 * MS)
    bench.stage.costs_ns = {200: 37 * MS, 260: 26 * MS}
    bench.loop.run(cycles=400)
    bench.stage.diagnostics.append((0, bench.loop.statuses()))  # what the last report did not see yet
    told = Counter[str]()
    for level, message in reported(bench, ": timing"):
        if level is Level.WARN:
            told["missed"] += int(message.removesuffix(" late or skipped since the last report"))
    # Skipped: 2 and 1. Late: the five woken late, and the two that followed a stall in the middle of a period.
    assert counts(bench) == {"cycles": 400, "late": 7, "overrun": 2, "skipped": 3}
    assert told["missed"] == 10


def test_diagnostics_come_even_where_there_is_no_slack(bench: Bench) -> None:
    bench.stage.costs_ns = dict.fromkeys(range(1500), 9 * MS)
    bench.loop.run(cycles=1500)
    # One piece a cycle: each is complete a few cycles after it was begun, but for the last.
    assert len(bench.stage.diagnostics) == 14


def test_nothing_but_diagnostics_is_done_where_there_is_no_slack(bench: Bench) -> None:
    bench.stage.costs_ns = dict.fromkeys(range(300), 9 * MS)
    bench.loop.run(cycles=300)
    assert bench.stage.looks == 0


@pytest.mark.parametrize(
    ("busy", "takes_ns", "expected"),
    [
        pytest.param(range(0), 0, [100, 200, 300], id="once a second"),
        pytest.param(range(250), 0, [251, 300], id="later, where the cycles before leave no time"),
        pytest.param(range(0), 7 * MS, [100, 200, 300], id="just beside a quarter of the period"),
        pytest.param(range(0), 8 * MS, [], id="never, where it does not fit"),
    ],
)
def test_a_snapshot_is_taken_only_where_it_fits_before_the_next_cycle(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, busy: range, takes_ns: int, expected: list[int]
) -> None:
    taken: list[int] = []

    def write_state(take: Callable[[], Snapshot]) -> None:
        taken.append(bench.loop.counters.cycles)
        take()

    def save_state() -> bytes:
        bench.clock.spend(takes_ns)
        return b""

    monkeypatch.setattr(bench.recorder, "write_state", write_state)
    monkeypatch.setattr(bench.model, "save_state", save_state, raising=False)
    bench.stage.costs_ns = dict.fromkeys(busy, 9 * MS)
    bench.loop.run(cycles=310)
    assert taken == expected
    assert bench.loop.counters.late == bench.loop.counters.overrun == 0


def test_the_stage_looks_around_in_the_slack_only(bench: Bench) -> None:
    bench.stage.costs_ns = dict.fromkeys(range(10, 20), 9 * MS)
    looks: list[int] = []
    for cycle in (10, 20, 30):
        bench.clock.events[cycle] = lambda: looks.append(bench.stage.looks)
    bench.loop.run(cycles=31)
    before, busy, after = looks
    assert before > 0
    assert busy == before
    assert after > busy


def test_the_stage_looks_around_however_slow_the_loop() -> None:
    class Slow(SectionedModel):
        name = "slow"
        step_size = 1.0

    bench = Bench(Slow(), RecordingHardware({}, {}, ()), {})
    bench.loop.run(cycles=50)
    assert bench.stage.looks > 0


def test_timing_contains_lateness_and_phases(bench: Bench) -> None:
    bench.clock.late_ns[1] = 3 * MS
    bench.stage.costs_ns[1] = 2 * MS
    bench.loop.run(cycles=3)
    timing = bench.loop.timing()
    assert timing["lateness"].max_s == pytest.approx(0.003)
    assert timing["ros"].max_s == pytest.approx(0.002)
    assert {summary.count for summary in timing.values()} == {3}


def test_garbage_is_collected_by_hand_while_the_loop_runs_and_by_itself_after(bench: Bench) -> None:
    enabled: list[bool] = []
    bench.clock.events[1] = lambda: enabled.append(gc.isenabled())
    bench.loop.run(cycles=3)
    assert enabled == [False]
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
