# SPDX-License-Identifier: MIT
"""A manoeuvre in ROS, there and back: what is sent is what the loop takes, and its answer what the sender reads."""

import importlib
import math
from types import SimpleNamespace
from typing import Any

import pytest

from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.cycle.trajectory import (
    CANCEL,
    MOST_POINTS,
    TimedSetpoint,
    Trajectory,
    TrajectoryState,
    TrajectoryStatus,
)
from segway_ecc.node.ros.publishers import make_status_publisher
from segway_ecc.node.ros.trajectories import TRAJECTORY_TYPE, read_status, read_trajectory, trajectory_message
from segway_ecc.node.safety.modes import Mode

pytestmark = pytest.mark.ros

STAMP_NS = 1_700_000_000_123_456_789
WHOLE = Trajectory(STAMP_NS, (TimedSetpoint(0, Setpoint(1.0, -0.1)), TimedSetpoint(2_500_000_001, Setpoint(0.25, 0.0))))
FOLLOWED = TrajectoryStatus(STAMP_NS, TrajectoryState.FOLLOWED, "", STAMP_NS, STAMP_NS + 5)


def over_the_wire(message: Any) -> Any:
    serialization = importlib.import_module("rclpy.serialization")
    return serialization.deserialize_message(serialization.serialize_message(message), type(message))


@pytest.mark.parametrize("trajectory", [WHOLE, CANCEL], ids=["whole", "cancel"])
def test_a_trajectory_arrives_to_the_last_bit(trajectory: Trajectory) -> None:
    assert read_trajectory(over_the_wire(trajectory_message(trajectory))) == trajectory


def test_a_message_of_another_tool_names_its_frame_by_rep_105() -> None:
    message = trajectory_message(WHOLE)
    assert (message.header.frame_id, list(message.joint_names)) == ("base_link", ["base_link"])
    assert f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}" == TRAJECTORY_TYPE


def test_a_point_without_a_velocity_is_not_a_number() -> None:
    message = trajectory_message(WHOLE)
    message.points[1].velocities = []
    first, second = read_trajectory(over_the_wire(message)).points
    assert first == WHOLE.points[0]
    assert all(map(math.isnan, second.setpoint))


def test_of_a_message_that_is_too_long_only_so_much_is_read_that_it_is_refused() -> None:
    points = tuple(TimedSetpoint(n, REST) for n in range(MOST_POINTS + 100))
    assert len(read_trajectory(trajectory_message(Trajectory(0, points))).points) == MOST_POINTS + 1


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


def test_a_refusal_is_published_once_beside_the_trajectory_that_is_followed() -> None:
    listener = Listener()
    refused = TrajectoryStatus(7, TrajectoryState.REFUSED, "it has more than 1000 points", 0, 0)
    assert listener.publish(0, FOLLOWED) == [FOLLOWED]
    assert listener.publish(10, FOLLOWED, refused) == [refused]
    assert listener.sent[0].message == "refused: it has more than 1000 points"
    assert listener.sent[0].level == b"\x02"
    assert listener.publish(20, FOLLOWED, refused) == []


@pytest.mark.parametrize(
    "values", [{}, {"state": "followed"}, {"state": "lost", "stamp_ns": "1"}, {"stamp_ns": "x", "state": "done"}]
)
def test_a_status_of_something_else_is_none(values: dict[str, str]) -> None:
    kind = importlib.import_module("diagnostic_msgs.msg")
    pairs = [kind.KeyValue(key=key, value=value) for key, value in values.items()]
    assert read_status(kind.DiagnosticStatus(values=pairs)) is None
