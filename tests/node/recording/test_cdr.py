# SPDX-License-Identifier: MIT
import importlib
import re
import struct
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap_ros2.decoder import DecoderFactory

from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.cdr import (
    DIAGNOSTIC_ARRAY,
    FLOAT64,
    IMU,
    JOINT_STATE,
    ODOMETRY,
    POINT,
    SCHEMAS,
    TWIST_STAMPED,
)

# ROS's type support imports `lark`, which imports a module that Python deprecates.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

FORMATS = {"double": "d", "int32": "i", "uint32": "I", "octet": "B"}
STAMP_NS = 1_700_000_000_123_456_789

numbers = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20)
stamps = st.integers(0, 2**31 * 10**9 - 1)
vectors = st.tuples(numbers, numbers, numbers)
covariances = st.lists(numbers, min_size=36, max_size=36)
poses = st.builds(cdr.Pose, vectors, st.tuples(numbers, numbers, numbers, numbers), covariances)
twists = st.builds(cdr.Twist, vectors, vectors, covariances)
statuses = st.lists(
    st.builds(DiagnosticStatus, st.sampled_from(Level), texts, texts, st.dictionaries(texts, texts, max_size=3)),
    max_size=3,
)


class Reference:
    """Plain CDR by the book, driven by a ROS message's own fields, that knows which bytes are padding."""

    def __init__(self, message: Any) -> None:
        self.body = bytearray()
        self.padding: list[int] = []
        self.put("message", message)

    def put_number(self, form: str, value: Any) -> None:
        while len(self.body) % struct.calcsize(form):
            self.padding.append(len(self.body))
            self.body.append(0)
        self.body += struct.pack(f"<{form}", value)

    def put(self, kind: str, value: Any) -> None:
        sequence = re.fullmatch(r"sequence<(.+)>|(.+)\[\d+\]", kind)
        if kind == "string":
            encoded = value.encode() + b"\0"
            self.put_number("I", len(encoded))
            self.body += encoded
        elif sequence:
            if sequence[1]:
                self.put_number("I", len(value))
            for element in value:
                self.put(sequence[1] or sequence[2], element)
        elif kind in FORMATS:
            self.put_number(FORMATS[kind], value[0] if kind == "octet" else value)
        else:
            for name, part in value.get_fields_and_field_types().items():
                self.put(part, getattr(value, name))


def ros(type_name: str, **fields: Any) -> Any:
    package, _, short = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), short)(**fields)


def ros_header(stamp_ns: int, frame_id: str) -> Any:
    sec, nanosec = divmod(stamp_ns, 10**9)
    time = ros("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return ros("std_msgs/msg/Header", stamp=time, frame_id=frame_id)


def ros_vector(kind: str, values: Sequence[float]) -> Any:
    return ros(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", values, strict=False)))


def ros_twist(twist: cdr.Twist) -> Any:
    linear, angular = ros_vector("Vector3", twist.linear), ros_vector("Vector3", twist.angular)
    return ros("geometry_msgs/msg/Twist", linear=linear, angular=angular)


def ros_status(status: DiagnosticStatus) -> Any:
    values = [ros("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in status.values.items()]
    return ros(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=bytes([status.level]),
        name=status.name,
        message=status.message,
        values=values,
    )


def decoded(type_name: str, data: bytes) -> Any:
    schema = Schema(id=1, data=SCHEMAS[type_name].encode(), encoding=SchemaEncoding.ROS2, name=type_name)
    decode = DecoderFactory().decoder_for(MessageEncoding.CDR, schema)
    assert decode is not None
    return decode(data)


def same_fields(ours: Any, theirs: Any) -> bool:
    if hasattr(theirs, "get_fields_and_field_types"):
        return all(
            same_fields(getattr(ours, name), getattr(theirs, name)) for name in theirs.get_fields_and_field_types()
        )
    if isinstance(theirs, str):
        return bool(ours == theirs)
    if isinstance(theirs, bytes):
        return bool(ours == theirs[0])
    if hasattr(theirs, "__len__"):
        return len(ours) == len(theirs) and all(map(same_fields, ours, theirs))
    return bool(ours == theirs)


def check(type_name: str, data: bytes, message: Any) -> None:
    serialization = importlib.import_module("rclpy.serialization")
    reference = Reference(message)
    assert data == b"\x00\x01\x00\x00" + reference.body
    # rclpy leaves padding as it found the memory, and rounds the length up by its estimate: those bytes mean nothing.
    theirs = bytearray(serialization.serialize_message(message))
    for offset in reference.padding:
        theirs[4 + offset] = 0
    assert data == theirs[: len(data)]
    assert serialization.deserialize_message(data, type(message)) == message
    assert same_fields(decoded(type_name, data), message)


@pytest.mark.ros
@given(numbers)
def test_float64_is_what_ros_writes(value: float) -> None:
    check(FLOAT64, cdr.float64(value), ros(FLOAT64, data=value))


@pytest.mark.ros
@given(vectors)
def test_point_is_what_ros_writes(position: cdr.Vector) -> None:
    check(POINT, cdr.point(*position), ros_vector("Point", position))


@pytest.mark.ros
@given(stamps, texts, twists)
def test_twist_is_what_ros_writes(stamp_ns: int, frame_id: str, twist: cdr.Twist) -> None:
    message = ros(TWIST_STAMPED, header=ros_header(stamp_ns, frame_id), twist=ros_twist(twist))
    check(TWIST_STAMPED, cdr.twist_stamped(stamp_ns, frame_id, twist), message)


@pytest.mark.ros
@given(stamps, texts, texts, poses, twists)
@example(0, "", "", cdr.Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), cdr.Twist((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
@example(
    STAMP_NS, "ödöm", "基", cdr.Pose((1.0, 2.0, 0.0), (0.0, 0.0, 0.6, 0.8)), cdr.Twist((1.0, 0.0, 0.0), (0.0, 0.0, 2.0))
)
def test_odometry_is_what_ros_writes(
    stamp_ns: int, frame_id: str, child_frame_id: str, pose: cdr.Pose, twist: cdr.Twist
) -> None:
    position = ros_vector("Point", pose.position)
    orientation = ros_vector("Quaternion", pose.orientation)
    ros_pose = ros("geometry_msgs/msg/Pose", position=position, orientation=orientation)
    message = ros(
        ODOMETRY,
        header=ros_header(stamp_ns, frame_id),
        child_frame_id=child_frame_id,
        pose=ros("geometry_msgs/msg/PoseWithCovariance", pose=ros_pose, covariance=list(pose.covariance)),
        twist=ros("geometry_msgs/msg/TwistWithCovariance", twist=ros_twist(twist), covariance=list(twist.covariance)),
    )
    check(ODOMETRY, cdr.odometry(stamp_ns, frame_id, child_frame_id, pose, twist), message)


@pytest.mark.ros
@given(stamps, texts, st.lists(texts, max_size=4), *(st.lists(numbers, max_size=4) for _ in range(3)))
def test_joint_state_is_what_ros_writes(  # noqa: PLR0913, PLR0917 - the fields of the message
    stamp_ns: int,
    frame_id: str,
    names: list[str],
    positions: list[float],
    velocities: list[float],
    efforts: list[float],
) -> None:
    header = ros_header(stamp_ns, frame_id)
    message = ros(JOINT_STATE, header=header, name=names, position=positions, velocity=velocities, effort=efforts)
    check(JOINT_STATE, cdr.joint_state(stamp_ns, frame_id, tuple(names), positions, velocities, efforts), message)


@pytest.mark.ros
@given(stamps, texts, vectors, vectors)
@example(STAMP_NS, "imu_link", (0.1, -0.2, 0.3), (0.0, 0.0, 9.81))
def test_imu_is_what_ros_writes(stamp_ns: int, frame_id: str, rate: cdr.Vector, force: cdr.Vector) -> None:
    message = ros(
        IMU,
        header=ros_header(stamp_ns, frame_id),
        orientation=ros_vector("Quaternion", (0.0, 0.0, 0.0, 1.0)),
        orientation_covariance=[-1.0, *[0.0] * 8],
        angular_velocity=ros_vector("Vector3", rate),
        linear_acceleration=ros_vector("Vector3", force),
    )
    check(IMU, cdr.imu(stamp_ns, frame_id, rate, force), message)


@pytest.mark.ros
@given(stamps, texts, statuses)
@example(
    STAMP_NS,
    "",
    [
        DiagnosticStatus(Level.ERROR, "motor 左", "überlastet", {"": "", "°C": "81"}),
        DiagnosticStatus(Level.OK, "", "", {}),
    ],
)
def test_diagnostics_are_what_ros_writes(stamp_ns: int, frame_id: str, listed: list[DiagnosticStatus]) -> None:
    header = ros_header(stamp_ns, frame_id)
    message = ros(DIAGNOSTIC_ARRAY, header=header, status=list(map(ros_status, listed)))
    check(DIAGNOSTIC_ARRAY, cdr.diagnostic_array(stamp_ns, frame_id, listed), message)


def test_the_bytes_of_a_small_message_match_the_format() -> None:
    twist = cdr.Twist((0.5, 0.0, 0.0), (0.0, 0.0, 0.0))
    expected = "00010000 01000000 02000000 02000000 61000000 000000000000e03f" + 5 * "0000000000000000"
    assert cdr.twist_stamped(1_000_000_002, "a", twist) == bytes.fromhex(expected)


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), -0.0, 5e-324])
def test_a_number_that_is_not_ordinary_survives(value: float) -> None:
    assert struct.pack("d", decoded(FLOAT64, cdr.float64(value)).data) == struct.pack("d", value)
    assert str(decoded(FLOAT64, cdr.float64(float("nan"))).data) == "nan"


def test_text_that_cdr_cannot_hold_is_shown_as_escapes() -> None:
    data = cdr.diagnostic_array(0, "", [DiagnosticStatus(Level.OK, "a\0b", "\udc80", {})])
    status = decoded(DIAGNOSTIC_ARRAY, data).status[0]
    assert (status.name, status.message) == (r"a\x00b", r"\udc80")


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_a_time_that_does_not_fit_is_refused(stamp_ns: int) -> None:
    with pytest.raises(RecordingError, match=f"time stamp {stamp_ns} ns lies outside"):
        cdr.diagnostic_array(stamp_ns, "", [])
