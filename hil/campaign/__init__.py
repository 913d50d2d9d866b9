# SPDX-License-Identifier: MIT
"""Declared scenarios run in lock step, one or many side by side, and judged by what was expected."""
