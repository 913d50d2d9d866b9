# SPDX-License-Identifier: MIT
"""Xsens MTi 600 series, which sends its measurements on CAN unasked."""
