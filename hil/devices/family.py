# SPDX-License-Identifier: MIT
"""The simulated device of a drive family or of an IMU: what rigs must know of it, found by entry point as theirs is."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Generic, TypeVar

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.imus.settings import ImuSettings
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.plugins import load_plugin
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.devices.device import Device

SIMULATED_DRIVES: Final = "segway_ecc.simulated_drives"
"""The group of simulated drives: each entry point has the family's name, and names a `SimulatedDrives`."""
SIMULATED_IMUS: Final = "segway_ecc.simulated_imus"
"""The group of simulated IMUs: each entry point has the IMU's name, and names a `SimulatedImu`."""
Settings = TypeVar("Settings", bound=HardwareSettings)
SettingsOfImu = TypeVar("SettingsOfImu", bound=ImuSettings)
Made = TypeVar("Made", bound=Device)


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedDrives(Generic[Settings, Made]):
    """The drives of a family as their firmware behaves.

    Attributes:
        tick_ns: The period of the firmware's loop, ns.
        device: (settings, bus, the device's end of a serial line or None) -> the drives, configured as the settings
            have it.
        variants: The same by the name of a release or kind of drive, as `simulation.drives` of a robot file has it.
        press_stop: (drives, whether it is pressed) -> what the emergency stop does to them; None where nothing.
        lose_watchdog: (drives) -> has them go on without commands, as if misconfigured; None where that is not
            simulated.
        fail: (drives) -> has that of the first axis end with an error of its own, and its motor free; None where that
            is not simulated.
    """

    tick_ns: int
    device: Callable[[Settings, Link, Port | None], Made]
    variants: Mapping[str, Callable[[Settings, Link, Port | None], Made]] = field(default_factory=dict)
    press_stop: Callable[[Made, bool], None] | None = None
    lose_watchdog: Callable[[Made], None] | None = None
    fail: Callable[[Made], None] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedImu(Generic[SettingsOfImu]):
    """An IMU as it behaves on the bus.

    Attributes:
        device: (settings, bus, its end of a serial line of its own or None) -> the IMU.
        frames: (settings) -> the frames that it sends.
    """

    device: Callable[[SettingsOfImu, Link, Port | None], Device]
    frames: Callable[[SettingsOfImu], Collection[FrameKey]]


def simulated_drives(settings: HardwareSettings) -> SimulatedDrives[Any, Any]:
    """The simulated drives that settings are of.

    Raises:
        PluginError: They are not installed, or cannot be imported.
    """
    return load_plugin(SIMULATED_DRIVES, settings.__struct_config__.tag, "simulated drive family", SimulatedDrives)


def simulated_imu(settings: ImuSettings) -> SimulatedImu[Any]:
    """The simulated IMU that settings are of.

    Raises:
        PluginError: It is not installed, or cannot be imported.
    """
    return load_plugin(SIMULATED_IMUS, settings.__struct_config__.tag, "simulated IMU", SimulatedImu)
