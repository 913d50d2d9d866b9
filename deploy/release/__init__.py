# SPDX-License-Identifier: MIT
"""Puts a version onto a robot over ssh, and takes the robot back where that version is not healthy."""
