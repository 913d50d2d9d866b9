# SPDX-License-Identifier: MIT
"""Killing, stopping and cutting every part of a robot that drives, and measuring when the torque ends."""
