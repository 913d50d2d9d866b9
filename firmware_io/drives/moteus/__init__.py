# SPDX-License-Identifier: MIT
"""moteus controllers, one for each axis, over CAN FD."""
