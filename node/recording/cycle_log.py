"""Cycles as messages: what each topic of a run's log holds."""

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec

from node.cycle.cycle import PHASES
from node.cycle.seams import CycleRecord
from node.cycle.status import Status
from node.cycle.wiring import IMU_SIGNALS, JOINT_SIGNALS, ODOMETRY_SIGNALS
from node.recording.mcap_log import McapLog
from node.recording.topics import topic
from node.robot import Robot


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    """Names of everything a cycle holds, in the order it holds it."""

    robot: str
    published: tuple[str, ...]
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    commands: tuple[str, ...]
    odometry_frame: str
    base_frame: str
    imu_frame: str
    joints: tuple[str, str]


def layout_of(robot: Robot) -> Layout:
    """The layout of a robot's cycles."""
    ros = robot.file.ros
    return Layout(
        robot=robot.file.name,
        published=tuple(robot.wiring.published),
        sensors=tuple(robot.hardware.signals),
        inputs=tuple(v.name for v in robot.model.inputs),
        outputs=tuple(v.name for v in robot.model.outputs),
        commands=tuple(robot.hardware.commands),
        odometry_frame=ros.odometry_frame,
        base_frame=ros.base_frame,
        imu_frame=ros.imu_frame,
        joints=(ros.left_joint, ros.right_joint),
    )


class CycleLog:
    """An MCAP log of cycles, written where it is called; the topics bear the names they have in ROS.

    Every model port is on `model/<port>`, every command on `command/<name>`, every sensor on `sensor/<name>` with its
    age on `sensor_age/<name>`, the set-point in force on `setpoint`, and the timing, in seconds, on `timing/<phase>`.
    """

    def __init__(self, path: Path, layout: Layout) -> None:
        """Create the log.

        Raises:
            RecordingError: The file cannot be written.
        """
        self._log = McapLog(
            path, frame_id=layout.odometry_frame, child_frame_id=layout.base_frame, joint_names=layout.joints
        )
        self._log.metadata("robot", {"name": layout.robot})
        published = {signal: index for index, signal in enumerate(layout.published)}
        self._odometry = _indices(published, ODOMETRY_SIGNALS)
        self._joints = _indices(published, JOINT_SIGNALS)
        self._imu = _indices(published, IMU_SIGNALS)
        self._imu_frame = layout.imu_frame
        self._ports = [topic("model", port) for port in (*layout.inputs, *layout.outputs)]
        self._commands = [topic("command", command) for command in layout.commands]
        self._sensors = [topic("sensor", sensor) for sensor in layout.sensors]
        self._ages = [topic("sensor_age", sensor) for sensor in layout.sensors]
        # The last phase is the recording itself, which is not over when it is written.
        self._phases = [topic("timing", phase) for phase in PHASES[:-1]]

    def write(self, record: CycleRecord) -> None:
        """Log one cycle."""
        log, stamp_ns = self._log, record.stamp_ns
        if self._odometry is not None:
            x, y, heading, linear, angular = (record.published[index] for index in self._odometry)
            log.point("/position", stamp_ns, x, y, 0.0)
            log.float64("/linear_velocity", stamp_ns, linear)
            log.float64("/angular_velocity", stamp_ns, angular)
            log.odometry("/odom", stamp_ns, x, y, heading, linear, angular)
        if self._joints is not None:
            left, right, left_velocity, right_velocity = measured = [record.published[i] for i in self._joints]
            if all(map(math.isfinite, measured)):
                log.joint_state("/joint_states", stamp_ns, (left, right), (left_velocity, right_velocity))
        if self._imu is not None:
            wx, wy, wz, ax, ay, az = measured = [record.published[index] for index in self._imu]
            if all(map(math.isfinite, measured)):
                log.imu("/imu/data", stamp_ns, self._imu_frame, (wx, wy, wz), (ax, ay, az))
        log.twist("/setpoint", stamp_ns, record.setpoint.linear_velocity, record.setpoint.angular_velocity)
        self._scalars(self._ports, stamp_ns, (*record.u, *record.y))
        self._scalars(self._commands, stamp_ns, record.commands)
        self._scalars(self._sensors, stamp_ns, record.sensors.values)
        self._scalars(self._ages, stamp_ns, record.sensors.ages)
        log.float64("/timing/lateness", stamp_ns, record.lateness_ns * 1e-9)
        self._scalars(self._phases, stamp_ns, [duration_ns * 1e-9 for duration_ns in record.durations_ns])

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[Status]) -> None:
        """Log a set of diagnostics."""
        fields = [(int(s.level), s.name, s.message, "", s.values) for s in statuses]
        self._log.diagnostics("/diagnostics", stamp_ns, fields)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the log."""
        self._log.attach(name, media_type, data)

    def close(self) -> None:
        """Finish the log."""
        self._log.close()

    def _scalars(self, topics: Sequence[str], stamp_ns: int, values: Sequence[float]) -> None:
        for name, value in zip(topics, values, strict=True):
            self._log.float64(name, stamp_ns, value)


def _indices(published: dict[str, int], wanted: Sequence[str]) -> list[int] | None:
    return [published[signal] for signal in wanted] if all(signal in published for signal in wanted) else None
