# SPDX-License-Identifier: MIT
"""The ICM-42688-P behind a bridge as one of the installed IMUs; its driver is imported where one is made."""

from typing import TYPE_CHECKING, Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Sensor
from segway_ecc.firmware_io.imus.family import ImuFamily
from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.links.link import Link

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import SerialCodec


def _sensor(
    settings: Icm42688BridgeSettings, _link: Link, period_s: float, clock: Clock, ride_through_s: float
) -> Sensor:
    from segway_ecc.firmware_io.imus.icm42688_bridge.driver import Icm42688  # noqa: PLC0415 - see above

    return Icm42688(settings, period_s, clock, ride_through_s)


def _codec() -> "SerialCodec":
    from segway_ecc.firmware_io.imus.icm42688_bridge.frames import BridgeCodec  # noqa: PLC0415 - see above

    return BridgeCodec()


FAMILY: Final = ImuFamily(settings=Icm42688BridgeSettings, sensor=_sensor, serial_codec=_codec)
