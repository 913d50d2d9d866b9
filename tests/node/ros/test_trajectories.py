# SPDX-License-Identifier: MIT
"""A manoeuvre in ROS, there and back: what is sent is what the loop takes, and its answer what the sender reads."""

import importlib
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.setpoints import NO_LIMIT, REST, Setpoint, SetpointRefusal
from segway_ecc.node.cycle.trajectory import (
    CANCEL,
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
    objection,
)
from segway_ecc.node.ros.publishers import make_status_publisher
from segway_ecc.node.ros.trajectories import TRAJECTORY_TYPE, read_status, read_trajectory, trajectory_message
from segway_ecc.node.safety.modes import Mode

pytestmark = pytest.mark.ros

STAMP_NS = 1_700_000_000_123_456_789
WHOLE = Trajectory(STAMP_NS, (TimedSetpoint(0, Setpoint(1.0, -0.1)), TimedSetpoint(2_500_000_001, Setpoint(0.25, 0.0))))
FOLLOWED = TrajectoryStatus(STAMP_NS, TrajectoryState.FOLLOWED, "", STAMP_NS, STAMP_NS + 5, 7, WHOLE.digest)


def serialized(message: Any) -> bytes:
    data: bytes = importlib.import_module("rclpy.serialization").serialize_message(message)
    return data


def over_the_wire(message: Any) -> Any:
    return importlib.import_module("rclpy.serialization").deserialize_message(serialized(message), type(message))


@pytest.mark.parametrize("trajectory", [WHOLE, CANCEL], ids=["whole", "cancel"])
def test_a_trajectory_arrives_to_the_last_bit(trajectory: Trajectory) -> None:
    assert read_trajectory(serialized(trajectory_message(trajectory))) == trajectory


def test_a_message_of_another_tool_names_its_frame_by_rep_105() -> None:
    message = trajectory_message(WHOLE)
    assert (message.header.frame_id, list(message.joint_names)) == ("base_link", ["base_link"])
    assert f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}" == TRAJECTORY_TYPE


def ros(name: str) -> Any:
    package, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: setattr(m.header, "frame_id", "odom"), "header.frame_id is not base_link, the frame of its"),
        (lambda m: setattr(m, "joint_names", ["arm"]), "joint_names is not [base_link], which is all that it moves"),
        (lambda m: setattr(m, "joint_names", []), "joint_names is not [base_link]"),
        (lambda m: setattr(m, "joint_names", ["base_link", "arm"]), "joint_names is not [base_link]"),
        (lambda m: setattr(m.points[1], "velocities", []), "point 1 has 0 velocities and needs one"),
        (lambda m: m.points[1].velocities.append(ros("geometry_msgs/Twist")), "point 1 has 2 velocities and needs"),
        (lambda m: m.points[0].transforms.append(ros("geometry_msgs/Transform")), "point 0 has transforms or acc"),
        (lambda m: m.points[0].accelerations.append(ros("geometry_msgs/Twist")), "point 0 has transforms or acc"),
        (lambda m: setattr(m.points[0].velocities[0].linear, "y", 0.1), "point 0 asks for a velocity other than"),
        (lambda m: setattr(m.points[0].velocities[0].linear, "z", 0.1), "point 0 asks for a velocity other than"),
        (lambda m: setattr(m.points[1].velocities[0].angular, "x", -0.1), "point 1 asks for a velocity other than"),
        (lambda m: setattr(m.points[1].velocities[0].angular, "y", math.nan), "point 1 asks for a velocity other"),
    ],
)
def test_what_is_not_obeyed_is_named_and_the_points_are_read_for_the_answer(
    change: Callable[[Any], None], reason: str
) -> None:
    message = trajectory_message(WHOLE)
    change(message)
    read = read_trajectory(serialized(message))
    assert read.unsupported.startswith(reason)
    assert (read.stamp_ns, len(read.points)) == (WHOLE.stamp_ns, len(WHOLE.points))


def test_a_robot_whose_base_has_another_frame_takes_that_too() -> None:
    message = trajectory_message(WHOLE)
    message.header.frame_id, message.joint_names = "alice/base", ["alice/base"]
    assert read_trajectory(serialized(message), "alice/base") == WHOLE
    assert read_trajectory(serialized(trajectory_message(WHOLE)), "alice/base") == WHOLE


def test_an_empty_message_cancels_whatever_else_it_holds() -> None:
    assert read_trajectory(serialized(ros("trajectory_msgs/MultiDOFJointTrajectory"))) == CANCEL


def trajectory_of(count: int) -> Any:
    return trajectory_message(Trajectory(STAMP_NS, tuple(TimedSetpoint(n, REST) for n in range(count))))


def test_of_a_message_with_too_many_points_only_so_many_are_read_that_it_is_refused() -> None:
    assert len(read_trajectory(serialized(trajectory_of(MOST_POINTS + 100))).points) == MOST_POINTS + 1


@pytest.mark.parametrize("is_little", [True, False])
def test_a_message_that_is_too_large_is_refused_by_its_stamp_and_not_decoded(
    monkeypatch: pytest.MonkeyPatch, *, is_little: bool
) -> None:
    data = bytearray(serialized(trajectory_of(4 * MOST_POINTS)))
    if not is_little:
        data[1], data[4:8], data[8:12] = 0, data[7:3:-1], data[11:7:-1]
    monkeypatch.setattr("rclpy.serialization.deserialize_message", None)
    read = read_trajectory(bytes(data))
    assert read.stamp_ns == STAMP_NS
    assert objection(read.points, NO_LIMIT, 1) == (SetpointRefusal.MALFORMED, "it is larger than 1000 points may be")


def test_the_largest_message_of_as_many_points_as_are_taken_is_read() -> None:
    message = trajectory_of(MOST_POINTS)
    transform = importlib.import_module("geometry_msgs.msg").Transform()
    for point in message.points:
        point.transforms, point.accelerations = [transform], point.velocities
    message.joint_names = ["base_link"] * 100
    assert len(read_trajectory(serialized(message)).points) == MOST_POINTS


class Listener:
    def __init__(self) -> None:
        self.sent: list[Any] = []
        node = SimpleNamespace(create_publisher=lambda *_: SimpleNamespace(publish=self.sent.append))
        self.topic = make_status_publisher(node, "cart")

    def publish(self, ms: int, accepted: TrajectoryStatus, refused: TrajectoryStatus | None = None) -> list[Any]:
        self.sent.clear()
        stamp_ns = 1_700_000_000_000_000_000 + ms * 1_000_000
        report = Report(stamp_ns, Mode.ARMED, (), None, trajectory=accepted, refused_trajectory=refused)
        self.topic.publish(report)
        return [read_status(over_the_wire(message)) for message in self.sent]


def test_a_status_is_published_when_it_changes_and_each_second() -> None:
    listener, done = Listener(), FOLLOWED._replace(state=TrajectoryState.DONE)
    assert listener.publish(0, FOLLOWED) == [FOLLOWED]
    assert listener.publish(10, FOLLOWED) == []
    assert listener.publish(20, done) == [done]
    assert listener.publish(990, done) == []
    assert listener.publish(1000, done) == [done]


def test_each_refusal_is_published_once_beside_the_trajectory_that_is_followed() -> None:
    listener = Listener()
    refused = TrajectoryStatus(7, TrajectoryState.REFUSED, "the robot is not armed", 0, 0)
    assert listener.publish(0, FOLLOWED) == [FOLLOWED]
    assert listener.publish(10, FOLLOWED, refused) == [refused]
    assert listener.sent[0].message == "refused: the robot is not armed"
    assert listener.sent[0].level == b"\x02"
    assert listener.publish(20, FOLLOWED) == []
    assert listener.publish(30, FOLLOWED, refused) == [refused], "sent again by who had no answer"
    assert listener.publish(1000, FOLLOWED) == [FOLLOWED], "not again: the next with its stamp may be accepted"


@pytest.mark.parametrize(
    "values", [{}, {"state": "followed"}, {"state": "lost", "stamp_ns": "1"}, {"stamp_ns": "x", "state": "done"}]
)
def test_a_status_of_something_else_is_none(values: dict[str, str]) -> None:
    kind = importlib.import_module("diagnostic_msgs.msg")
    pairs = [kind.KeyValue(key=key, value=value) for key, value in values.items()]
    assert read_status(kind.DiagnosticStatus(values=pairs)) is None
