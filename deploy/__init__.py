# SPDX-License-Identifier: MIT
"""What takes the robot's software onto a robot."""
