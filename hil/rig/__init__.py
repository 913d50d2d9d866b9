# SPDX-License-Identifier: MIT
"""The simulated robot at the other end of the bus, and what runs it: in lock step, or in real time."""
