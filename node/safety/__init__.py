# SPDX-License-Identifier: MIT
"""When torque is allowed: pure functions and one state machine, which know no I/O, no ROS and no clock."""
