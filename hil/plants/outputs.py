"""What the plants of two-wheeled robots have in common to tell: encoders, IMU, and how the robot really is."""

from typing import Final

from segway_ecc.node.model.variables import Variable

WHEEL_OUTPUTS: Final = (
    Variable("left.angle", "rad"),
    Variable("left.velocity", "rad/s"),
    Variable("right.angle", "rad"),
    Variable("right.velocity", "rad/s"),
)
IMU_OUTPUTS: Final = (
    Variable("imu.angular_velocity_x", "rad/s"),
    Variable("imu.angular_velocity_y", "rad/s"),
    Variable("imu.angular_velocity_z", "rad/s"),
    Variable("imu.linear_acceleration_x", "m/s2"),
    Variable("imu.linear_acceleration_y", "m/s2"),
    Variable("imu.linear_acceleration_z", "m/s2"),
)
POSE_OUTPUTS: Final = (
    Variable("truth.x", "m"),
    Variable("truth.y", "m"),
    Variable("truth.heading", "rad"),
    Variable("truth.linear_velocity", "m/s"),
    Variable("truth.angular_velocity", "rad/s"),
)
