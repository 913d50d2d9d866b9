# SPDX-License-Identifier: MIT
"""TDK ICM-42688-P behind a microcontroller that sends its measurements on a serial line."""
