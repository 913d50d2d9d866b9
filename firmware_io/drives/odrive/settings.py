# SPDX-License-Identifier: MIT
"""Settings in a robot file for ODrives."""

from typing import Annotated, Final, Literal

import msgspec

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.setting_names import PATHS
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.firmware_io.settings import Axes, BusSettings, WheelSettings, check_axes, check_unique
from segway_ecc.firmware_io.value import Positive, Section

NodeId = Annotated[int, msgspec.Meta(ge=0, le=62)]
"""What can be addressed; node 63 is everybody's."""
_READABLE: Final = frozenset(path.format(0) for path in PATHS[Firmware.V0_6].values())
"""Settings of 0.6 that are compared, by their names in `flat_endpoints.json`; a drive has one axis."""
_LEAST_BAUDRATE: Final = 460_800
"""What a loop at 100 Hz needs to pass from the bus to the line in time."""
Period = Annotated[float, msgspec.Meta(ge=0.001, le=0.1)]
Endpoint = Annotated[int, msgspec.Meta(ge=1, le=0xFFFF)]
"""What TxSdo can carry; 0 is the list of them all."""


class OdriveWheelSettings(WheelSettings, frozen=True, kw_only=True):
    """A wheel, or another axis of the robot, on an axis of an ODrive.

    Attributes:
        node_id: `axis.config.can.node_id`.
        axis: Which axis of its board it is, for the serial line of firmware 0.5.
        torque_constant: Torque per current of the motor, N m/A, as configured in the drive: makes the measured current
            of firmware 0.5 a torque; 0.6 sends the torque itself.
        max_velocity: Fastest that the wheel turns, rad/s: the drive's vel_limit must allow it where that is read back.
    """

    node_id: NodeId
    axis: Literal[0, 1] = 0
    torque_constant: Positive | None = None
    max_velocity: Positive | None = None


class OdriveEndpoints(Section, frozen=True, kw_only=True):
    """Where the settings of a drive of 0.6 stand, which differs by release and hardware: read over CAN before arming.

    All of it is in the `flat_endpoints.json` that ODrive publishes for each release, for the drive's very hardware.

    Attributes:
        firmware: Its `fw_version`, such as 0.6.10.
        hardware: Its `hw_version`, such as 4.4.58.
        ids: The `id` of each setting that is to be checked, by its name there.
    """

    firmware: Annotated[str, msgspec.Meta(pattern=r"^\d{1,3}\.\d{1,3}\.\d{1,3}$")]
    hardware: Annotated[str, msgspec.Meta(pattern=r"^\d{1,3}\.\d{1,3}\.\d{1,3}$")]
    ids: Annotated[dict[str, Endpoint], msgspec.Meta(min_length=1)]

    def __post_init__(self) -> None:
        """Refuse a setting that nothing here compares; ValueError."""
        unknown = sorted(self.ids.keys() - _READABLE)
        if unknown:
            raise ValueError(f"ids has {unknown[0]!r:.80}; what is compared are {', '.join(sorted(_READABLE))}")


class OdriveSettings(BusSettings, frozen=True, kw_only=True, tag="odrive"):
    """ODrives, one of their axes for each of the robot's. The drives must have been configured to match.

    Attributes:
        firmware: What runs on the drives, or `auto`: asked for.
        heartbeat_period_s: Period of the heartbeat, s, shorter than the watchdog's time-out.
        encoder_period_s: Period of the encoder estimates, s.
        torque_period_s: Period of the motor currents (0.5) or torques (0.6), s, where the drive sends them.
        serial: A serial line to the board that has both axes of a robot with two, to fall back on; firmware 0.5. Over
            it the settings of the axes are read before arming.
        endpoints: Where the settings of 0.6 stand, so that they are read before arming.
    """

    firmware: Literal["0.5", "0.6", "auto"] = "auto"
    axes: Axes[OdriveWheelSettings]
    heartbeat_period_s: Period = 0.02
    encoder_period_s: Period = 0.005
    torque_period_s: Period = 0.01
    serial: SerialSettings | None = None
    endpoints: OdriveEndpoints | None = None

    def __post_init__(self) -> None:
        """Refuse a node or axis used twice, and a heartbeat or serial line too slow or not of 0.5; ValueError."""
        check_axes(self.axes)
        check_unique("node_id", {name: wheel.node_id for name, wheel in self.axes.items()})
        if self.heartbeat_period_s >= self.watchdog_s:
            raise ValueError("heartbeat_period_s must be shorter than watchdog_s, so that the watchdog can be seen")
        if self.endpoints is not None and self.firmware != "0.6":
            raise ValueError("endpoints are of firmware 0.6: set firmware to '0.6'; 0.5 is read over its serial line")
        if self.serial is None:
            return
        if self.firmware == "0.6":
            raise ValueError("serial is the line of firmware 0.5; 0.6 is reached over CAN only")
        if self.serial.baudrate < _LEAST_BAUDRATE:
            raise ValueError(f"serial.baudrate must be {_LEAST_BAUDRATE} or more: set config.uart_a_baudrate to it")
        if sorted(wheel.axis for wheel in self.axes.values()) != [0, 1]:
            raise ValueError("serial reaches both axes of one board: there must be two, one with axis: 0, one with 1")
