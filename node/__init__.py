# SPDX-License-Identifier: MIT
"""The model in its sections, the cycle, safety, ROS, recording and the command line."""
