# SPDX-License-Identifier: MIT
"""A balancing robot on a floor with friction: its limits there, and trials of all that a floor may have."""
