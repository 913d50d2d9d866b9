# SPDX-License-Identifier: MIT
"""A drive family: what the robot's software must know of it, in one record that its entry point names."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.plugins import DRIVES, load_plugin
from segway_ecc.firmware_io.settings import HardwareSettings

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import SerialCodec

Settings = TypeVar("Settings", bound=HardwareSettings)


class DriveWatchdog(NamedTuple):
    """How long a drive goes on without a command, s, and how that is made sure, as the doctor reports it.

    `remedy` is how one that is long is made shorter.
    """

    timeout_s: float
    assured_by: str
    remedy: str = ""


class SettingsToCheck(NamedTuple):
    """Settings of a drive that a person has to look at, since nothing reads them back: as the doctor reports them."""

    title: str
    found: str
    effect: str
    remedy: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFamily(Generic[Settings]):
    """A drive family.

    Its parts are imported where one is made, so that the guard starts without the drivers, and the robot without what
    stops them.

    Attributes:
        settings: Its section of a robot file, whose tag is the family's name.
        drives: (settings, link, loop period in s, clock) -> its drivers.
        stopper: (settings) -> how the guard reads and stops them.
        watchdog: (settings) -> what the doctor reports of their own watchdogs.
        to_check: (settings) -> which of their settings a person has to check; None where all are read back, or where
            there are none.
        serial_codec: (settings) -> what it speaks on a serial line, the field `serial` of its settings; None where it
            has no such line.
        velocity_error: What its velocities may be off beside their scale, rad/s, where they are measured coarsely.
        packet_pause_bytes: The silence on that line that its firmware needs after each packet, in the time of bytes.
        wire_description: A file that describes its frames, put into every log; None where there is none.
    """

    settings: type[Settings]
    drives: Callable[[Settings, Link, float, Clock], Sequence[Drive]]
    stopper: Callable[[Settings], Stopper]
    watchdog: Callable[[Settings], DriveWatchdog]
    to_check: Callable[[Settings], SettingsToCheck | None] | None = None
    serial_codec: "Callable[[Settings], SerialCodec] | None" = None
    velocity_error: float = 0.0
    packet_pause_bytes: int = 0
    wire_description: Path | None = None


def drive_family(name: object) -> DriveFamily[Any]:
    """The installed drive family of a name.

    Raises:
        PluginError: There is none, or it cannot be imported; see `load_plugin`.
    """
    return load_plugin(DRIVES, name, "drive family", DriveFamily)


def family_of(settings: HardwareSettings) -> DriveFamily[Any]:
    """The drive family that settings are of.

    Raises:
        PluginError: It is not installed.
    """
    return drive_family(settings.__struct_config__.tag)
