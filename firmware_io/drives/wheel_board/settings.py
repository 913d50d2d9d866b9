# SPDX-License-Identifier: MIT
"""Settings in a robot file for a wheel board."""

from typing import Final, Literal

from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.firmware_io.settings import BusSettings

WATCHDOG_ALLOWED_S: Final = (0.02, 0.05)
"""Range of the board's watchdog that the robot may be armed with."""


class WheelBoardSettings(BusSettings, frozen=True, kw_only=True, tag="wheel_board"):
    """Our own wheel board: a serial line to fall back on, and whether it has an IMU and sends what it measures.

    Attributes:
        protocol: Version of its commands. In 2, the default, they are bound to a session, by which noise and recordings
            are refused; of random frames under its identifiers a board of version 1 takes one in 680. A board of the
            other version is refused at arming, so the default decides what a robot file that is silent is protected by.
    """

    serial: SerialSettings | None = None
    imu: bool = False
    protocol: Literal[1, 2] = 2

    def __post_init__(self) -> None:
        """Refuse two IMUs, whose signals would have the same names."""
        if self.imu and self.external_imu is not None:
            raise ValueError("imu: true and external_imu both measure imu.*; keep one of them")
