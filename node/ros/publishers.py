# SPDX-License-Identifier: MIT
"""The topics that publish each cycle, and `mode`: what the robot may do and why, with the echo of a heartbeat."""

import importlib.util
import logging
import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.node.config import RosSection
from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.report import MODE_LEVELS, MODE_SUFFIX, state_text
from segway_ecc.node.cycle.signals import IMU_SIGNALS, ODOMETRY_SIGNALS, SUPPLY_SIGNAL, effort_signals, joint_signals
from segway_ecc.node.cycle.status import Level
from segway_ecc.node.cycle.trajectory import TrajectoryState, TrajectoryStatus
from segway_ecc.node.ros.messages import NS_PER_S, STAMP, TF2, RosObject, Template, message_type, set_stamp
from segway_ecc.node.ros.protocol import RosSettings
from segway_ecc.node.ros.trajectories import STATUS_DEPTH, STATUS_TOPIC, STATUS_TYPE
from segway_ecc.node.ros.uncertainty import UNKNOWN, OdometryUncertainty

_DEPTH: Final = 10
_TF_DEPTH: Final = 100
"""As tf2 has it."""
AHEAD_DEPTH: Final = 500
"""Set-points stamped ahead come in bunches, and each of them counts."""
_SCALARS: Final = {
    "linear_velocity": "odometry.linear_velocity",
    "angular_velocity": "odometry.angular_velocity",
}
_BATTERY_PERIOD_NS: Final = 500_000_000
_MODE_PERIOD_NS: Final = 100_000_000
_TRAJECTORY_LEVELS: Final = {TrajectoryState.ABORTED: Level.WARN, TrajectoryState.REFUSED: Level.ERROR}
_logger = logging.getLogger(__name__)
_UNKNOWN_PLACES: Final = (14, 21, 28)
"""In a covariance of six: z, roll and pitch."""
_PITCH_VARIANCE: Final = 0.02**2
_ROLL_VARIANCE: Final = 0.1**2
"""rad2: both wheels stand on a floor that is level, or nearly."""
_LEAST_YAW_VARIANCE: Final = 1e-6
"""rad2: zero would be taken for unknown."""
_RATE_VARIANCE: Final = 0.01**2
"""(rad/s)2: of the IMUs that are supported, with what is left of their bias."""
_ACCELERATION_VARIANCE: Final = 0.2**2
"""(m/s2)2: the same, and what the wheels shake."""
_NOT_MEASURED: Final = -1.0
"""Where a covariance begins with it, the message does not carry what it belongs to (sensor_msgs/Imu)."""


class Topic(NamedTuple):
    """What is published of each cycle on a topic; `publish` makes the message and publishes it."""

    publisher: RosObject
    publish: Callable[[Report], None]

    def has_subscribers(self) -> bool:
        """Whether anybody subscribes to it."""
        return bool(self.publisher.get_subscription_count())


def make_topics(node: RosObject, settings: RosSettings) -> list[Topic]:
    """All that a robot publishes of each cycle."""
    stand = None if settings.stand is None else settings.set_names.index(settings.stand)
    return [
        make_mode_publisher(node, settings.robot, stand=stand),  # the first: a stop is confirmed by it
        _setpoint(node, settings.ros),
        make_status_publisher(node, settings.robot),
        *([make_residual_publisher(node, settings.residual)] if settings.residual else ()),
        *make_publishers(
            node,
            settings.ros,
            settings.published,
            OdometryUncertainty(settings.published, settings.wheel_radius, leans=settings.pitch is not None),
            settings.pitch,
        ),
        *(_number(node, topic.replace(".", "/"), "topics", place) for place, topic in enumerate(settings.topics)),
    ]


def make_clock(node: RosObject) -> Callable[[int], None]:
    """What publishes simulated time on `/clock`, where every node with `use_sim_time` takes it from."""
    kind = message_type("rosgraph_msgs/msg/Clock")
    publisher, message = node.create_publisher(kind, "/clock", _DEPTH), kind()

    def publish(stamp_ns: int) -> None:
        message.clock.sec, message.clock.nanosec = divmod(stamp_ns, NS_PER_S)
        publisher.publish(message)

    return publish


def make_mode_publisher(node: RosObject, robot_name: str, *, stand: int | None) -> Topic:
    """Publishes at once where mode, posture, reason, drives, zero or stand changed, else ten times a second.

    One message is made, once, and filled anew. Measured: 0.3 us where nothing is published, 12 us (p99 25) where it is.
    `stand` is the place of what makes the robot stand up or sit down among the values that may be set, if it has one.
    """
    kind, pair = message_type("diagnostic_msgs/msg/DiagnosticStatus"), message_type("diagnostic_msgs/msg/KeyValue")
    publisher = node.create_publisher(kind, "mode", _DEPTH)
    keys = (
        "mode",
        "reason",
        "cycle",
        "drives",
        "zero",
        "heartbeat",
        "heartbeat_age_ms",
        "introduced",
        "stand",
        "posture",
    )
    pairs = [pair(key=key) for key in keys]
    mode, reason, cycle, drives, zero, heartbeat, age, introduced, standing, posture = pairs
    message = kind(name=f"{robot_name}{MODE_SUFFIX}", hardware_id=robot_name, values=pairs)
    last: tuple[object, ...] = ()
    last_turn = -1

    def publish(report: Report) -> None:
        nonlocal last, last_turn
        turn, standing_up = report.stamp_ns // _MODE_PERIOD_NS, None if stand is None else report.set_values[stand]
        state = report.mode, report.is_zero, report.drives, report.reason, standing_up, report.posture
        if turn == last_turn and state == last:
            return
        last, last_turn = state, turn
        message.level = bytes((MODE_LEVELS.get(report.mode, Level.OK),))
        message.message = f"{state_text(report.mode, report.posture)}: {report.reason}"
        posture.value = report.posture or ""
        mode.value, reason.value = str(report.mode), report.reason
        cycle.value = str(report.cycle)
        drives.value, zero.value = report.drives, "true" if report.is_zero else "false"
        if report.heartbeat is not None:
            heartbeat.value = f"{report.heartbeat.station} {report.heartbeat.stamp_ns}"
            age.value = f"{report.heartbeat_age_ns / 1e6:.3f}"
            introduced.value = "true" if report.is_introduced else "false"
        if stand is not None:
            standing.value = repr(report.set_values[stand])
        publisher.publish(message)

    return Topic(publisher, publish)


def make_publishers(
    node: RosObject,
    ros: RosSection,
    signals: Sequence[str],
    uncertainty: OdometryUncertainty | None = None,
    pitch: int | None = None,
) -> list[Topic]:
    """The topics that these signals suffice for. A message is made once, its numbers written in each cycle.

    What was measured too long ago is not published: silence is true, and an old value under a new stamp is not. Nor is
    what is not finite. `pitch` is the place of the IMU's among the values of topics.
    """
    uncertainty = uncertainty or OdometryUncertainty(signals)
    index = {signal: position for position, signal in enumerate(signals)}
    publishers = [
        _number(node, topic, "values", index[signal]) for topic, signal in _SCALARS.items() if signal in index
    ]
    odometry, joints, imu = (
        [index[signal] for signal in group] if all(signal in index for signal in group) else None
        for group in (ODOMETRY_SIGNALS, joint_signals(signals), IMU_SIGNALS)
    )
    if odometry is not None:
        publishers += _odometry(node, ros, odometry, uncertainty)
        if ros.odometry_tf and importlib.util.find_spec(TF2) is not None:
            try:
                publishers.append(_transform(node, ros, odometry))
            except Exception as error:  # noqa: BLE001 - an installation of which it does not work is no reason to end
                _logger.warning("no transform is published on /tf: %s fails: %s", TF2, error)
    if joints is not None:
        names = ros.joint_names(joint_signals(signals))
        publishers.append(_joints(node, names, joints, [index[signal] for signal in effort_signals(signals)]))
    if imu is not None:
        heading = None if pitch is None or odometry is None else (pitch, odometry[2], uncertainty)
        publishers.append(_imu(node, ros, imu, heading))
    if SUPPLY_SIGNAL in index:
        publishers.append(_battery(node, ros, index[SUPPLY_SIGNAL]))
    return publishers


def _setpoint(node: RosObject, ros: RosSection) -> Topic:
    """Publishes which set-point came into force, and when: whoever sent it can check that it did."""
    kind = message_type("geometry_msgs/msg/TwistStamped")
    message, publisher = kind(), node.create_publisher(kind, "setpoint", AHEAD_DEPTH)
    message.header.frame_id = ros.base_frame

    def publish(report: Report) -> None:
        if report.applied is not None:
            setpoint, stamp_ns = report.applied
            set_stamp(message.header, stamp_ns or 0)
            message.twist.linear.x, message.twist.angular.z = setpoint
            publisher.publish(message)

    return Topic(publisher, publish)


def _number(node: RosObject, topic: str, group: str, index: int) -> Topic:
    kind = message_type("std_msgs/msg/Float64")
    publisher, template = node.create_publisher(kind, topic, _DEPTH), Template(kind(), ("data", "d"))

    def publish(report: Report) -> None:
        value = getattr(report, group)[index]
        if math.isfinite(value):
            publisher.publish(template.filled(value))

    return Topic(publisher, publish)


def _odometry(
    node: RosObject, ros: RosSection, indices: Sequence[int], uncertainty: OdometryUncertainty
) -> list[Topic]:
    point_kind, kind = message_type("geometry_msgs/msg/Point"), message_type("nav_msgs/msg/Odometry")
    point_publisher = node.create_publisher(point_kind, "position", _DEPTH)
    point = Template(point_kind(), ("x", "d"), ("y", "d"))
    x_index, y_index, *_ = indices
    message, publisher = kind(), node.create_publisher(kind, "odom", ros.odometry_depth)
    message.header.frame_id, message.child_frame_id = ros.odometry_frame, ros.base_frame
    for place in _UNKNOWN_PLACES:
        message.pose.covariance[place] = message.twist.covariance[place] = UNKNOWN
    position, orientation = (f"pose.pose.{what}" for what in ("position", "orientation"))
    template = _stamped(
        message,
        *(f"{position}.x", f"{position}.y", f"{orientation}.z", f"{orientation}.w"),
        *(f"pose.covariance.{place}" for place in (0, 1, 5, 6, 7, 11, 30, 31, 35)),
        *("twist.twist.linear.x", "twist.twist.angular.z"),
        *(f"twist.covariance.{place}" for place in (0, 7, 35)),
    )

    def publish_position(report: Report) -> None:
        x, y = report.values[x_index], report.values[y_index]
        if math.isfinite(x + y):
            point_publisher.publish(point.filled(x, y))

    def publish(report: Report) -> None:
        x, y, heading, linear, angular = [report.values[index] for index in indices]
        if not math.isfinite(x + y + heading + linear + angular):
            return
        uncertainty.update(report)
        xx, xy, xh, yy, yh, hh = uncertainty.pose
        half, stamp = 0.5 * heading, divmod(report.stamp_ns, NS_PER_S)
        pose = x, y, math.sin(half), math.cos(half), xx, xy, xh, xy, yy, yh, xh, yh, hh
        publisher.publish(template.filled(*stamp, *pose, linear, angular, *uncertainty.twist))

    return [Topic(point_publisher, publish_position), Topic(publisher, publish)]


def _transform(node: RosObject, ros: RosSection, indices: Sequence[int]) -> Topic:
    """Publishes where the base is in the frame of the odometry, on `/tf` whatever the namespace."""
    kind, stamped = message_type(f"{TF2}/msg/TFMessage"), message_type("geometry_msgs/msg/TransformStamped")()
    stamped.header.frame_id, stamped.child_frame_id = ros.odometry_frame, ros.base_frame
    stamp = [(f"transforms.0.{path}", number) for path, number in STAMP]
    numbers = [
        f"transforms.0.transform.{what}" for what in ("translation.x", "translation.y", "rotation.z", "rotation.w")
    ]
    template = Template(kind(transforms=[stamped]), *stamp, *((path, "d") for path in numbers))
    publisher = node.create_publisher(kind, "/tf", _TF_DEPTH)
    x_index, y_index, heading_index, *_ = indices

    def publish(report: Report) -> None:
        x, y, heading = report.values[x_index], report.values[y_index], report.values[heading_index]
        if math.isfinite(x + y + heading):
            stamp = divmod(report.stamp_ns, NS_PER_S)
            publisher.publish(template.filled(*stamp, x, y, math.sin(0.5 * heading), math.cos(0.5 * heading)))

    return Topic(publisher, publish)


def _joints(node: RosObject, names: Sequence[str], joints: Sequence[int], efforts: Sequence[int]) -> Topic:
    """Publishes angles and velocities while all of them are measured, and torques while these are too."""
    kind, zeros = message_type("sensor_msgs/msg/JointState"), [0.0] * len(names)
    publisher = node.create_publisher(kind, "joint_states", _DEPTH)
    numbers = [f"{what}.{place}" for what in ("position", "velocity", "effort") for place in range(len(names))]
    without = _stamped(kind(name=names, position=zeros, velocity=zeros), *numbers[: len(joints)])
    template = _stamped(kind(name=names, position=zeros, velocity=zeros, effort=zeros), *numbers) if efforts else None

    def publish(report: Report) -> None:
        measured, torques = [report.values[index] for index in joints], [report.values[index] for index in efforts]
        if not all(map(math.isfinite, measured)):
            return
        stamp = divmod(report.stamp_ns, NS_PER_S)
        if template is not None and all(map(math.isfinite, torques)):
            publisher.publish(template.filled(*stamp, *measured, *torques))
        else:
            publisher.publish(without.filled(*stamp, *measured))

    return Topic(publisher, publish)


def _imu(
    node: RosObject, ros: RosSection, indices: Sequence[int], attitude: tuple[int, int, OdometryUncertainty] | None
) -> Topic:
    """Publishes what the IMU measures, while it does, and the attitude with it.

    That is the place of the pitch among the topics, that of the heading among the signals, and the uncertainty of the
    heading; roll is that of a level floor.
    """
    kind = message_type("sensor_msgs/msg/Imu")
    publisher = node.create_publisher(kind, "imu/data", _DEPTH)
    numbers = [f"{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    without, message = kind(), kind()
    for each in (without, message):
        each.header.frame_id = ros.imu_frame
        for diagonal in (0, 4, 8):
            each.angular_velocity_covariance[diagonal] = _RATE_VARIANCE
            each.linear_acceleration_covariance[diagonal] = _ACCELERATION_VARIANCE
    without.orientation_covariance[0] = _NOT_MEASURED
    message.orientation_covariance[0], message.orientation_covariance[4] = _ROLL_VARIANCE, _PITCH_VARIANCE
    turned = [f"orientation.{part}" for part in "xyzw"]
    alone = _stamped(without, *numbers)
    template = _stamped(message, *turned, "orientation_covariance.8", *numbers)
    if attitude is not None:
        pitch_place, heading_place, uncertainty = attitude

    def publish(report: Report) -> None:
        measured = [report.values[index] for index in indices]
        if not all(map(math.isfinite, measured)):
            return
        stamp = divmod(report.stamp_ns, NS_PER_S)
        if attitude is None:
            publisher.publish(alone.filled(*stamp, *measured))
            return
        pitch, heading = 0.5 * report.topics[pitch_place], 0.5 * report.values[heading_place]
        if not math.isfinite(pitch + heading):
            publisher.publish(alone.filled(*stamp, *measured))
            return
        uncertainty.update(report)
        sine, cosine, turn, ahead = math.sin(pitch), math.cos(pitch), math.sin(heading), math.cos(heading)
        orientation = -turn * sine, ahead * sine, turn * cosine, ahead * cosine
        publisher.publish(template.filled(*stamp, *orientation, uncertainty.pose.hh + _LEAST_YAW_VARIANCE, *measured))

    return Topic(publisher, publish)


def _stamped(message: RosObject, *numbers: str) -> Template:
    return Template(message, *STAMP, *((path, "d") for path in numbers))


def make_residual_publisher(node: RosObject, names: Sequence[str]) -> Topic:
    """What is left of the acceleration, and what it is laid to, ten times a second by the stamps."""
    kind, dimension = message_type("std_msgs/msg/Float64MultiArray"), message_type("std_msgs/msg/MultiArrayDimension")
    message, publisher = kind(), node.create_publisher(kind, "residual", _DEPTH)
    message.layout.dim = [dimension(label="; ".join(names), size=len(names), stride=len(names))]
    last_turn = -1

    def publish(report: Report) -> None:
        nonlocal last_turn
        turn = report.stamp_ns // _MODE_PERIOD_NS
        if turn == last_turn or not report.residual:
            return
        last_turn = turn
        message.data = list(report.residual)
        publisher.publish(message)

    return Topic(publisher, publish)


def _battery(node: RosObject, ros: RosSection, index: int) -> Topic:
    """The supply's voltage, twice a second by the stamps: what a base station shows needs no more."""
    kind = message_type("sensor_msgs/msg/BatteryState")
    message, publisher = kind(), node.create_publisher(kind, "battery_state", _DEPTH)
    message.header.frame_id = ros.base_frame
    message.present = True
    # Not measured, as the message defines it; how it is charged and of what kind it is stays "unknown".
    message.temperature = message.current = message.charge = math.nan
    message.capacity = message.design_capacity = message.percentage = math.nan
    last_turn = -1

    def publish(report: Report) -> None:
        nonlocal last_turn
        turn, volts = report.stamp_ns // _BATTERY_PERIOD_NS, report.values[index]
        if turn == last_turn or not math.isfinite(volts):
            return
        last_turn = turn
        set_stamp(message.header, report.stamp_ns)
        message.voltage = volts
        publisher.publish(message)

    return Topic(publisher, publish)


def make_status_publisher(node: RosObject, robot_name: str) -> Topic:
    """Publishes each refusal of a trajectory once, and what became of the newest accepted on change and each second.

    Before the first it publishes that there is none, so that who sends one knows that the answer will arrive.
    """
    kind, pair = message_type(STATUS_TYPE), message_type("diagnostic_msgs/msg/KeyValue")
    publisher = node.create_publisher(kind, STATUS_TOPIC, STATUS_DEPTH)
    last: tuple[int, TrajectoryStatus | None] = (-1, None)

    def send(status: TrajectoryStatus) -> None:
        values = [pair(key=key, value=str(value)) for key, value in status._asdict().items()]
        text = f"{status.state}: {status.reason}" if status.reason else str(status.state)
        level = bytes((_TRAJECTORY_LEVELS.get(status.state, Level.OK),))
        name = f"{robot_name}: trajectory"
        publisher.publish(kind(level=level, name=name, message=text, hardware_id=robot_name, values=values))

    def publish(report: Report) -> None:
        nonlocal last
        before, last = last, (report.stamp_ns // NS_PER_S, report.trajectory)
        if before != last:
            send(report.trajectory)
        if report.refused_trajectory is not None:
            send(report.refused_trajectory)

    return Topic(publisher, publish)
