# SPDX-License-Identifier: MIT
"""What a drive family of your own is made of; a distribution registers it under the entry points `segway_ecc.drives`.

See "Your own drive" in the documentation, and `segway_ecc.testing.check_conformance`, which tries it.
"""

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import Drive, FrameKey, Freshness, Readings, stale_after_ns
from segway_ecc.firmware_io.drives.enabling import Phase, PhasedDrive
from segway_ecc.firmware_io.drives.family import DriveFamily, DriveWatchdog
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation, Stopper
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.firmware_io.settings import BusSettings, SerialOnlySettings, WheelSettings

__all__ = [
    "BusSettings",
    "Clock",
    "Drive",
    "DriveFamily",
    "DriveWatchdog",
    "Frame",
    "FrameKey",
    "Freshness",
    "Link",
    "Meaning",
    "Observation",
    "Phase",
    "PhasedDrive",
    "PortSettings",
    "Readings",
    "SerialOnlySettings",
    "Stopper",
    "WheelSettings",
    "stale_after_ns",
]
