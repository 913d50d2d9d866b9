# SPDX-License-Identifier: MIT
"""Sequence control: set-points that follow one another in model time."""
