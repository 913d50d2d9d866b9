# SPDX-License-Identifier: MIT
"""Drives of the CiA 402 profile over CANopen, one node a wheel, in cyclic synchronous torque mode."""
