# SPDX-License-Identifier: MIT
"""Simulated plants; each is a model like any other, its ports named as the drive's commands and signals."""
