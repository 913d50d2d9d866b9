# SPDX-License-Identifier: MIT
import math
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import PHASES, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.testing import START_NS, WALL_START_NS, Bench

FAST, SLOW = Setpoint(2.0, 1.0), Setpoint(0.5, 0.0)
MS = 1_000_000
PERIOD = 10 * MS
FIRST_STAMP = WALL_START_NS + PERIOD


def modes(bench: Bench) -> list[Mode]:
    return [record.mode for record in bench.recorder.records]


def setpoints(bench: Bench) -> list[Setpoint]:
    return [record.setpoint for record in bench.recorder.records]


def test_a_cycle_has_its_parts_in_their_order(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(arm_at_start=False)
    bench.stage.send_request(1, Action.ARM)
    bench.clock.events[1] = bench.journal.clear
    bench.clock.events[2] = lambda: bench.journal.append("next")
    bench.loop.run(cycles=3)
    cycle = bench.journal[: bench.journal.index("next")]
    assert cycle == ["exchange", "take", "publish", "arm", "equations"]


def test_the_limit_comes_last_where_it_is_followed_by_its_own_exchange(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(actuate_immediately=True)
    bench.clock.events[1] = bench.journal.clear
    bench.clock.events[2] = lambda: bench.journal.append("next")
    bench.loop.run(cycles=3)
    assert bench.journal[: bench.journal.index("next")] == ["take", "publish", "equations", "exchange"]


def test_commands_leave_at_the_next_exchange(bench: Bench) -> None:
    bench.stage.send_setpoint(3, FAST)
    bench.loop.run(cycles=6)
    assert [record.commands for record in bench.recorder.records] == [(0.0,)] * 3 + [(21.0,)] * 3
    # One exchange at the start, then one per cycle: that of cycle 4 is the first to send what cycle 3 worked out.
    assert bench.hardware.sent == [(0.0,)] + [(0.0,)] * 4 + [(21.0,)] * 2


def test_commands_leave_at_once_where_that_is_asked_for(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(actuate_immediately=True)
    bench.stage.send_setpoint(3, FAST)
    bench.loop.run(cycles=6)
    assert bench.hardware.sent == [(0.0,)] + [(0.0,)] * 3 + [(21.0,)] * 3


@pytest.mark.parametrize(("linear", "sent"), [(2.5, 25.0), (3.0, 30.0), (3.1, 30.0), (-1e9, -30.0)])
def test_no_command_exceeds_what_the_hardware_takes(bench: Bench, linear: float, sent: float) -> None:
    bench.stage.send_setpoint(1, Setpoint(linear, 0.0))
    bench.loop.run(cycles=2)
    assert bench.recorder.records[1].commands == (sent,)


def test_the_model_is_stepped_with_what_was_measured_in_this_cycle(bench: Bench) -> None:
    bench.clock.events[2] = lambda: setattr(bench.hardware, "measured", Sensors((7.5,), (0.001,), (True,)))
    bench.loop.run(cycles=3)
    assert [record.u for record in bench.recorder.records] == [(0.0,), (0.0,), (7.5,)]


def test_the_record_holds_the_whole_cycle(bench: Bench) -> None:
    bench.hardware.measured = Sensors((7.5,), (0.001,), (True,))
    bench.stage.send_setpoint(2, FAST)
    bench.clock.late_ns[2] = 3 * MS
    bench.stage.costs_ns[2] = 2 * MS
    bench.loop.run(cycles=3)
    record = bench.recorder.records[2]
    assert (record.cycle, record.stamp_ns, record.mode) == (2, FIRST_STAMP + 2 * PERIOD, Mode.ARMED)
    assert record.lateness_ns == 3 * MS
    assert record.sensors == bench.hardware.measured
    assert (record.setpoint, record.u, record.commands) == (FAST, (7.5,), (21.0,))
    assert record.y == (21.0, pytest.approx(0.03))
    assert dict(zip(PHASES[:-1], record.durations_ns, strict=True)) == {
        "exchange": 0,
        "ros": 2 * MS,
        "decide": 0,
        "equations": 0,
        "limit": 0,
    }


def test_the_time_of_each_phase_and_of_the_whole_is_kept(bench: Bench) -> None:
    bench.stage.costs_ns[1] = 2 * MS
    bench.loop.run(cycles=3)
    summaries = {name: histogram.summary() for name, histogram in bench.cycle.histograms.items()}
    assert {name: summary.count for name, summary in summaries.items()} == dict.fromkeys(
        ("lateness", *PHASES, "cycle"), 3
    )
    assert {name for name, summary in summaries.items() if summary.max_s > 0.0} == {"ros", "cycle"}
    assert summaries["cycle"].max_s == pytest.approx(0.002)


def test_the_report_is_the_state_at_its_stamp(bench: Bench) -> None:
    bench.hardware.measured = Sensors((7.5,), (0.0,), (True,))
    bench.loop.run(cycles=3)
    assert [report.stamp_ns - FIRST_STAMP for report in bench.stage.reports] == [0, PERIOD, 2 * PERIOD]
    assert [report.values for report in bench.stage.reports] == [[0.0, 7.5], [0.01, 7.5], [0.02, 7.5]]
    assert [record.published for record in bench.recorder.records] == [r.values for r in bench.stage.reports]
    assert [report.mode for report in bench.stage.reports] == [Mode.DISARMED, Mode.ARMED, Mode.ARMED]


def test_report_is_made_only_where_anybody_subscribes(bench: Bench) -> None:
    bench.stage.wants_reports = False
    bench.loop.run(cycles=3)

    assert bench.stage.reports == []
    assert len(bench.recorder.records) == 3


def test_report_contains_the_set_point_that_came_into_force_with_its_stamp(bench: Bench) -> None:
    bench.stage.send_setpoint(1, FAST)
    bench.stage.send_setpoint(3, FAST)
    bench.loop.run(cycles=6)
    first, renewed = (StampedSetpoint(FAST, FIRST_STAMP + n * PERIOD) for n in (1, 3))
    assert [report.applied for report in bench.stage.reports] == [None, None, first, None, renewed, None]


@pytest.mark.parametrize("off_ns", [-4 * MS, 0, 4 * MS])
def test_a_stamped_set_point_comes_into_force_in_the_cycle_whose_stamp_is_nearest(bench: Bench, off_ns: int) -> None:
    bench.stage.send_setpoint(1, FAST, FIRST_STAMP + 4 * PERIOD + off_ns)
    bench.loop.run(cycles=6)
    assert setpoints(bench) == [REST] * 4 + [FAST] * 2


def test_set_point_for_a_disarmed_robot_is_refused_and_discarded(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(arm_at_start=False)
    bench.stage.send_setpoint(0, FAST)
    bench.stage.send_setpoint(1, FAST, FIRST_STAMP + 3 * PERIOD)
    bench.stage.send_request(2, Action.ARM)
    bench.loop.run(cycles=5)
    assert bench.cycle.schedule.refused == {SetpointRefusal.NOT_ARMED: 2}
    assert setpoints(bench) == [REST] * 5
    assert set(bench.hardware.sent) == {(0.0,)}


@pytest.mark.parametrize("bad", [Setpoint(math.nan, 0.0), Setpoint(0.0, math.inf), Setpoint(-math.inf, math.nan)])
def test_a_set_point_that_is_not_finite_is_refused_and_the_last_good_one_kept(bench: Bench, bad: Setpoint) -> None:
    bench.stage.send_setpoint(1, SLOW)
    bench.stage.send_setpoint(3, bad)
    bench.loop.run(cycles=5)
    assert setpoints(bench) == [REST] + [SLOW] * 4
    assert bench.cycle.schedule.refused == {SetpointRefusal.NOT_FINITE: 1}
    assert modes(bench) == [Mode.ARMED] * 5


def test_silence_means_hold_and_the_next_set_point_goes_on(bench: Bench) -> None:
    # Half a second of silence is 50 cycles: the fiftieth cycle after that of the set-point is still driven.
    bench.stage.send_setpoint(1, FAST)
    bench.stage.send_setpoint(60, SLOW)
    bench.loop.run(cycles=62)
    assert modes(bench) == [Mode.ARMED] * 52 + [Mode.HOLD] * 8 + [Mode.ARMED] * 2
    assert setpoints(bench) == [REST] + [FAST] * 51 + [REST] * 8 + [SLOW] * 2
    assert bench.hardware.armed is False  # by the end of the run, not by the hold
    assert bench.journal.count("disarm") == 1


def test_in_hold_the_model_s_commands_still_reach_the_motors(bench: Bench, script: SimpleNamespace) -> None:
    bench.stage.send_setpoint(1, FAST)
    script.outputs[60] = (-4.0, 0.0)
    bench.loop.run(cycles=62)
    assert bench.recorder.records[60].mode is Mode.HOLD
    assert bench.recorder.records[60].commands == (-4.0,)
    assert bench.hardware.sent[62] == (-4.0,)


def test_a_robot_at_rest_may_be_left_in_silence(bench: Bench) -> None:
    bench.stage.send_setpoint(1, FAST)
    bench.stage.send_setpoint(5, REST)
    bench.loop.run(cycles=200)
    assert modes(bench) == [Mode.ARMED] * 200


def test_the_first_exchange_is_zero_and_only_then_the_model_starts(bench: Bench) -> None:
    bench.loop.run(cycles=1)
    assert bench.journal[:4] == ["open", "exchange", "initial", "exchange"]
    assert bench.hardware.sent[0] == (0.0,)
    assert bench.clock.woken_ns == [START_NS + PERIOD]


def test_a_robot_that_waits_to_be_asked_arms_when_asked(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(arm_at_start=False)
    bench.stage.send_request(2, Action.ARM)
    bench.stage.send_request(3, Action.ARM)
    bench.stage.send_request(4, Action.DISARM)
    bench.loop.run(cycles=6)
    assert modes(bench) == [Mode.DISARMED] * 2 + [Mode.ARMED] * 2 + [Mode.DISARMED] * 2
    assert bench.stage.answers == [
        Answer(accepted=True, message="ARMED: asked to arm"),
        Answer(accepted=True, message="armed already"),
        Answer(accepted=True, message="DISARMED: asked to disarm"),
    ]
    assert bench.journal.count("arm") == 1


def test_arming_is_refused_with_the_reasons_of_the_hardware(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(arm_at_start=False)
    bench.hardware.reasons = ("no supply: switch it on", "no watchdog: update the board")
    bench.stage.send_request(1, Action.ARM)
    bench.loop.run(cycles=3)
    assert modes(bench) == [Mode.DISARMED] * 3
    refused = Answer(accepted=False, message="drives: no supply: switch it on; no watchdog: update the board")
    assert bench.stage.answers == [refused]


def test_self_arming_robot_retries_and_reports_the_refusal(bench: Bench) -> None:
    seen: list[str | None] = []

    def clear() -> None:
        seen.append(bench.cycle.arming.arming_refusal)
        bench.hardware.reasons = ()

    bench.hardware.reasons = ("no supply",)
    bench.clock.events[3] = clear
    bench.loop.run(cycles=5)
    assert modes(bench) == [Mode.DISARMED] * 3 + [Mode.ARMED] * 2
    assert seen == ["drives: no supply"]
    assert bench.cycle.arming.arming_refusal is None


def test_once_armed_by_itself_it_does_not_arm_itself_again(bench: Bench) -> None:
    bench.stage.send_request(2, Action.DISARM)
    bench.loop.run(cycles=6)
    assert modes(bench) == [Mode.ARMED] * 2 + [Mode.DISARMED] * 4
