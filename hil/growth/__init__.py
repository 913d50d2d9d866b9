# SPDX-License-Identifier: MIT
"""What a cycle costs as the robot grows: ports of the model, drives, subscribers, and robots on one host."""
