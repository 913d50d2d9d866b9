# SPDX-License-Identifier: MIT
"""Is this machine fit to run the robot: what was found, what it means, and how to fix it."""
