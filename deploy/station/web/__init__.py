# SPDX-License-Identifier: MIT
"""The base station's web side: who gets in, what they are shown, and what of theirs reaches the robots."""
