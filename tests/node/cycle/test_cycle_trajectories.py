# SPDX-License-Identifier: MIT
"""A whole manoeuvre in the cycle: what may change it, and what may not."""

from collections.abc import Callable

import pytest

from segway_ecc.node.cycle.setpoints import REST, Setpoint, SetpointRefusal
from segway_ecc.node.cycle.trajectory import CANCEL, TimedSetpoint, Trajectory, TrajectoryState
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.settings import StationSettings
from segway_ecc.testing import WALL_START_NS, Bench, SetpointLimits

FAST, SLOW = Setpoint(2.0, 1.0), Setpoint(0.5, 0.0)
PERIOD_NS = 10_000_000
FIRST_STAMP_NS = WALL_START_NS + PERIOD_NS
WHOLE = Trajectory(0, (TimedSetpoint(0, FAST), TimedSetpoint(3 * PERIOD_NS, SLOW), TimedSetpoint(5 * PERIOD_NS, REST)))


def setpoints(bench: Bench) -> list[Setpoint]:
    return [record.setpoint for record in bench.recorder.records]


def test_a_trajectory_is_followed_without_anything_else_arriving(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(setpoints=SetpointLimits(timeout=2))
    bench.stage.send_trajectory(2, WHOLE)
    bench.loop.run(cycles=10)
    assert setpoints(bench) == [REST] * 2 + [FAST] * 3 + [SLOW] * 2 + [REST] * 3
    assert {record.mode for record in bench.recorder.records[1:]} == {Mode.ARMED}


def test_a_trajectory_with_a_stamp_begins_in_the_cycle_of_that_stamp(bench: Bench) -> None:
    bench.stage.send_trajectory(1, WHOLE._replace(stamp_ns=FIRST_STAMP_NS + 4 * PERIOD_NS))
    bench.loop.run(cycles=6)
    assert setpoints(bench) == [REST] * 4 + [FAST] * 2


def test_skipped_deadlines_change_no_cycle_of_it(make_bench: Callable[..., Bench]) -> None:
    quiet, busy = make_bench(), make_bench()
    busy.stage.costs_ns[4] = 7 * PERIOD_NS
    for bench in (quiet, busy):
        bench.stage.send_trajectory(2, WHOLE)
        bench.loop.run(cycles=10)
    assert busy.loop.counters.skipped > 0
    assert setpoints(busy) == setpoints(quiet)
    assert [record.y for record in busy.recorder.records] == [record.y for record in quiet.recorder.records]


@pytest.mark.parametrize("stamp", [None, FIRST_STAMP_NS + 4 * PERIOD_NS])
def test_set_points_that_arrive_meanwhile_are_refused_and_counted(bench: Bench, stamp: int | None) -> None:
    bench.stage.send_trajectory(2, WHOLE)
    bench.stage.send_setpoint(3, Setpoint(-1.0, 0.0), stamp)
    bench.loop.run(cycles=8)
    assert setpoints(bench) == [REST] * 2 + [FAST] * 3 + [SLOW] * 2 + [REST]
    assert bench.cycle.schedule.refused == {SetpointRefusal.FOLLOWS_TRAJECTORY: 1}


def test_set_points_that_wait_for_their_time_are_discarded_by_it(bench: Bench) -> None:
    bench.stage.send_setpoint(1, Setpoint(-1.0, 0.0), FIRST_STAMP_NS + 8 * PERIOD_NS)
    bench.stage.send_trajectory(2, WHOLE)
    bench.loop.run(cycles=10)
    assert setpoints(bench)[7:] == [REST] * 3


def test_what_is_refused_is_counted_and_reported_with_its_reason(bench: Bench) -> None:
    bench.stage.send_trajectory(2, WHOLE._replace(points=WHOLE.points[:2]))
    bench.loop.run(cycles=5)
    assert set(setpoints(bench)) == {REST}
    assert bench.cycle.schedule.refused == {SetpointRefusal.MALFORMED: 1}
    (refused,) = filter(None, (report.refused_trajectory for report in bench.stage.reports))
    assert refused.reason == "its last point, which is its end, is not at rest"


def test_each_of_several_that_are_refused_in_one_cycle_is_reported_once_and_in_order(bench: Bench) -> None:
    for offset in range(3):
        bench.stage.send_trajectory(2, Trajectory(FIRST_STAMP_NS + offset * PERIOD_NS, WHOLE.points[:2]))
    bench.stage.send_trajectory(2, WHOLE)
    bench.loop.run(cycles=9)
    reported = [report.refused_trajectory for report in bench.stage.reports]
    offsets = [each and (each.stamp_ns - FIRST_STAMP_NS) // PERIOD_NS for each in reported]
    assert offsets == [None] * 3 + [0, 1, 2] + [None] * 3
    assert bench.cycle.trajectories.status.state is TrajectoryState.DONE


def test_a_cancelled_trajectory_brings_the_robot_to_rest_at_once(bench: Bench) -> None:
    bench.stage.send_trajectory(2, WHOLE)
    bench.stage.send_trajectory(4, CANCEL)
    bench.stage.send_setpoint(5, SLOW)
    bench.loop.run(cycles=6)
    assert setpoints(bench) == [REST] * 2 + [FAST] * 2 + [REST, SLOW]


def test_the_same_sent_again_changes_nothing(bench: Bench) -> None:
    stamped = WHOLE._replace(stamp_ns=FIRST_STAMP_NS + 3 * PERIOD_NS)
    for cycle in (2, 3, 5, 9):
        bench.stage.send_trajectory(cycle, stamped)
    bench.loop.run(cycles=11)
    assert setpoints(bench) == [REST] * 3 + [FAST] * 3 + [SLOW] * 2 + [REST] * 3
    assert not bench.cycle.schedule.refused


@pytest.mark.parametrize("action", [Action.STOP, Action.DISARM])
def test_whoever_stops_the_robot_ends_its_trajectory_for_good(bench: Bench, action: Action) -> None:
    bench.stage.send_trajectory(2, WHOLE)
    bench.stage.send_request(4, action)
    for cycle, again in enumerate((Action.CLEAR_FAULT, Action.ARM), start=5):
        bench.stage.send_request(cycle, again)
    bench.loop.run(cycles=10)
    assert setpoints(bench)[4:] == [REST] * 6
    status = bench.stage.reports[-1].trajectory
    assert status.state is TrajectoryState.ABORTED
    assert status.reason.startswith("the robot went to ")


def test_a_robot_that_is_not_armed_refuses_it(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(arm_at_start=False)
    bench.stage.send_trajectory(2, WHOLE)
    bench.loop.run(cycles=4)
    assert bench.cycle.schedule.refused == {SetpointRefusal.NOT_ARMED: 1}


def test_a_base_station_that_is_lost_holds_and_the_rest_is_not_driven_when_it_is_back(
    make_bench: Callable[..., Bench],
) -> None:
    bench = make_bench(station=StationSettings(timeout_s=0.02, names=("base",)))
    for cycle in (0, 1, 2, 3, 8, 9, 10, 11):
        bench.stage.send_heartbeat(cycle)
    long = Trajectory(0, (TimedSetpoint(0, FAST), TimedSetpoint(100 * PERIOD_NS, REST)))
    bench.stage.send_trajectory(2, long)
    bench.loop.run(cycles=12)
    modes = [record.mode for record in bench.recorder.records]
    assert Mode.HOLD in modes
    lost = modes.index(Mode.HOLD)
    assert setpoints(bench) == [REST] * 2 + [FAST] * (lost - 2) + [REST] * (12 - lost)
    assert modes[-1] is Mode.ARMED
    assert bench.stage.reports[-1].trajectory.reason == "the robot went to HOLD: the base station is lost"


def test_a_robot_that_is_driven_rests_from_the_acceptance_to_the_start(bench: Bench) -> None:
    bench.stage.send_setpoint(1, Setpoint(-1.0, 0.0))
    bench.stage.send_trajectory(3, WHOLE._replace(stamp_ns=FIRST_STAMP_NS + 6 * PERIOD_NS))
    bench.loop.run(cycles=8)
    assert setpoints(bench) == [REST, *[Setpoint(-1.0, 0.0)] * 2, *[REST] * 3, FAST, FAST]


def test_a_robot_that_is_disarmed_and_armed_within_one_cycle_does_not_go_on(bench: Bench) -> None:
    bench.stage.send_trajectory(2, WHOLE)
    for action in (Action.DISARM, Action.ARM):
        bench.stage.send_request(4, action)
    bench.loop.run(cycles=8)
    assert setpoints(bench)[4:] == [REST] * 4
    assert bench.stage.reports[-1].trajectory.state is TrajectoryState.ABORTED
