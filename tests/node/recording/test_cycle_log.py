# SPDX-License-Identifier: MIT
import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from msgspec.structs import replace

from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, HardwareAnswer
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import CycleLayout, Provenance, field_names, layout_of, surroundings
from segway_ecc.node.robot import build_robot
from segway_ecc.node.sequence.manoeuvre import ManoeuvreStage, Player, single_segment

START_NS = 1_700_000_000_000_000_000
COMMON = {
    "/cycle": "segway_ecc/msg/Cycle",
    "/odom": "nav_msgs/msg/Odometry",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/setpoint": "geometry_msgs/msg/TwistStamped",
}


def read(path: Path) -> tuple[dict[str, str], dict[str, list[tuple[int, Any]]]]:
    """The type of each topic, and each topic's messages with their log time."""
    types, messages = {}, defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, record, message in reader.iter_decoded_messages():
            types[channel.topic] = schema.name if schema else ""
            messages[channel.topic].append((record.log_time, message))
    return types, messages


def test_a_cycle_is_one_message_with_a_field_for_every_name(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout)
    log.write(record(4))
    log.close()
    types, messages = read(path)
    ((_, cycle),) = messages["/cycle"]

    assert types == COMMON
    assert (cycle.header.stamp.sec, cycle.header.stamp.nanosec) == (1_700_000_000, 40_000_000)
    assert (cycle.cycle, cycle.start_ns, cycle.lateness_ns, cycle.mode, cycle.ready) == (4, 77, 1000, 1, True)
    assert (cycle.setpoint.linear_velocity, cycle.setpoint.angular_velocity) == (4.5, -0.25)
    assert (cycle.sensor.left_angle, cycle.sensor.left_velocity) == (1.5, 2.5)
    assert (cycle.age_s.left_angle, cycle.age_s.left_velocity) == (0.001, 0.002)
    assert (cycle.valid.left_angle, cycle.valid.left_velocity) == (True, True)
    assert cycle.model_input.left_velocity == 3.5
    assert (cycle.model_output.x, cycle.model_output.motor_voltage, cycle.model_output.sub_port_1) == (4.5, 5.5, 6.5)
    assert (cycle.command.left_voltage, cycle.command.right_voltage) == (7.5, 8.5)
    assert (cycle.published.odometry_x, cycle.published.right_velocity) == (10.0, 17.0)
    assert (cycle.duration_ns.exchange, cycle.duration_ns.ros, cycle.duration_ns.limit) == (10**6, 2 * 10**6, 5 * 10**6)
    assert {stamp_ns for found in messages.values() for stamp_ns, _ in found} == {START_NS + 40_000_000}


def test_events_precede_their_cycle_and_only_where_there_are_any(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout)
    log.write(record(0))
    log.write(replace(record(1), answers=[HardwareAnswer("arm", ("too hot",))]))
    log.close()
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = [
            (channel.topic, message.cycle, message.events)
            for _, channel, _, message in reader.iter_decoded_messages(
                ["/cycle", "/cycle_events"], log_time_order=False
            )
        ]

    assert found == [("/cycle", 0, 0), ("/cycle_events", 1, ['["answer","arm",["too hot"]]']), ("/cycle", 1, 1)]


def test_structured_messages_carry_the_frames_joints_and_stamp(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout)
    log.write(record(3))
    log.close()
    _, messages = read(path)
    odometry, joints, setpoint = (messages[topic][0][1] for topic in ("/odom", "/joint_states", "/setpoint"))

    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom_frame", "base_frame")
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (1_700_000_000, 30_000_000)
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (10.0, 11.0)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (12.0, 13.0)
    assert list(joints.name) == ["left_joint", "right_joint"]
    assert (list(joints.position), list(joints.velocity)) == ([14.0, 15.0], [16.0, 17.0])
    assert (setpoint.twist.linear.x, setpoint.twist.angular.z) == (3.5, -0.25)


@pytest.mark.parametrize(("right_torque", "expected"), [(0.5, [-0.25, 0.5]), (math.nan, [])])
def test_joints_carry_the_torques_where_all_are_measured(
    tmp_path: Path,
    layout: CycleLayout,
    record: Callable[[int], CycleRecord],
    right_torque: float,
    expected: list[float],
) -> None:
    path = tmp_path / "run.mcap"
    fields = {name: getattr(layout, name) for name in layout.__struct_fields__}
    published = (*layout.published, "left.torque", "right.torque")
    log = CycleLog(path, CycleLayout(**fields | {"published": published}))
    plain = record(3)
    log.write(replace(plain, published=(*plain.published, -0.25, right_torque)))
    log.close()
    _, messages = read(path)
    ((_, joints),) = messages["/joint_states"]
    assert (list(joints.position), list(joints.effort)) == ([14.0, 15.0], expected)


def test_an_imu_is_on_its_topic_where_there_is_one(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    signals = [f"imu.{quantity}_{axis}" for quantity in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    fields = {name: getattr(layout, name) for name in layout.__struct_fields__}
    log = CycleLog(path, CycleLayout(**fields | {"published": (*layout.published, *signals)}))
    plain = record(3)
    log.write(replace(plain, published=(*plain.published, 20.0, 21.0, 22.0, 23.0, 24.0, 25.0)))
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
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    path = tmp_path / "run.mcap"
    bare = CycleLayout(**{name: getattr(layout, name) for name in layout.__struct_fields__} | {"published": ()})
    log = CycleLog(path, bare)
    log.write(replace(record(0), published=()))
    log.close()
    types, _ = read(path)

    assert set(types) == {"/cycle", "/setpoint"}


def test_diagnostics_and_attachments_are_kept(tmp_path: Path, layout: CycleLayout) -> None:
    path = tmp_path / "run.mcap"
    log = CycleLog(path, layout, Provenance({"robot.yaml": "name: testbot"}, {"model": {"sha256": "12"}}))
    log.write_diagnostics(START_NS, [DiagnosticStatus(Level.WARN, "board", "warm", {"temperature": "81"})])
    log.close()
    _, messages = read(path)
    (status,) = messages["/diagnostics"][0][1].status
    with path.open("rb") as stream:
        reader = make_reader(stream)
        attachments = {found.name: found.data for found in reader.iter_attachments()}
        metadata = {found.name: found.metadata for found in reader.iter_metadata()}

    assert (status.level, status.name, status.message) == (1, "board", "warm")
    assert [(pair.key, pair.value) for pair in status.values] == [("temperature", "81")]
    assert attachments.pop("robot.yaml") == b"name: testbot"
    assert list(attachments) == ["part.json", "layout.json", "end.json"]
    assert msgspec.json.decode(attachments["layout.json"], type=CycleLayout) == layout
    assert metadata.pop("counts") == {"/diagnostics": "1"}
    assert metadata.pop("channel 1")["topic"] == "/diagnostics"
    assert metadata == {"robot": {"name": "testbot"}, "model": {"sha256": "12"}, **surroundings()}


class Keeper:
    """Writes the log and remembers what it was given."""

    def __init__(self, log: CycleLog) -> None:
        self.records: list[CycleRecord] = []
        self._log = log
        self.write_diagnostics = log.write_diagnostics
        self.write_state = log.write_state
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
        Player(single_segment(2.0, 2.0, 0.2)), list(robot.wiring.published), robot.clock, lead_ns=50_000_000
    )
    robot.loop(stage, keeper).run(30)
    types, messages = read(path)

    assert types == {**COMMON, "/cycle_events": "segway_ecc/msg/CycleEvents"}
    assert len(keeper.records) > 20
    assert len(messages["/cycle"]) == len(keeper.records)
    for output, field in zip(layout.outputs, field_names(layout.outputs), strict=True):
        logged = [(stamp_ns, getattr(message.model_output, field)) for stamp_ns, message in messages["/cycle"]]
        index = layout.outputs.index(output)
        assert logged == [(kept.stamp_ns, kept.y[index]) for kept in keeper.records]
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
