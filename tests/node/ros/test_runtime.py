# SPDX-License-Identifier: MIT
"""Starting ROS, in a process of its own."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.ros

PUBLISHED = """
import sys
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import preload, ros_node

preload()
odometry = message_type("nav_msgs/msg/Odometry")
with ros_node("lean", "", parameters=True) as node:
    node.create_publisher(odometry, "odom", 1).publish(odometry())
print("rosidl_generator_py" in sys.modules, [name for name in ("em", "lark", "regex") if name in sys.modules])
"""


def test_messages_are_published_without_what_would_generate_them(ros_environment: dict[str, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PUBLISHED], check=True, capture_output=True, text=True, env=ros_environment
    )
    assert done.stdout == "True []\n"
