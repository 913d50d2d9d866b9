# SPDX-License-Identifier: MIT
"""What the MTi 600 series can measure."""

from typing import Final

MAX_ANGULAR_VELOCITY: Final = 35.0
"""Largest magnitude on each axis, rad/s; the gyroscopes end at 2000 deg/s, a little below."""

MAX_LINEAR_ACCELERATION: Final = 100.0
"""Largest magnitude on each axis, m/s2; the accelerometers end at 10 g, a little below."""
