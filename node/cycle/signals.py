# SPDX-License-Identifier: MIT
"""The names of the robot's signals, and which of them it publishes."""

from collections.abc import Collection, Iterable
from typing import Final

SETPOINT_SIGNALS: Final = ("setpoint.linear_velocity", "setpoint.angular_velocity")
"""In the order of `Setpoint`: m/s, rad/s."""

ODOMETRY_SIGNALS: Final = (
    "odometry.x",
    "odometry.y",
    "odometry.heading",
    "odometry.linear_velocity",
    "odometry.angular_velocity",
)
"""Where the robot is and how it moves: m, m, rad, m/s, rad/s."""

JOINT_SIGNALS: Final = ("left.angle", "right.angle", "left.velocity", "right.velocity")
"""The joints of a robot whose hardware measures no others, two wheels: rad, rad, rad/s, rad/s."""

IMU_SIGNALS: Final = (
    *(f"imu.angular_velocity_{axis}" for axis in "xyz"),
    *(f"imu.linear_acceleration_{axis}" for axis in "xyz"),
)
"""Angular velocity, rad/s, and specific force, m/s2, in the robot's axes."""

SUPPLY_SIGNAL: Final = "supply.voltage"
"""What feeds the motors: V."""

_UNITS: Final = {"angle": "rad", "velocity": "rad/s", "torque": "N m", "voltage": "V"}

SET: Final = "set."
"""Begins the name of a value that anybody may set: `set.force` is the topic `set/force`."""

VALID: Final = "valid."
"""Begins the name of whether a measured signal is fresh: `valid.left.angle` is 1.0 where it is, else 0.0."""

TOPIC: Final = "topic."
"""Begins the name of a topic that a variable is published on: `topic.energy` is the topic `energy`."""


def joint_signals(signals: Iterable[str]) -> tuple[str, ...]:
    """Of what hardware measures, the angles of its axes and then their velocities: rad, rad/s."""
    names = [signal.rpartition(".") for signal in signals]
    axes = list(dict.fromkeys(axis for axis, _, value in names if value in {"angle", "velocity"}))
    if set(axes) <= {"left", "right"}:
        return JOINT_SIGNALS
    return (*(f"{axis}.angle" for axis in axes), *(f"{axis}.velocity" for axis in axes))


def effort_signals(signals: Collection[str]) -> tuple[str, ...]:
    """The torques of the same axes, where all of them are measured: N m."""
    joints = joint_signals(signals)
    efforts = tuple(f"{joint.rpartition('.')[0]}.torque" for joint in joints[: len(joints) // 2])
    return efforts if all(effort in signals for effort in efforts) else ()


def published_signals(signals: Collection[str]) -> tuple[str, ...]:
    """What a robot can publish whose hardware measures `signals`."""
    return (*ODOMETRY_SIGNALS, *joint_signals(signals), *IMU_SIGNALS, SUPPLY_SIGNAL, *effort_signals(signals))


def axis_unit(signal: str) -> str:
    """The unit of a signal or command of an axis by its name, such as `left.torque`; empty where that does not tell."""
    return _UNITS.get(signal.rpartition(".")[2], "")
