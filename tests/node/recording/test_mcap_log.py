# SPDX-License-Identifier: MIT
import math
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message, Statistics
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cdr import SCHEMAS
from segway_ecc.node.recording.mcap_log import CHUNK_BYTES, McapLog

START_NS = 1_700_000_000_000_000_000
TYPES = {
    "/battery_V": "std_msgs/msg/Float64",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/imu/data": "sensor_msgs/msg/Imu",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/odom": "nav_msgs/msg/Odometry",
    "/target": "geometry_msgs/msg/Point",
}


def write_run(target: Path | BytesIO) -> None:
    with McapLog(target, frame_id="odom", child_frame_id="base_link", joint_names=("left", "right")) as log:
        log.metadata("run", {"software": "0.1.0", "größe": "1 m"})
        log.float64("/battery_V", START_NS, 24.5)
        log.point("/target", START_NS + 1, 1.0, 2.0, 3.0)
        log.twist("/cmd_vel", START_NS + 2, 0.5, -0.25)
        log.odometry("/odom", START_NS + 3, 1.0, 2.0, math.pi / 2, 0.5, -0.25)
        log.joint_state("/joint_states", START_NS + 4, (1.0, 2.0), ())
        log.diagnostics("/diagnostics", START_NS + 5, [DiagnosticStatus(Level.WARN, "drive", "warm", {"°C": "81"})])
        log.attach("robot.yaml", "application/yaml", b"name: segway")
        log.imu("/imu/data", START_NS + 6, "imu_link", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
        log.float64("/battery_V", START_NS + 7, 24.25)


def read(path: Path) -> list[tuple[str, Message, Any]]:
    """Topic, record and decoded message of all that the file holds, by log time."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [(channel.topic, record, message) for _, channel, record, message in reader.iter_decoded_messages()]


def numbers(path: Path) -> list[float]:
    return [message.data for _, _, message in read(path)]


def kept_count(data: bytes) -> int:
    """How many messages a reader finds in a file that ends early."""
    count = 0
    try:
        for record in StreamReader(BytesIO(data)).records:
            count += isinstance(record, Message)
    except EndOfFile:
        pass
    return count


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = tmp_path / "runs" / "today" / "run.mcap"
    write_run(path)
    return path


def check_values(messages: dict[str, Any]) -> None:
    assert messages["/battery_V"].data == 24.25
    assert [getattr(messages["/target"], axis) for axis in "xyz"] == [1.0, 2.0, 3.0]
    assert messages["/cmd_vel"].header.frame_id == "base_link"
    assert (messages["/cmd_vel"].twist.linear.x, messages["/cmd_vel"].twist.angular.z) == (0.5, -0.25)
    odometry = messages["/odom"]
    assert (odometry.header.stamp.sec, odometry.header.stamp.nanosec) == (1_700_000_000, 3)
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (1.0, 2.0)
    turn = odometry.pose.pose.orientation
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.5, -0.25)
    assert list(odometry.pose.covariance) == list(odometry.twist.covariance) == [0.0] * 36
    joints = messages["/joint_states"]
    assert (list(joints.name), list(joints.position), list(joints.velocity)) == (["left", "right"], [1.0, 2.0], [])
    imu = messages["/imu/data"]
    assert (imu.header.frame_id, imu.header.stamp.nanosec) == ("imu_link", 6)
    assert [getattr(imu.angular_velocity, axis) for axis in "xyz"] == [1.0, 2.0, 3.0]
    assert [getattr(imu.linear_acceleration, axis) for axis in "xyz"] == [4.0, 5.0, 6.0]
    assert [getattr(imu.orientation, axis) for axis in "xyzw"] == [0.0, 0.0, 0.0, 1.0]
    assert list(imu.orientation_covariance) == [-1.0] + [0.0] * 8
    assert list(imu.angular_velocity_covariance) == list(imu.linear_acceleration_covariance) == [0.0] * 9
    (status,) = messages["/diagnostics"].status
    assert (status.level, status.name, status.message, status.hardware_id) == (1, "drive", "warm", "")
    assert [(pair.key, pair.value) for pair in status.values] == [("°C", "81")]


def test_ros2_support_reads_every_message_back(run: Path) -> None:
    found = read(run)
    check_values({topic: message for topic, _, message in found})
    assert [record.log_time for _, record, _ in found] == [START_NS + step for step in range(8)]
    assert [record.publish_time for _, record, _ in found] == [START_NS + step for step in range(8)]


def test_rosbags_reads_every_message_back_from_the_file_alone(run: Path) -> None:
    with AnyReader([run]) as reader:
        assert {connection.topic: connection.msgtype for connection in reader.connections} == TYPES
        assert reader.message_count == 8
        messages = {c.topic: reader.deserialize(data, c.msgtype) for c, _, data in reader.messages()}
    check_values(messages)


def test_the_summary_lists_what_the_file_holds(run: Path) -> None:
    with run.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        (attachment,) = reader.iter_attachments()
        *topics, counts, metadata = sorted(reader.iter_metadata(), key=lambda found: found.name)
    assert summary is not None
    assert {schema.name: schema.data.decode() for schema in summary.schemas.values()} == SCHEMAS
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()} == TYPES
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    statistics = summary.statistics
    assert isinstance(statistics, Statistics)
    assert (statistics.message_count, statistics.attachment_count, statistics.metadata_count) == (8, 1, 2 + len(TYPES))
    assert (statistics.message_start_time, statistics.message_end_time) == (START_NS, START_NS + 7)
    assert (attachment.name, attachment.media_type) == ("robot.yaml", "application/yaml")
    assert attachment.data == b"name: segway"
    assert attachment.log_time == START_NS + 5
    assert {found.metadata["topic"]: found.metadata["type"] for found in topics} == TYPES
    assert (counts.name, counts.metadata.keys()) == ("counts", TYPES.keys())
    assert sum(map(int, counts.metadata.values())) == 8
    assert (metadata.name, metadata.metadata) == ("run", {"software": "0.1.0", "größe": "1 m"})


def test_a_stream_gets_the_same_bytes_as_a_file_and_stays_open(run: Path) -> None:
    stream = BytesIO()
    write_run(stream)
    assert stream.getvalue() == run.read_bytes()


def test_a_run_without_messages_is_a_valid_file(tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    McapLog(str(path)).close()
    assert read(path) == []


def test_a_crash_loses_at_most_one_chunk(tmp_path: Path) -> None:
    path = tmp_path / "crash.mcap"
    log = McapLog(path)
    count = 2000
    for step in range(count):
        log.odometry("/odom", START_NS + step, 0.0, 0.0, 0.0, float(step), 0.0)
    left_behind = path.read_bytes()
    log.close()
    assert len(read(path)) == count
    assert count - kept_count(left_behind) <= CHUNK_BYTES // 700


def test_one_topic_cannot_hold_two_types(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with McapLog(path) as log:
        log.float64("/speed", START_NS, 1.0)
        with pytest.raises(
            RecordingError, match=r"/speed in .*run\.mcap holds std_msgs/msg/Float64 .* use another topic"
        ):
            log.point("/speed", START_NS, 0.0, 0.0, 0.0)
        log.float64("/speed", START_NS + 1, 2.0)
    assert numbers(path) == [1.0, 2.0]


def test_joints_without_a_value_each_are_refused(tmp_path: Path) -> None:
    with (
        McapLog(tmp_path / "run.mcap", joint_names=("left", "right")) as log,
        pytest.raises(RecordingError, match="1 positions and 2 velocities for 2 joints"),
    ):
        log.joint_state("/joint_states", START_NS, (1.0,), (1.0, 2.0))


@pytest.mark.parametrize("stamp_ns", [-1, 2**63, 0.5])
def test_a_bad_time_is_refused_and_leaves_the_file_sound(tmp_path: Path, stamp_ns: int) -> None:
    path = tmp_path / "run.mcap"
    with McapLog(path) as log:
        log.float64("/a", START_NS, 1.0)
        with pytest.raises((RecordingError, TypeError)):
            log.float64("/a", stamp_ns, 2.0)
        log.float64("/a", START_NS, 3.0)
    assert numbers(path) == [1.0, 3.0]


def test_text_that_is_not_unicode_leaves_the_file_sound(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with McapLog(path) as log:
        log.metadata("\udc80", {"\udc81": "\udc82"})
        log.attach("\udc83", "\udc84", b"")
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert [entry.metadata for entry in reader.iter_metadata()] == [{r"\udc81": r"\udc82"}]
        assert [entry.name for entry in reader.iter_attachments()] == [r"\udc83"]


def test_a_path_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "run.mcap", tmp_path):
        with pytest.raises(RecordingError, match=r"cannot be written .* that this user can write"):
            McapLog(path)


def test_a_full_disk_is_reported_at_the_start() -> None:
    with pytest.raises(RecordingError, match=r"/dev/full failed .*No space left"):
        McapLog("/dev/full")


class Filling(BytesIO):
    """A disk that is full once set so."""

    full = False

    def write(self, data: Any, /) -> int:
        if self.full:
            raise OSError(28, "No space left on device")
        return super().write(data)


@pytest.mark.parametrize(
    "act",
    [
        lambda log: log.float64("/a", START_NS, 1.0),
        lambda log: log.attach("a", "b", b"c"),
        lambda log: log.metadata("a", {}),
        lambda log: log.close(),
    ],
)
def test_a_disk_that_fills_up_ends_the_log_once(act: Callable[[McapLog], None]) -> None:
    stream = Filling()
    log = McapLog(stream, chunk_bytes=1)
    log.float64("/a", START_NS, 1.0)
    stream.full = True
    with pytest.raises(RecordingError, match="No space left"):
        act(log)
    log.close()
    with pytest.raises(RecordingError, match="is closed"):
        log.float64("/a", START_NS, 1.0)
    assert kept_count(stream.getvalue()) == 1


def test_a_closed_log_takes_nothing_more(tmp_path: Path) -> None:
    log = McapLog(tmp_path / "run.mcap")
    log.close()
    log.close()
    with pytest.raises(RecordingError, match=r"run\.mcap is closed"):
        log.attach("a", "b", b"")
    with pytest.raises(RecordingError, match=r"run\.mcap is closed"):
        log.metadata("a", {})
