# SPDX-License-Identifier: MIT
"""The log of a run: an MCAP file that Foxglove, PlotJuggler and `rosbags` open without ROS.

The container is MCAP (https://mcap.dev/spec) with profile `ros2`, schema encoding `ros2msg` and
message encoding `cdr`. Units and axes follow REP-103: metres, radians, seconds, x forward, z up.
"""

import contextlib
import errno
import math
import os
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from io import BufferedIOBase
from os import PathLike
from pathlib import Path
from typing import IO, Final, Self, cast

from mcap.opcode import Opcode
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import RecordingError, printable
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.log_quota import lock_log

CHUNK_BYTES: Final = 256 * 1024
"""Messages are written once this many bytes are waiting, so a crash loses no more than that."""

CHANNEL: Final = "channel "
"""With its number, the name of the metadata that repeat a topic, which else stands in one chunk alone."""
COUNTS: Final = "counts"
"""Name of the metadata of a log that was closed: how many messages each topic has."""
MISSING: Final = "missing"
"""Name of the metadata of a log that not all reached: how many `messages`."""
REPAIR: Final = "repair"
"""Name of the metadata of a repaired log: what it lacks."""

# How a file ends while it is written, so that any reader takes it as one without a summary (https://mcap.dev/spec): the
# end of the data without a checksum, a footer without a summary, and the magic.
_PROVISIONAL_END: Final = struct.pack("<BQI", Opcode.DATA_END, 4, 0) + struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0)
# Every record is longer than this, so a finished chunk passes the buffer and reaches the kernel at once.
_BUFFER_BYTES: Final = 2


class McapLog:
    """Writes one run's log. One thread writes; close it, or use it as a context manager, to finish the file.

    Topics come into being with their first message. `stamp_ns` is always ns since the epoch, and is both the log
    time and the publish time. A file that exists is overwritten. After storage has failed once, the log is closed:
    what was written before stays readable.

    Args:
        target: The file to write, whose directories are made as needed; or a binary stream, which is not closed.
        frame_id: The fixed frame that poses are in, as `odom`.
        child_frame_id: The frame on the robot that velocities are in, as `base_link`.
        joint_names: One name per joint, in the order of `joint_state`'s values.
        chunk_bytes: How many bytes of messages may wait in memory.

    Attributes:
        size: Of the file when it was flushed last, bytes.
        is_open: Whether it takes messages.

    Raises:
        RecordingError: If the file cannot be written.
    """

    def __init__(
        self,
        target: str | PathLike[str] | BufferedIOBase,
        *,
        frame_id: str = "odom",
        child_frame_id: str = "base_link",
        joint_names: Sequence[str] = (),
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        self._frame_id = frame_id
        self._child_frame_id = child_frame_id
        self._joint_names = tuple(joint_names)
        self._channels: dict[str, tuple[str, int]] = {}
        self._schema_ids: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._last_stamp_ns = 0
        self.size = 0
        self._stream, self._where, self._owns_stream = _open_stream(target)
        self.is_open = True
        # LZ4 rather than Zstandard: a third more bytes, but the cycle that completes a chunk is delayed less.
        # The data's checksum is of what stands outside of chunks, which have their own.
        self._writer = Writer(
            self._stream, chunk_size=chunk_bytes, compression=CompressionType.LZ4, enable_data_crcs=True
        )
        with self._storing():
            self._writer.start(profile=Profile.ROS2, library="segway-ecc")

    def float64(self, topic: str, stamp_ns: int, value: float) -> None:
        """Logs one number in the unit that the topic's name gives, as std_msgs/Float64."""
        self.add(topic, cdr.FLOAT64, stamp_ns, cdr.float64(value))

    def point(self, topic: str, stamp_ns: int, x: float, y: float, z: float) -> None:
        """Logs a geometry_msgs/Point; coordinates in metres."""
        self.add(topic, cdr.POINT, stamp_ns, cdr.point(x, y, z))

    def twist(self, topic: str, stamp_ns: int, linear_m_s: float, angular_rad_s: float) -> None:
        """Logs a forward velocity in m/s and a yaw rate in rad/s, as geometry_msgs/TwistStamped in the child frame."""
        twist = cdr.Twist((linear_m_s, 0.0, 0.0), (0.0, 0.0, angular_rad_s))
        self.add(topic, cdr.TWIST_STAMPED, stamp_ns, cdr.twist_stamped(stamp_ns, self._child_frame_id, twist))

    def odometry(  # noqa: PLR0913, PLR0917 - one planar state, in the order every caller has it
        self,
        topic: str,
        stamp_ns: int,
        x: float,
        y: float,
        heading: float,
        linear_velocity: float,
        angular_velocity: float,
    ) -> None:
        """Logs a planar nav_msgs/Odometry with covariances of zero, which mean unknown.

        Args:
            topic: Where it belongs.
            stamp_ns: Time in ns.
            x: Position in the fixed frame in metres.
            y: Position in the fixed frame in metres.
            heading: Angle about z from the fixed frame's x axis, counter-clockwise, in rad.
            linear_velocity: Along the child frame's x axis in m/s.
            angular_velocity: About z in rad/s.
        """
        pose = cdr.Pose((x, y, 0.0), (0.0, 0.0, math.sin(0.5 * heading), math.cos(0.5 * heading)))
        twist = cdr.Twist((linear_velocity, 0.0, 0.0), (0.0, 0.0, angular_velocity))
        data = cdr.odometry(stamp_ns, self._frame_id, self._child_frame_id, pose, twist)
        self.add(topic, cdr.ODOMETRY, stamp_ns, data)

    def joint_state(
        self,
        topic: str,
        stamp_ns: int,
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float] = (),
    ) -> None:
        """Logs a sensor_msgs/JointState: rad, rad/s and N m, each one per joint name, or empty if not measured.

        Raises:
            RecordingError: If the number of values differs from the number of joint names.
        """
        names = self._joint_names
        if not {len(positions), len(velocities), len(efforts)} <= {0, len(names)}:
            raise RecordingError(
                f"Topic {topic} in {self._where} got {len(positions)} positions and {len(velocities)} velocities for "
                f"{len(names)} joints, and {len(efforts)} efforts: pass one value per name in joint_names, or none."
            )
        data = cdr.joint_state(stamp_ns, "", names, positions, velocities, efforts)
        self.add(topic, cdr.JOINT_STATE, stamp_ns, data)

    def imu(
        self, topic: str, stamp_ns: int, frame_id: str, angular_velocity: cdr.Vector, linear_acceleration: cdr.Vector
    ) -> None:
        """Logs a sensor_msgs/Imu without orientation: rad/s and m/s2 in `frame_id`, with covariances not known."""
        self.add(topic, cdr.IMU, stamp_ns, cdr.imu(stamp_ns, frame_id, angular_velocity, linear_acceleration))

    def diagnostics(self, topic: str, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Logs a diagnostic_msgs/DiagnosticArray."""
        self.add(topic, cdr.DIAGNOSTIC_ARRAY, stamp_ns, cdr.diagnostic_array(stamp_ns, "", statuses))

    def flush(self) -> None:
        """Finishes the chunk and puts all that was logged onto the disk: no power cut takes it away any more."""
        with self._storing():
            # The library finishes a chunk by itself only when it is large.
            self._writer.flush()  # type: ignore[no-untyped-call]  # as of finish
            if self._owns_stream:
                self.size = self._stream.tell()
                self._end_provisionally()
                try:
                    os.fdatasync(self._stream.fileno())
                except OSError as error:
                    if error.errno != errno.EINVAL:  # a pipe or a device
                        raise

    def attach(self, name: str, media_type: str, data: bytes, copies: int = 1) -> None:
        """Puts a file such as the configuration into the log, at the time of the latest message.

        Of several copies a damaged byte costs one.
        """
        with self._storing():
            for _ in range(copies):
                # The creation time is not known, for which MCAP asks zero.
                self._writer.add_attachment(0, self._last_stamp_ns, printable(name), printable(media_type), data)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Puts named texts, such as the software's version, into the log."""
        with self._storing():
            self._writer.add_metadata(
                printable(name), {printable(key): printable(text) for key, text in values.items()}
            )

    def close(self) -> None:
        """Writes what is waiting and the summary, and closes the file. A second call does nothing."""
        if not self.is_open:
            return
        if self._counts:
            self.metadata(COUNTS, {topic: str(count) for topic, count in self._counts.items()})
        with self._storing():
            self._writer.finish()  # type: ignore[no-untyped-call]  # mcap annotates arguments, and this has none
            self._stream.flush()
            if self._owns_stream:
                self._stream.close()
        self.is_open = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, topic: str, type_name: str, stamp_ns: int, data: bytes, definition: str | None = None) -> None:
        """Logs a message that is encoded already; `definition` is its type's, None for one of `SCHEMAS`."""
        # A bad stamp has to be refused here: the writer would stop halfway through a record and spoil the file.
        cdr.split_stamp(stamp_ns)
        with self._storing():
            if topic not in self._channels:
                text = definition or cdr.SCHEMAS[type_name]
                if type_name not in self._schema_ids:
                    schema_id = self._writer.register_schema(type_name, SchemaEncoding.ROS2, text.encode())
                    self._schema_ids[type_name] = schema_id
                channel = self._writer.register_channel(topic, MessageEncoding.CDR, self._schema_ids[type_name])
                self._channels[topic] = (type_name, channel)
                self._counts[topic] = 0
                values = {"topic": topic, "type": type_name, "definition": text}
                self._writer.add_metadata(f"{CHANNEL}{channel}", values)
            known, channel = self._channels[topic]
            if known != type_name:
                raise RecordingError(
                    f"Topic {topic} in {self._where} holds {known} and cannot also hold {type_name}: use another topic."
                )
            self._writer.add_message(channel, stamp_ns, data, stamp_ns)
            self._counts[topic] += 1
        self._last_stamp_ns = stamp_ns

    def _end_provisionally(self) -> None:
        """End the file so that readers open it; what comes next is written over it."""
        if self._stream.seekable():
            self._stream.write(_PROVISIONAL_END + MCAP0_MAGIC)
            self._stream.seek(self.size)

    @contextlib.contextmanager
    def _storing(self) -> Iterator[None]:
        if not self.is_open:
            raise RecordingError(f"The log {self._where} is closed: write before close(), or open another log.")
        try:
            yield
        except OSError as error:
            # The writer has lost track of what reached the file, so going on would spoil what is already there.
            self.is_open = False
            if self._owns_stream:
                with contextlib.suppress(OSError):
                    self._stream.close()
            raise RecordingError(
                f"Writing the log {self._where} failed ({error}), so it ends here: free space or write it elsewhere."
            ) from error


def _open_stream(target: str | PathLike[str] | BufferedIOBase) -> tuple[IO[bytes], str, bool]:
    """Returns the stream to write, its name in messages, and whether it is ours to close."""
    if isinstance(target, BufferedIOBase):
        # The library declares its streams as IO, which the buffered ones are in fact and in type only one by one.
        return cast("IO[bytes]", target), str(getattr(target, "name", "in memory")), False
    path = Path(target)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open("wb", buffering=_BUFFER_BYTES)
    except OSError as error:
        raise RecordingError(
            f"The log {path} cannot be written ({error}): name a file in a directory that this user can write."
        ) from error
    lock_log(stream.fileno())
    return stream, str(path), True


def topic_name(group: str, name: str) -> str:
    """A valid ROS topic name: the name's hierarchy with `/`, and anything that ROS does not take as `_`."""
    hierarchy = re.sub(r"[.\\]", "/", name)
    return f"/{group}/{re.sub(r'[^A-Za-z0-9_/]', '_', hierarchy)}"
