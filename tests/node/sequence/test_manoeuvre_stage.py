# SPDX-License-Identifier: MIT
from collections.abc import Sequence

import pytest

from segway_ecc.node.cycle.interfaces import Inbox, Report
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory, TrajectoryState, TrajectoryStatus
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.manoeuvre import ManoeuvreStage, Odometry, Player, single_segment
from segway_ecc.testing import WALL_START_NS, ScriptedClock

MS = 1_000_000
EPOCH = 1_700_000_000_000_000_000
AHEAD = Setpoint(1.0, 0.5)
SIGNALS = ("odometry.y", "left.angle", "odometry.x", "odometry.heading", "odometry.linear_velocity")


@pytest.fixture
def clock() -> ScriptedClock:
    return ScriptedClock()


@pytest.fixture
def stage(clock: ScriptedClock) -> ManoeuvreStage:
    return ManoeuvreStage(Player(single_segment(1.0, 0.5, 0.15)), SIGNALS, clock, lead_ns=50 * MS)


TRAJECTORY = Trajectory(EPOCH + 50 * MS, (TimedSetpoint(0, AHEAD), TimedSetpoint(150 * MS, REST)))
START = EPOCH + 50 * MS
ACCEPTED = TrajectoryStatus(START, TrajectoryState.ACCEPTED, "", START, EPOCH + 200 * MS, 15, TRAJECTORY.digest)


def report(ms: int, mode: Mode = Mode.ARMED, values: Sequence[float] = (0.0,) * 5) -> Report:
    """The robot, which accepts what it is asked at once."""
    return Report(EPOCH + ms * MS, mode, values, None, trajectory=ACCEPTED)


@pytest.mark.parametrize("mode", [Mode.DISARMED, Mode.FAULT])
def test_it_waits_until_the_robot_is_armed(stage: ManoeuvreStage, mode: Mode) -> None:
    for ms in range(0, 1000, 10):
        stage.publish(report(ms, mode))
        assert stage.take_inbox() == Inbox()
    assert stage.over is None
    assert stage.player.start_ns is None


@pytest.mark.parametrize("mode", [Mode.ARMED, Mode.HOLD])
def test_it_sends_the_manoeuvre_whole_and_once_and_then_is_over(stage: ManoeuvreStage, mode: Mode) -> None:
    taken: list[Trajectory] = []
    over: list[int] = []
    for ms in range(0, 240, 10):
        inbox = stage.take_inbox()
        assert (inbox.requests, inbox.setpoints) == ([], [])
        taken += inbox.trajectories
        stage.publish(report(ms, mode))
        if stage.over is not None:
            over.append(ms)
    assert taken == [TRAJECTORY]
    assert over == [200, 210, 220, 230]
    assert stage.over == "the sequence is over"
    assert not stage.is_broken_off


def test_the_start_is_reported_on_the_wall_clock_which_skipped_deadlines_leave_behind(
    stage: ManoeuvreStage, clock: ScriptedClock
) -> None:
    starts = []
    for ms in range(0, 100, 10):
        # Three deadlines are skipped before the start, which the stamps do not count.
        clock.spend((40 if ms == 20 else 10) * MS)
        stage.take_inbox()
        stage.publish(report(ms))
        starts.append(stage.started_wall_ns)
    assert starts == [None] * 5 + [WALL_START_NS + 90 * MS] * 5


def test_what_is_published_reaches_the_player_in_its_order_and_what_is_not_counts_as_zero(
    stage: ManoeuvreStage,
) -> None:
    stage.publish(report(0))
    stage.take_inbox()
    stage.publish(report(50, values=(2.0, 9.0, 1.0, 3.0, 4.0)))
    assert stage.player.received == [Odometry(EPOCH + 50 * MS, 1.0, 2.0, 3.0, 4.0, 0.0)]


def test_a_robot_that_leaves_armed_breaks_the_sequence_off(stage: ManoeuvreStage) -> None:
    stage.publish(report(0))
    stage.take_inbox()
    stage.publish(report(10, Mode.FAULT))
    assert (stage.over, stage.is_broken_off) == ("the robot left the sequence", True)


def test_a_refusal_ends_it_with_the_robot_s_reason(stage: ManoeuvreStage) -> None:
    stage.publish(report(0))
    stage.take_inbox()
    refused = ACCEPTED._replace(state=TrajectoryState.REFUSED, reason="it asks for 1 m/s; at most 0.5 m/s is allowed")
    stage.publish(Report(EPOCH, Mode.ARMED, (0.0,) * 5, None, refused_trajectory=refused))
    assert stage.over == "the robot refused the sequence: it asks for 1 m/s; at most 0.5 m/s is allowed"
    assert stage.is_broken_off
