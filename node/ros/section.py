"""What a robot file says of ROS; it needs nothing of ROS, nor of the rest of the robot."""

from firmware_io.section import Section


class RosSection(Section, frozen=True, kw_only=True):
    """Names under which ROS knows the robot.

    Attributes:
        node_name: Name of the model node.
        odometry_frame: Frame of the pose (REP-105).
        base_frame: Frame of the velocities (REP-105).
        imu_frame: Frame of the IMU's values (REP-145): where the IMU sits, with the robot's axes.
        left_joint: Name of the left wheel's joint.
        right_joint: Name of the right wheel's joint.
    """

    node_name: str = "model"
    odometry_frame: str = "odom"
    base_frame: str = "base_link"
    imu_frame: str = "imu_link"
    left_joint: str = "left_wheel_joint"
    right_joint: str = "right_wheel_joint"
