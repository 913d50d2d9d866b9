# SPDX-License-Identifier: MIT
"""The robot in a ROS 2 graph; the only place where ROS is imported."""
