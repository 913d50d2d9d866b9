# SPDX-License-Identifier: MIT
"""What runs on the robot: the standard library of Python 3.11 only, sent along with each connection."""
