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


FAMILY: Final = ImuFamily(settings=XsensMtiSettings, sensor=_sensor)
