from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from hil.lockstep import LockstepRig
from node.config import load_robot
from node.cycle.seams import CycleRecord
from node.cycle.status import Level, Status
from node.recording.cycle_log import CycleLog, Layout, layout_of
from node.robot import build_robot
from node.sequence.manoeuvre import single_segment
from node.sequence.player import Player
from node.sequence.stage import ManoeuvreStage

START_NS = 1_700_000_000_000_000_000
COMMON = {
    "/position": "geometry_msgs/msg/Point",
    "/linear_velocity": "std_msgs/msg/Float64",
    "/angular_velocity": "std_msgs/msg/Float64",
    "/odom": "nav_msgs/msg/Odometry",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/setpoint": "geometry_msgs/msg/TwistStamped",
}
TIMING = ("lateness", "exchange", "ros", "decide", "equations", "limit")


def read(path: Path) -> tuple[dict[str, str], dict[str, list[tuple[int, Any]]]]:
    """The type of each topic, and each topic's messages with their log time."""
    types, messages = {}, defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, record, message in reader.iter_decoded_messages():
            types[channel.topic] = schema.name if schema else ""
            messages[channel.topic].append((record.log_time, message))
    return types, messages


def test_a_cycle_is_on_the_topics_of_its_names(
    tmp_path: Path, layout: Layout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout)
    log.write(record(0))
    log.close()
    types, messages = read(path)
    numbers = {topic: found[0][1].data for topic, found in messages.items() if types[topic] == "std_msgs/msg/Float64"}

    assert {topic: types[topic] for topic in COMMON} == COMMON
    assert numbers == {
        "/linear_velocity": 12.0,
        "/angular_velocity": 13.0,
        "/model/LeftVelocity": 3.5,
        "/model/X": 4.5,
        "/model/Motor/Voltage": 5.5,
        "/model/Sub/port_1": 6.5,
        "/command/left/voltage": 7.5,
        "/command/right/voltage": 8.5,
        "/sensor/left/angle": 1.5,
        "/sensor/left/velocity": 2.5,
        "/sensor_age/left/angle": 0.001,
        "/sensor_age/left/velocity": 0.002,
        "/timing/lateness": pytest.approx(1e-6),
        "/timing/exchange": pytest.approx(0.001),
        "/timing/ros": pytest.approx(0.002),
        "/timing/decide": pytest.approx(0.003),
        "/timing/equations": pytest.approx(0.004),
        "/timing/limit": pytest.approx(0.005),
    }
    assert set(types) == set(COMMON) | set(numbers)
    assert {stamp_ns for found in messages.values() for stamp_ns, _ in found} == {START_NS}


def test_structured_messages_bear_the_frames_joints_and_stamp(
    tmp_path: Path, layout: Layout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout)
    log.write(record(3))
    log.close()
    _, messages = read(path)
    odometry, joints, setpoint = (messages[topic][0][1] for topic in ("/odom", "/joint_states", "/setpoint"))
    point = messages["/position"][0][1]

    assert (point.x, point.y, point.z) == (10.0, 11.0, 0.0)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom_frame", "base_frame")
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (1_700_000_000, 30_000_000)
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (10.0, 11.0)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (12.0, 13.0)
    assert list(joints.name) == ["left_joint", "right_joint"]
    assert (list(joints.position), list(joints.velocity)) == ([14.0, 15.0], [16.0, 17.0])
    assert (setpoint.twist.linear.x, setpoint.twist.angular.z) == (3.5, -0.25)


def test_an_imu_is_on_its_topic_where_there_is_one(
    tmp_path: Path, layout: Layout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    signals = [f"imu.{quantity}_{axis}" for quantity in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    fields = {name: getattr(layout, name) for name in layout.__struct_fields__}
    log = CycleLog(path, Layout(**fields | {"published": (*layout.published, *signals)}))
    plain = record(3)
    log.write(plain._replace(published=(*plain.published, 20.0, 21.0, 22.0, 23.0, 24.0, 25.0)))
    log.close()
    types, messages = read(path)
    (imu,) = [message for _, message in messages["/imu/data"]]

    assert types["/imu/data"] == "sensor_msgs/msg/Imu"
    assert (imu.header.frame_id, imu.header.stamp.sec, imu.header.stamp.nanosec) == (
        "imu_link",
        1_700_000_000,
        30_000_000,
    )
    assert [getattr(imu.angular_velocity, axis) for axis in "xyz"] == [20.0, 21.0, 22.0]
    assert [getattr(imu.linear_acceleration, axis) for axis in "xyz"] == [23.0, 24.0, 25.0]
    assert {topic: types[topic] for topic in COMMON} == COMMON


def test_a_robot_that_publishes_neither_pose_nor_joints_has_no_such_topics(
    tmp_path: Path, layout: Layout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    bare = Layout(**{name: getattr(layout, name) for name in layout.__struct_fields__} | {"published": ()})
    log = CycleLog(path, bare)
    log.write(record(0)._replace(published=()))
    log.close()
    types, _ = read(path)

    assert set(COMMON) & set(types) == {"/setpoint"}


def test_diagnostics_and_attachments_are_kept(tmp_path: Path, layout: Layout) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout)
    log.write_diagnostics(START_NS, [Status(Level.WARN, "board", "warm", {"temperature": "81"})])
    log.attach("robot.yaml", "text/plain", b"name: testbot")
    log.close()
    _, messages = read(path)
    (status,) = messages["/diagnostics"][0][1].status
    with path.open("rb") as stream:
        reader = make_reader(stream)
        (attachment,) = reader.iter_attachments()
        (metadata,) = reader.iter_metadata()

    assert (status.level, status.name, status.message) == (1, "board", "warm")
    assert [(pair.key, pair.value) for pair in status.values] == [("temperature", "81")]
    assert (attachment.name, attachment.media_type, attachment.data) == ("robot.yaml", "text/plain", b"name: testbot")
    assert (metadata.name, metadata.metadata) == ("robot", {"name": "testbot"})


class Keeper:
    """Writes the log and remembers what it was given."""

    def __init__(self, log: CycleLog) -> None:
        self.records: list[CycleRecord] = []
        self._log = log
        self.write_diagnostics = log.write_diagnostics
        self.close = log.close

    def write(self, record: CycleRecord) -> None:
        self.records.append(record)
        self._log.write(record)


def test_the_log_of_a_run_holds_the_numbers_of_the_run(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    layout = layout_of(robot)
    keeper = Keeper(CycleLog(path, layout))
    stage = ManoeuvreStage(
        Player(single_segment(2.0, 2.0, 0.2), lead_ns=50_000_000), list(robot.wiring.published), robot.clock
    )
    robot.loop(stage, keeper).run(30)
    types, messages = read(path)

    assert {topic: types[topic] for topic in COMMON} == COMMON
    assert set(types) - set(COMMON) - {"/diagnostics"} == {
        *(f"/model/{output.name}" for output in robot.model.outputs),
        *(f"/timing/{phase}" for phase in TIMING),
    }
    assert len(keeper.records) > 20
    for index, output in enumerate(layout.outputs):
        logged = [(stamp_ns, message.data) for stamp_ns, message in messages[f"/model/{output}"]]
        assert logged == [(kept.stamp_ns, kept.y[index]) for kept in keeper.records]
    assert [message.x for _, message in messages["/position"]] == [kept.published[0] for kept in keeper.records]
    assert [message.twist.linear.x for _, message in messages["/setpoint"]] == [
        kept.setpoint.linear_velocity for kept in keeper.records
    ]
    assert max(kept.setpoint.linear_velocity for kept in keeper.records) == 2.0


def test_a_layout_names_what_each_cycle_of_the_robot_holds() -> None:
    robot = build_robot(load_robot("cart-can"), LockstepRig(500_000))
    layout = layout_of(robot)

    assert layout.robot == "cart-can"
    assert layout.sensors == ("left.angle", "left.velocity", "right.angle", "right.velocity", "supply.voltage")
    assert layout.inputs == ("LeftVelocity", "RightVelocity")
    assert layout.outputs[-2:] == ("LeftVoltage", "RightVoltage")
    assert layout.commands == ("left.voltage", "right.voltage")
    assert (layout.odometry_frame, layout.base_frame) == ("odom", "base_link")
    assert layout.joints == ("left_wheel_joint", "right_wheel_joint")
    assert "odometry.x" in layout.published
