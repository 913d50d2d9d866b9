# SPDX-License-Identifier: MIT
"""A controller by somebody who knows ROS alone: rclpy and message packages, by simulated time.

Drives TURNS turns, one set-point for each new time of its clock, by the odometry of that time or by a file of commands
(JSON: time in ns to linear and angular velocity). Prints, as JSON, a row for each turn: time, x, y, heading's z, v, w.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

PATIENCE_S = 150.0


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def main(turns: int, commands: dict[str, list[float]] | None, *, arm: bool) -> None:
    rclpy.init()
    node = rclpy.create_node("controller", parameter_overrides=[Parameter("use_sim_time", value=True)])
    newest: list[Any] = []
    node.create_subscription(Odometry, "odom", newest.append, 1000)
    publisher = node.create_publisher(Twist, "cmd_vel", 10)
    arming = node.create_client(Trigger, "model/arm")
    deadline_s, last_ns = time.monotonic() + PATIENCE_S, 0
    rows: list[Any] = []
    while len(rows) < turns and time.monotonic() < deadline_s:
        rclpy.spin_once(node, timeout_sec=0.1)
        now_ns = node.get_clock().now().nanoseconds
        odometry = next((each for each in newest if stamp_ns(each) == now_ns), None)
        if now_ns == last_ns or odometry is None or publisher.get_subscription_count() == 0:
            continue
        if arm:
            arming.wait_for_service(PATIENCE_S)
            answer = arming.call_async(Trigger.Request())
            rclpy.spin_until_future_complete(node, answer, timeout_sec=PATIENCE_S)
            arm, last_ns = not answer.result().success, now_ns
            continue
        last_ns = now_ns
        newest.clear()
        pose, twist = odometry.pose.pose, odometry.twist.twist
        rows.append([now_ns, pose.position.x, pose.position.y, pose.orientation.z, twist.linear.x, twist.angular.z])
        if commands is None:
            linear, angular = 0.5 + 0.2 * pose.position.x, 1.0 - pose.position.y - pose.orientation.z
        else:
            linear, angular = commands[str(now_ns)]
        message = Twist()
        message.linear.x, message.angular.z = linear, angular
        publisher.publish(message)
    sys.stdout.write(json.dumps(rows))
    rclpy.shutdown()


if __name__ == "__main__":
    given = json.loads(Path(sys.argv[2]).read_text("utf-8")) if len(sys.argv) > 2 and sys.argv[2] != "arm" else None
    main(int(sys.argv[1]), given, arm=sys.argv[-1] == "arm")
