# SPDX-License-Identifier: MIT
"""The MTi as one of the installed IMUs; its driver is imported where one is made."""

from typing import Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Sensor
from segway_ecc.firmware_io.imus.family import ImuFamily
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.firmware_io.links.link import Link


def _sensor(settings: XsensMtiSettings, link: Link, period_s: float, clock: Clock, ride_through_s: float) -> Sensor:
    from segway_ecc.firmware_io.imus.xsens_mti.driver import XsensMti  # noqa: PLC0415 - see above

    return XsensMti(link, settings, period_s, clock.now_ns, ride_through_s)


def _why_not_fd(settings: XsensMtiSettings) -> str | None:
    if settings.bears_fd:
        return None
    return (
        "an MTi 600 is on classic CAN, and destroys the frames of CAN FD on the drives' bus; take an IMU on a line of "
        "its own (type: icm42688_bridge), or keep those frames from it by a gateway or transceiver "
        "and add bears_fd: true"
    )


FAMILY: Final = ImuFamily(settings=XsensMtiSettings, sensor=_sensor, why_not_fd=_why_not_fd)
