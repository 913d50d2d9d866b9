# SPDX-License-Identifier: MIT
"""Logs of a run: MCAP files with ROS 2 messages, written without ROS."""
