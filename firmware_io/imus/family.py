# SPDX-License-Identifier: MIT
"""An IMU: what the robot's software must know of it, in one record that its entry point names."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Sensor
from segway_ecc.firmware_io.imus.settings import ImuSettings
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.plugins import IMUS, load_plugin

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import SerialCodec

DEFAULT_IMU: Final = "xsens_mti"
"""The one that is meant where a robot file names none."""
Settings = TypeVar("Settings", bound=ImuSettings)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuFamily(Generic[Settings]):
    """An IMU.

    Attributes:
        settings: Its section of a robot file, whose tag is its name.
        sensor: (settings, link, loop period in s, clock, longest gap that leaves its values valid in s) -> its driver,
            which measures `imu.*`.
        serial_codec: Makes what an IMU with `SerialImuSettings` speaks on its line; None for one on the drives' bus.
        why_not_fd: (settings) -> why it cannot be on a bus of CAN FD, with the remedy, None where it can; left out by
            those that always can.
    """

    settings: type[Settings]
    sensor: Callable[[Settings, Link, float, Clock, float], Sensor]
    serial_codec: "Callable[[], SerialCodec] | None" = None
    why_not_fd: Callable[[Settings], str | None] | None = None


def imu_family(name: object) -> ImuFamily[Any]:
    """The installed IMU of a name.

    Raises:
        PluginError: There is none, or it cannot be imported; see `load_plugin`.
    """
    return load_plugin(IMUS, name, "IMU", ImuFamily)


def imu_of(settings: ImuSettings) -> ImuFamily[Any]:
    """The IMU that settings are of.

    Raises:
        PluginError: It is not installed.
    """
    return imu_family(settings.__struct_config__.tag)
