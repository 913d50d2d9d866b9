# SPDX-License-Identifier: MIT
"""Simulated devices; each has the name of the drive family it stands in for."""
