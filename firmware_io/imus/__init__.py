# SPDX-License-Identifier: MIT
"""Inertial measurement units, one folder each."""
