# SPDX-License-Identifier: MIT
"""Drive a robot for a moment and print where it went: rclpy and standard messages, nothing of segway-ecc.

Start a robot with `segway-ecc run cart --ros`, then this: `python drive.py`. For a robot in a namespace, add
`--ros-args -r __ns:=/robot1`.
"""

import time

import rclpy
from geometry_msgs.msg import Point, Twist
from rclpy.node import Node

DRIVES_S = 1.0
PERIOD_S = 0.05
"""Between two set-points; a robot that receives none for half a second holds its place."""


class Driver(Node):
    """Sends set-points and keeps the newest position."""

    def __init__(self) -> None:
        """Join the ROS graph."""
        super().__init__("driver")
        self.position: Point | None = None
        self._commands = self.create_publisher(Twist, "cmd_vel", 10)
        self.create_subscription(Point, "position", self._keep_position, 10)

    def send(self, linear: float, angular: float) -> None:
        """Ask for velocities, m/s and rad/s."""
        twist = Twist()
        twist.linear.x, twist.angular.z = linear, angular
        self._commands.publish(twist)

    def _keep_position(self, position: Point) -> None:
        self.position = position


def main() -> None:
    """Wait for the robot, drive, and stop."""
    rclpy.init()
    driver = Driver()
    while driver.position is None:
        rclpy.spin_once(driver)
    end = time.monotonic() + DRIVES_S
    while time.monotonic() < end:
        driver.send(0.5, 0.2)
        rclpy.spin_once(driver, timeout_sec=PERIOD_S)
        time.sleep(PERIOD_S)
    driver.send(0.0, 0.0)
    rclpy.spin_once(driver, timeout_sec=PERIOD_S)
    print(f"x = {driver.position.x:.3f} m, y = {driver.position.y:.3f} m")
    driver.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
