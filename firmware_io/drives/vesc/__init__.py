# SPDX-License-Identifier: MIT
"""VESC motor controllers, one for each wheel, on CAN and on the UART of one of them."""
