# SPDX-License-Identifier: MIT
"""The loop's side of ROS, with its process: it never waits, and counts what was lost."""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import IO, NamedTuple

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.status import Level
from segway_ecc.node.cycle.trajectory import (
    LONGEST_REASON,
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.errors import ConfigurationError, RosUnavailableError
from segway_ecc.node.helper import spawn_helper
from segway_ecc.node.model.model import Variable
from segway_ecc.node.ring import RingReader, RingWriter, open_ring, slots_for
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.ros.process import Subscriptions
from segway_ecc.node.ros.protocol import (
    RosSettings,
    ToLoop,
    TrajectoryPart,
    WriteRequest,
    decode_report,
    decode_status,
    decode_write_result,
    encoder,
)
from segway_ecc.node.ros.remote import INBOX_SLOTS, RemoteStage, RosBridge
from segway_ecc.node.ros.stage import LONGEST_NAME
from segway_ecc.node.safety.modes import Mode
from tests.node.ros.test_stage import SETTINGS
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.ros

ENVIRONMENT = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOG_DIR")


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, ros_environment: dict[str, str]) -> None:
    for name in ENVIRONMENT:
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
    assert stage.take_inbox() == Inbox(), "the first has what was written at the start"
    yield stage
    stage.close()


class Loop(NamedTuple):
    """A stage whose process the test plays.

    Attributes:
        stage: The loop's side.
        process: Writes what the stage takes.
        sent: Reads what the stage puts.
    """

    stage: RemoteStage
    process: RingWriter
    sent: RingReader


@pytest.fixture(scope="module")
def one_stage(ros_environment: dict[str, str]) -> Iterator[RemoteStage]:
    """For all tests that play its process: each start of ROS takes a second."""
    with pytest.MonkeyPatch.context() as patched:
        for name in ENVIRONMENT:
            patched.setenv(name, ros_environment[name])
        stage = RemoteStage(RosBridge(), build_robot(load_robot("cart"), RealClock()))
        assert stage.take_inbox() == Inbox(), "the first has what was written at the start"
        yield stage
        stage.close()


@pytest.fixture
def loop(one_stage: RemoteStage) -> Iterator[Loop]:
    """With rings of the test's own, and nothing lost before."""
    before = one_stage._inboxes, one_stage._reports
    inboxes, reports = open_ring(INBOX_SLOTS), open_ring(slots_for(6000))
    one_stage._inboxes, one_stage._reports = RingReader(inboxes), RingWriter(reports)
    one_stage.dropped, one_stage._strangers = 0, []
    yield Loop(one_stage, RingWriter(inboxes), RingReader(reports))
    one_stage._inboxes, one_stage._reports = before
    one_stage.dropped = 0
    os.close(inboxes)
    os.close(reports)


def report(cycle: int, reason: str = "") -> Report:
    return Report(time.time_ns(), Mode.ARMED, [0.0] * 9, None, cycle=cycle, reason=reason, at_ns=time.monotonic_ns())


def publish(stage: RemoteStage, count: int) -> None:
    for cycle in range(count):
        stage.publish(report(cycle))


def wait_for(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
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


def test_a_reason_of_any_length_is_published(loop: Loop) -> None:
    loop.stage.publish(report(1, "\u00e4" * 100_000))
    assert loop.stage.dropped == 0


def test_the_longest_report_there_is_gets_through(loop: Loop, robot: Robot) -> None:
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
        trajectory=TrajectoryStatus(
            number, TrajectoryState.FOLLOWED, character * LONGEST_REASON, number, number, number, 2**32 - 1
        ),
        refused_trajectory=TrajectoryStatus(number, TrajectoryState.REFUSED, "x" * LONGEST_REASON, 0, 0, 0, 2**32 - 1),
    )
    loop.stage.publish(longest)
    taken = loop.sent.take_message()

    assert loop.stage.dropped == 0
    assert taken is not None
    assert decode_report(taken[1]) == replace(longest, reason=character * 900)


@pytest.mark.parametrize("count", [0, 1, 50, 51, MOST_POINTS + 1])
def test_a_trajectory_reaches_the_loop_whole_however_many_parts_it_has(
    loop: Loop, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = loop.stage
    points = tuple(TimedSetpoint(2**40 + n, Setpoint(0.1 * n, -0.3)) for n in range(count))
    inbox, found = Inbox(), Inbox()
    inbox.trajectories.append(Trajectory(2**60, points))
    # Where the ring is full the process waits, and the loop goes on: a cycle takes what fits.
    monkeypatch.setattr("time.sleep", lambda _: found.trajectories.extend(stage.take_inbox().trajectories))
    Subscriptions(loop.process, 10_000_000).hand_over(inbox)
    found.trajectories.extend(stage.take_inbox().trajectories)
    assert found.trajectories == inbox.trajectories
    assert stage.dropped == 0


def test_of_a_trajectory_whose_parts_end_early_nothing_is_followed(loop: Loop) -> None:
    stage = loop.stage
    whole = TrajectoryPart(2, (TimedSetpoint(0, Setpoint(0.0, 0.0)),), begin=0, total=1)
    for part in (TrajectoryPart(1, whole.points, begin=0, total=2), whole):
        assert loop.process.put(ToLoop.TRAJECTORY, encoder.encode(part))
    assert stage.take_inbox().trajectories == [Trajectory(2, tuple(whole.points))]


@pytest.mark.parametrize("begins", [(0, 2), (1, 2)])
def test_a_trajectory_that_lacks_a_part_is_discarded_and_counted(loop: Loop, begins: tuple[int, ...]) -> None:
    stage = loop.stage
    for begin in begins:
        part = TrajectoryPart(1, (TimedSetpoint(begin, Setpoint(0.0, 0.0)),), begin, total=3)
        assert loop.process.put(ToLoop.TRAJECTORY, encoder.encode(part))
    assert stage.take_inbox().trajectories == []
    assert stage.dropped


def test_the_process_reports_whether_there_are_subscribers(loop: Loop) -> None:
    stage = loop.stage
    for is_heard in (False, True, False):
        assert loop.process.put(ToLoop.SUBSCRIBED, encoder.encode(is_heard))
        assert stage.take_inbox() == Inbox()
        assert stage.wants_reports is is_heard
    assert stage.dropped == 0


def test_strangers_are_in_the_diagnostics_and_what_the_process_refused_is_counted(loop: Loop) -> None:
    for kind, what in ((ToLoop.STRANGER, "/cat"), (ToLoop.REFUSED, None), (ToLoop.STRANGER, "/dog")):
        assert loop.process.put(kind, encoder.encode(what))
    assert loop.stage.take_inbox() == Inbox()
    loop.stage.publish_diagnostics(0, ())
    (_, body), _ = loop.sent.take_messages()
    status = decode_status(body)
    assert (status.level, status.message) == (Level.WARN, "/cat; /dog")
    assert (status.values["strangers"], status.values["dropped"]) == ("2", "1")


@pytest.mark.parametrize("kind", [1, 2, 3, 4, 5, 99])
def test_what_makes_no_sense_is_passed_over_and_counted(loop: Loop, kind: int) -> None:
    for body in (b"", b"\xc1", b"\x93\x01\x02\x03"):
        assert loop.process.put(kind, body)
    assert loop.stage.take_inbox() == Inbox()
    assert loop.stage.dropped == 3


def test_a_process_that_is_killed_is_replaced_and_the_loop_goes_on_with_new_rings(
    stage: RemoteStage, bridge: RosBridge, caplog: pytest.LogCaptureFixture
) -> None:
    first, reports = bridge.pid, stage._reports
    stage._strangers.append("/cat")
    os.kill(first, signal.SIGKILL)
    wait_for(lambda: bridge.rings is not None)
    assert stage.take_inbox().written == []
    assert (bridge.rings, bridge.status, bridge.ended) == (None, None, 1)
    assert stage._reports is not reports
    assert stage._strangers == [], "the new process looks for them anew"
    assert bridge.pid != first
    publish(stage, 60)
    wait_for(lambda: stage._reports.held() == 0)
    assert stage.dropped == 0
    assert "the ROS process has ended with status -9: the robot goes on as without a network" in caplog.text
    stage.close()
    assert bridge.status == 0


def test_a_process_that_ends_again_and_again_is_replaced_less_and_less_often(
    bridge: RosBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []
    closing = SimpleNamespace(is_set=lambda: len(pauses) > 10, wait=pauses.append)
    begun: list[RosSettings] = []
    monkeypatch.setattr(RosBridge, "_run_another", lambda _, settings: begun.append(settings))
    monkeypatch.setattr(bridge, "_closing", closing)
    os.kill(bridge.pid, signal.SIGKILL)
    track = Variable("Track", "m", 0.3)
    bridge._keep_running(replace(SETTINGS, parameters=(track,)), {"Track": 0.45})
    assert pauses == [0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6, 30.0, 30.0]
    assert begun == [replace(SETTINGS, parameters=(Variable("Track", "m", 0.45),), is_again=True)] * 11


def test_a_replacement_that_hangs_at_its_start_is_killed(bridge: RosBridge, monkeypatch: pytest.MonkeyPatch) -> None:
    def spawn_stopped(module: str, descriptors: Sequence[int]) -> tuple[int, IO[bytes], IO[bytes]]:
        started = spawn_helper(module, descriptors)
        os.kill(started[0], signal.SIGSTOP)
        return started

    monkeypatch.setattr("segway_ecc.node.ros.remote.spawn_helper", spawn_stopped)
    monkeypatch.setattr("segway_ecc.node.ros.remote._STARTS_WITHIN_S", 0.01)
    first = bridge._process
    bridge._run_another(SETTINGS)
    assert (bridge.status, bridge.rings) == (-signal.SIGKILL, None)
    assert first.stdin is not None
    first.stdin.close()


def test_a_replacement_is_in_the_diagnostics_once(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop.stage._bridge, "ended", 2)
    texts = []
    for _ in range(2):
        loop.stage.publish_diagnostics(0, ())
        (_, body), _ = loop.sent.take_messages()
        texts.append((decode_status(body).level, decode_status(body).message, decode_status(body).values["replaced"]))
    assert texts == [
        (Level.WARN, "its process has ended and was replaced 2 times since the last report", "2"),
        (Level.OK, "its process runs", "2"),
    ]


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


def override(*parameters: str) -> list[str]:
    return ["--ros-args", *(word for parameter in parameters for word in ("-p", parameter))]


def test_overrides_reach_the_model_before_the_first_cycle_and_are_recorded_in_it(
    bridge: RosBridge, robot: Robot
) -> None:
    arguments = override("Track:=0.45", "WheelRadius:=0.0625", "use_sim_time:=false", "other:Track:=0.9")
    stage = RemoteStage(bridge, robot, ros_arguments=arguments)
    assert (robot.model.read("Track"), robot.model.read("WheelRadius")) == (0.45, 0.0625)
    first, second = stage.take_inbox(), stage.take_inbox()
    assert sorted(each[:3] for each in first.written) == [("Track", 0.45, ""), ("WheelRadius", 0.0625, "")]
    assert [each.has_more for each in first.written] == [True, False], "both or none"
    assert second == Inbox()
    stage.close()


def test_overrides_in_a_file_reach_the_model(bridge: RosBridge, robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text("/**:\n  ros__parameters:\n    Track: 0.45\n", "utf-8")
    RemoteStage(bridge, robot, ros_arguments=["--ros-args", "--params-file", str(file)]).close()
    assert robot.model.read("Track") == 0.45


@pytest.mark.parametrize(
    ("parameter", "refusal"),
    [
        ("Trakc:=0.45", "no parameter of model 'cart' is called 'Trakc'; there is "),
        ("PoseX:=0.45", "no parameter of model 'cart' is called 'PoseX'; there is "),
        ("Track:=1", "'Track' takes a floating-point number"),
        ("Track:=wide", "'Track' takes a floating-point number"),
        ("Track:=.nan", "'Track' cannot be nan: only finite values are taken"),
        ("WheelRadius:=0.0", "'WheelRadius' cannot be 0.0: allowed is 0.03 to 0.1 m"),
    ],
)
def test_an_override_that_is_refused_ends_the_start(
    bridge: RosBridge, robot: Robot, parameter: str, refusal: str
) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(f"parameter override: {refusal}")):
        RemoteStage(bridge, robot, ros_arguments=override(parameter))


def test_a_process_that_dies_before_it_is_ready_is_reported(bridge: RosBridge, robot: Robot) -> None:
    os.kill(bridge.pid, signal.SIGKILL)
    with pytest.raises(RosUnavailableError, match="its process ended with status -9"):
        RemoteStage(bridge, robot)


def test_a_process_without_settings_ends(bridge: RosBridge) -> None:
    assert bridge.close() == 0


def test_of_writes_one_is_handed_over_in_a_cycle_and_answered_with_its_number(loop: Loop) -> None:
    stage = loop.stage
    for number, value in ((1, 0.4), (2, 0.5)):
        assert loop.process.put(ToLoop.WRITE, encoder.encode(WriteRequest(number, (("Track", value),))))
    assert loop.process.put(ToLoop.SUBSCRIBED, encoder.encode(False))  # noqa: FBT003 - the body of the message
    cycles = [stage.take_inbox().writes for _ in range(3)]
    assert [[write.values for write in writes] for writes in cycles] == [[(("Track", 0.4),)], [(("Track", 0.5),)], []]
    cycles[1][0].answer("too wide")
    cycles[0][0].answer("")
    assert [decode_write_result(body) for _, body in loop.sent.take_messages()] == [(2, "too wide"), (1, None)]
    assert stage._values["Track"] == 0.4, "what a process that takes this one's place begins with"
