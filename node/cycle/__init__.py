# SPDX-License-Identifier: MIT
"""The cycle: deadlines, set-points, equations, commands, and how long each took."""
