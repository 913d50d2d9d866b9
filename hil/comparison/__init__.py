# SPDX-License-Identifier: MIT
"""A recorded run against the simulation of the same commands."""
