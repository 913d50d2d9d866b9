# SPDX-License-Identifier: MIT
"""Faults that are declared beforehand and made in lock step: the same seed makes the same ones."""
