# SPDX-License-Identifier: MIT
"""The outputs that the plants of two-wheeled robots have in common: encoders, IMU, and how the robot really is."""

from typing import Final

from segway_ecc.node.model.model import Variable

WHEEL_OUTPUTS: Final = tuple(
    Variable(f"{side}.{name}", unit)
    for side in ("left", "right")
    for name, unit in (("angle", "rad"), ("velocity", "rad/s"))
)
IMU_OUTPUTS: Final = tuple(
    Variable(f"imu.{name}_{axis}", unit)
    for name, unit in (("angular_velocity", "rad/s"), ("linear_acceleration", "m/s2"))
    for axis in "xyz"
)
POSE_OUTPUTS: Final = (
    Variable("truth.x", "m"),
    Variable("truth.y", "m"),
    Variable("truth.heading", "rad"),
    Variable("truth.linear_velocity", "m/s"),
    Variable("truth.angular_velocity", "rad/s"),
)
