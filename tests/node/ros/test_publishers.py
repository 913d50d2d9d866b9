# SPDX-License-Identifier: MIT
"""What each publisher sends, message by message, in a node that only remembers."""

import importlib
import math
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from segway_ecc.node.config import RosSection
from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.signals import SUPPLY_SIGNAL, published_signals
from segway_ecc.node.ros.publishers import make_publishers, make_residual_publisher
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.residual import SHOWN

pytestmark = pytest.mark.ros

STAMP_NS = 1_700_000_000_123_456_789
PUBLISHED = published_signals(())
IMU = [signal for signal in PUBLISHED if signal.startswith("imu.")]


def as_message(sent: Any, kind: type) -> Any:
    """What was published, as ROS reads it."""
    if isinstance(sent, bytes):
        return importlib.import_module("rclpy.serialization").deserialize_message(sent, kind)
    return sent


class Node:
    """Remembers the topics, and the last message on each."""

    def __init__(self) -> None:
        self.topics: list[str] = []
        self.sent: dict[str, Any] = {}

    def create_publisher(self, kind: type, topic: str, _depth: int) -> SimpleNamespace:
        self.topics.append(topic)
        return SimpleNamespace(publish=lambda message: self.sent.update({topic: as_message(message, kind)}))


def report(stamp_ns: int, values: list[float]) -> Report:
    return Report(stamp_ns, Mode.ARMED, values, None)


def published(signals: list[str]) -> Node:
    """A node that has published the numbers 1, 2, 3 and so on for these signals."""
    node = Node()
    for topic in make_publishers(node, RosSection(), signals):
        topic.publish(report(STAMP_NS, [float(number) for number in range(1, len(signals) + 1)]))
    return node


def test_an_imu_carries_rate_and_specific_force_and_marks_orientation_unknown() -> None:
    imu = published(["left.angle", *IMU]).sent["imu/data"]
    assert (imu.header.frame_id, imu.header.stamp.sec, imu.header.stamp.nanosec) == (
        "imu_link",
        1_700_000_000,
        123_456_789,
    )
    assert [getattr(imu.angular_velocity, axis) for axis in "xyz"] == [2.0, 3.0, 4.0]
    assert [getattr(imu.linear_acceleration, axis) for axis in "xyz"] == [5.0, 6.0, 7.0]
    assert list(imu.orientation_covariance) == [-1.0] + [0.0] * 8
    assert list(imu.angular_velocity_covariance) == pytest.approx([1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 1e-4])
    assert list(imu.linear_acceleration_covariance) == pytest.approx([0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.04])


ODOMETRY = [signal for signal in PUBLISHED if signal.startswith("odometry.")]


def with_attitude(pitch: float, heading: float) -> Any:
    """The message of an IMU that is turned so, rad."""
    node, signals = Node(), [*ODOMETRY, *IMU]
    for topic in make_publishers(node, RosSection(), signals, pitch=1):
        values = [0.0, 0.0, heading, 0.0, 0.0, *[1.0] * 6]
        topic.publish(replace(report(STAMP_NS, values), topics=(9.0, pitch)))
    return node.sent["imu/data"]


def test_an_imu_whose_pitch_is_estimated_has_an_orientation() -> None:
    imu = with_attitude(0.3, -0.8)
    q = imu.orientation
    assert q.x**2 + q.y**2 + q.z**2 + q.w**2 == pytest.approx(1.0)
    # Where its x axis points: down by the pitch, and around by the heading.
    ahead = 1.0 - 2.0 * (q.y**2 + q.z**2), 2.0 * (q.x * q.y + q.w * q.z), 2.0 * (q.x * q.z - q.w * q.y)
    assert ahead == pytest.approx((math.cos(0.3) * math.cos(-0.8), math.cos(0.3) * math.sin(-0.8), -math.sin(0.3)))
    # Its y axis stays level.
    assert 2.0 * (q.y * q.z + q.w * q.x) == pytest.approx(0.0)
    variances = [imu.orientation_covariance[place] for place in (0, 4, 8)]
    assert variances == pytest.approx([0.01, 4e-4, 1e-6])


def test_an_attitude_that_is_not_finite_is_marked_unknown() -> None:
    for imu in (with_attitude(math.nan, 0.0), with_attitude(0.0, math.inf)):
        assert imu.orientation_covariance[0] == -1.0
        assert imu.angular_velocity.x == 1.0


@pytest.mark.parametrize("bad", ODOMETRY)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_odometry_that_is_not_finite_is_not_published(bad: str, value: float) -> None:
    node = Node()
    for topic in make_publishers(node, RosSection(), ODOMETRY):
        topic.publish(report(STAMP_NS, [value if signal == bad else 1.0 for signal in ODOMETRY]))
    assert "odom" not in node.sent
    assert ("position" in node.sent) == (bad not in ("odometry.x", "odometry.y"))
    assert ("linear_velocity" in node.sent) == (bad != "odometry.linear_velocity")


def test_odometry_has_the_covariance_of_what_was_driven() -> None:
    node = Node()
    topics = make_publishers(node, RosSection(), ODOMETRY)
    for cycle in range(101):
        for topic in topics:
            topic.publish(report(STAMP_NS + cycle * 10_000_000, [0.01 * cycle, 0.0, 0.0, 1.0, 0.0]))
    odom = node.sent["odom"]
    pose, twist = list(odom.pose.covariance), list(odom.twist.covariance)
    assert [pose[place] for place in (0, 7, 35)] == pytest.approx([1e-4, 1.33e-4, 1e-4], rel=0.02)
    assert pose[6 * 1 + 5] == pose[6 * 5 + 1] > 0.0
    assert [pose[place] for place in (14, 21, 28)] == [twist[place] for place in (14, 21, 28)] == [1e6] * 3
    assert [twist[place] for place in (0, 7, 35)] == pytest.approx([9e-4, 1e-4, 1e-4])
    assert sum(value != 0.0 for value in pose) == 8
    assert sum(value != 0.0 for value in twist) == 6


@pytest.mark.parametrize("missing", IMU)
def test_half_an_imu_is_not_published(missing: str) -> None:
    assert published([signal for signal in IMU if signal != missing]).topics == []


def test_a_robot_without_an_imu_has_the_topics_it_always_had() -> None:
    without = [signal for signal in PUBLISHED if signal not in [*IMU, SUPPLY_SIGNAL]]
    assert without == list(PUBLISHED[:9])
    topics = ["linear_velocity", "angular_velocity", "position", "odom", "joint_states"]
    assert published(without).topics == topics
    assert published(list(PUBLISHED)).topics == [*topics, "imu/data", "battery_state"]


def test_the_joints_of_all_axes_are_published_by_their_names() -> None:
    node, signals = Node(), list(published_signals(["pan.angle", "pan.velocity", "tilt.angle", "tilt.velocity"]))[5:9]
    for topic in make_publishers(node, RosSection(joints={"tilt": "camera_tilt"}), signals):
        topic.publish(report(STAMP_NS, [1.0, 2.0, 3.0, 4.0]))
    joints = node.sent["joint_states"]
    assert list(joints.name) == ["pan_joint", "camera_tilt"]
    assert (list(joints.position), list(joints.velocity)) == ([1.0, 2.0], [3.0, 4.0])


@pytest.mark.parametrize(("torque", "expected"), [(6.0, [5.0, 6.0]), (math.nan, [])])
def test_joints_carry_the_torques_where_all_are_measured(torque: float, expected: list[float]) -> None:
    node = Node()
    signals = ["left.angle", "right.angle", "left.velocity", "right.velocity", "left.torque", "right.torque"]
    for topic in make_publishers(node, RosSection(), signals):
        topic.publish(report(STAMP_NS, [1.0, 2.0, 3.0, 4.0, 5.0, torque]))
    joints = node.sent["joint_states"]
    assert (list(joints.velocity), list(joints.effort)) == ([3.0, 4.0], expected)


def battery(measured: list[tuple[int, float]]) -> list[Any]:
    """What a robot publishes of its battery when these voltages are measured at these stamps, ns."""
    sent: list[Any] = []
    node = SimpleNamespace(
        create_publisher=lambda kind, topic, _depth: SimpleNamespace(
            publish=lambda message: sent.append((kind.__name__, topic, message.header.stamp.nanosec, message.voltage))
        )
    )
    (topic,) = make_publishers(node, RosSection(), ["left.angle", SUPPLY_SIGNAL])
    for stamp_ns, volts in measured:
        topic.publish(report(stamp_ns, [0.0, volts]))
    return sent


def test_a_battery_carries_its_voltage_and_marks_the_rest_unknown() -> None:
    sent = published(["left.angle", SUPPLY_SIGNAL]).sent["battery_state"]
    assert (sent.header.frame_id, sent.header.stamp.sec, sent.header.stamp.nanosec) == (
        "base_link",
        1_700_000_000,
        123_456_789,
    )
    assert (sent.voltage, sent.present) == (2.0, True)
    unknown = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
    assert all(math.isnan(getattr(sent, name)) for name in unknown)
    assert sent.power_supply_status == sent.power_supply_health == sent.power_supply_technology == 0


def test_a_battery_is_published_twice_a_second_while_it_is_measured() -> None:
    at = [(10 * index * 1_000_000, 24.0 + index) for index in range(150)]
    assert battery(at) == [
        ("BatteryState", "battery_state", stamp % 10**9, volts) for stamp, volts in (at[0], at[50], at[100])
    ]
    assert battery([(0, math.nan), (10, 24.0), (20, 25.0)]) == [("BatteryState", "battery_state", 10, 24.0)]
    # A clock that was set back is followed.
    assert [volts for *_, volts in battery([(5 * 10**9, 1.0), (10**9, 2.0)])] == [1.0, 2.0]


def test_the_residual_is_published_ten_times_a_second_with_the_names_of_its_numbers() -> None:
    sent: list[Any] = []
    node = SimpleNamespace(
        create_publisher=lambda _kind, topic, _depth: SimpleNamespace(
            publish=lambda message: sent.append((topic, list(message.data), message.layout.dim[0].label))
        )
    )
    topic = make_residual_publisher(node, SHOWN)
    for cycle in range(60):
        topic.publish(replace(report(STAMP_NS + cycle * 5_000_000, []), residual=(float(cycle), 0.1, 0.2, 0.3, 0.4)))
    assert [name for name, *_ in sent] == ["residual"] * len(sent)
    assert len(sent) in {3, 4}
    assert sent[0][1:] == ([0.0, 0.1, 0.2, 0.3, 0.4], "residual, N; payload, kg; slope, rad; friction, N m; radius, 1")
    topic.publish(report(STAMP_NS + 10**9, []))
    assert len(sent) in {3, 4}
