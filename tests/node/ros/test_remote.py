# SPDX-License-Identifier: MIT
"""The loop's side of ROS, with its process: it never waits, and counts what was lost."""

import os
import signal
import time
from collections.abc import Callable, Iterator

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import (
    LONGEST_REASON,
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.ring import RingReader, RingWriter, open_ring, slots_for
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.ros.process import Subscriptions
from segway_ecc.node.ros.protocol import ToLoop, TrajectoryPart, decode_report, encoder
from segway_ecc.node.ros.remote import INBOX_SLOTS, RemoteStage, RosBridge
from segway_ecc.node.ros.stage import LONGEST_NAME
from segway_ecc.node.safety.modes import Mode

pytestmark = pytest.mark.ros

WITHIN_S = 30.0


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, ros_environment: dict[str, str]) -> None:
    for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR"):
        monkeypatch.setenv(name, ros_environment[name])


@pytest.fixture
def bridge() -> Iterator[RosBridge]:
    bridge = RosBridge()
    yield bridge
    bridge.close()


@pytest.fixture
def robot() -> Robot:
    return build_robot(load_robot("cart"), RealClock())


@pytest.fixture
def stage(bridge: RosBridge, robot: Robot) -> Iterator[RemoteStage]:
    stage = RemoteStage(bridge, robot)
    yield stage
    stage.close()


def report(cycle: int, reason: str = "") -> Report:
    return Report(time.time_ns(), Mode.ARMED, [0.0] * 9, None, cycle=cycle, reason=reason, at_ns=time.monotonic_ns())


def publish(stage: RemoteStage, count: int) -> None:
    for cycle in range(count):
        stage.publish(report(cycle))


def wait_for(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def test_a_process_that_is_stopped_holds_nothing_up_and_what_is_lost_is_counted(
    stage: RemoteStage, bridge: RosBridge, caplog: pytest.LogCaptureFixture
) -> None:
    os.kill(bridge.pid, signal.SIGSTOP)
    os.waitpid(bridge.pid, os.WUNTRACED)
    publish(stage, 1000)
    lost = stage.dropped
    assert 0 < lost <= 1000 - 64
    os.kill(bridge.pid, signal.SIGCONT)
    wait_for(lambda: stage._reports.held() == 0)
    publish(stage, 64)
    assert stage.dropped == lost
    wait_for(lambda: stage._reports.held() == 0)
    stage.close()
    assert f"{lost} messages to or from ROS did not get through: its process did not keep up" in caplog.text


def test_a_reason_of_any_length_is_published(stage: RemoteStage) -> None:
    stage.publish(report(1, "\u00e4" * 100_000))
    assert stage.dropped == 0


def test_the_longest_report_there_is_gets_through(stage: RemoteStage, robot: Robot) -> None:
    memory = open_ring(slots_for(6000))
    stage._reports, process = RingWriter(memory), RingReader(memory)
    os.close(memory)
    character, number = "\U0001f916", 2**63 - 1  # of four bytes, and of nine
    longest = Report(
        number,
        Mode.DISARMED,
        [0.1] * len(robot.wiring.published),
        StampedSetpoint(Setpoint(0.1, 0.1), number),
        [0.1] * len(robot.wiring.topics),
        character * 1_000_000,
        number,
        "unconfirmed",
        is_zero=False,
        heartbeat=Heartbeat(character * LONGEST_NAME, number),
        heartbeat_age_ns=number,
        set_values=[0.1] * len(robot.wiring.set_names),
        at_ns=number,
        trajectory=TrajectoryStatus(number, TrajectoryState.FOLLOWED, character * LONGEST_REASON, number, number),
        refused_trajectory=TrajectoryStatus(number, TrajectoryState.REFUSED, "x" * LONGEST_REASON, 0, 0),
    )
    stage.publish(longest)
    taken = process.take_message()

    assert stage.dropped == 0
    assert taken is not None
    assert decode_report(taken[1]) == replace(longest, reason=character * 900)


@pytest.mark.parametrize("count", [0, 1, 50, 51, MOST_POINTS + 1])
def test_a_trajectory_reaches_the_loop_whole_however_many_parts_it_has(
    stage: RemoteStage, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory = open_ring(INBOX_SLOTS)
    process, stage._inboxes = RingWriter(memory), RingReader(memory)
    points = tuple(TimedSetpoint(2**40 + n, Setpoint(0.1 * n, -0.3)) for n in range(count))
    inbox, found = Inbox(), Inbox()
    inbox.trajectories.append(Trajectory(2**60, points))
    # Where the ring is full the process waits, and the loop goes on: a cycle takes what fits.
    monkeypatch.setattr("time.sleep", lambda _: found.trajectories.extend(stage.take_inbox().trajectories))
    Subscriptions(process, 10_000_000).hand_over(inbox)
    os.close(memory)
    found.trajectories.extend(stage.take_inbox().trajectories)
    assert found.trajectories == inbox.trajectories
    assert stage.dropped == 0


def test_of_a_trajectory_whose_parts_end_early_nothing_is_followed(stage: RemoteStage) -> None:
    memory = open_ring(INBOX_SLOTS)
    process, stage._inboxes = RingWriter(memory), RingReader(memory)
    os.close(memory)
    whole = TrajectoryPart(2, (TimedSetpoint(0, Setpoint(0.0, 0.0)),), begin=0, total=1)
    for part in (TrajectoryPart(1, whole.points, begin=0, total=2), whole):
        assert process.put(ToLoop.TRAJECTORY, encoder.encode(part))
    assert stage.take_inbox().trajectories == [Trajectory(2, tuple(whole.points))]


@pytest.mark.parametrize("begins", [(0, 2), (1, 2)])
def test_a_trajectory_that_lacks_a_part_is_discarded_and_counted(stage: RemoteStage, begins: tuple[int, ...]) -> None:
    memory = open_ring(INBOX_SLOTS)
    process, stage._inboxes = RingWriter(memory), RingReader(memory)
    os.close(memory)
    for begin in begins:
        part = TrajectoryPart(1, (TimedSetpoint(begin, Setpoint(0.0, 0.0)),), begin, total=3)
        assert process.put(ToLoop.TRAJECTORY, encoder.encode(part))
    assert stage.take_inbox().trajectories == []
    assert stage.dropped
    stage.dropped = 0


def test_the_process_reports_whether_there_are_subscribers(stage: RemoteStage) -> None:
    memory = open_ring(INBOX_SLOTS)
    process, stage._inboxes = RingWriter(memory), RingReader(memory)
    os.close(memory)
    for is_heard in (False, True, False):
        assert process.put(ToLoop.SUBSCRIBED, encoder.encode(is_heard))
        assert stage.take_inbox() == Inbox()
        assert stage.wants_reports is is_heard
    assert stage.dropped == 0


@pytest.mark.parametrize("kind", [1, 2, 3, 4, 99])
def test_what_makes_no_sense_is_passed_over_and_counted(stage: RemoteStage, kind: int) -> None:
    memory = open_ring(INBOX_SLOTS)
    process = RingWriter(memory)
    stage._inboxes = RingReader(memory)
    os.close(memory)
    for body in (b"", b"\xc1", b"\x93\x01\x02\x03"):
        assert process.put(kind, body)
    assert stage.take_inbox() == Inbox()
    assert stage.dropped == 3
    stage.dropped = 0


def test_a_process_that_never_ends_is_ended(
    stage: RemoteStage, bridge: RosBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("segway_ecc.node.ros.remote._CLOSE_S", 0.01)
    os.kill(bridge.pid, signal.SIGSTOP)
    stage.close()
    assert bridge.status == -signal.SIGKILL


def test_a_failing_start_of_ros_is_reported_with_its_reason(bridge: RosBridge, robot: Robot) -> None:
    with pytest.raises(RosUnavailableError, match="ROS 2 does not start: "):
        RemoteStage(bridge, robot, ros_arguments=["--ros-args", "-r", "not a rule"])


def test_a_process_that_dies_before_it_is_ready_is_reported(bridge: RosBridge, robot: Robot) -> None:
    os.kill(bridge.pid, signal.SIGKILL)
    with pytest.raises(RosUnavailableError, match="its process ended with status -9"):
        RemoteStage(bridge, robot)


def test_a_process_without_settings_ends(bridge: RosBridge) -> None:
    assert bridge.close() == 0
