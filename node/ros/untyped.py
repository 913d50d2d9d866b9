# SPDX-License-Identifier: MIT
"""A name for what rclpy hands out: its classes and messages carry no type information."""

from typing import Any, TypeAlias

RosObject: TypeAlias = Any
"""A node, publisher, message or other object of ROS 2's Python packages."""
