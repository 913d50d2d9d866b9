# SPDX-License-Identifier: MIT
"""ODrive motor controllers: CANSimple of firmware 0.5 and 0.6, and the ASCII serial protocol of firmware 0.5."""
