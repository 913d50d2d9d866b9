# SPDX-License-Identifier: MIT
"""The board of a hoverboard, with the FOC firmware of EFeru, on a serial line."""
