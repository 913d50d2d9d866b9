# SPDX-License-Identifier: MIT
"""A simulated robot in ROS, on simulated time."""
