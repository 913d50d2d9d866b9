# SPDX-License-Identifier: MIT
"""Settings in a robot file for ODrives."""

from typing import Annotated, Final, Literal

import msgspec

from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.firmware_io.settings import Axes, BusSettings, WheelSettings, check_axes, check_unique
from segway_ecc.firmware_io.value import Positive

NodeId = Annotated[int, msgspec.Meta(ge=0, le=62)]
"""What can be addressed; node 63 is everybody's."""
_LEAST_BAUDRATE: Final = 460_800
"""What a loop at 100 Hz needs to pass from the bus to the line in time."""
Period = Annotated[float, msgspec.Meta(ge=0.001, le=0.1)]


class OdriveWheelSettings(WheelSettings, frozen=True, kw_only=True):
    """A wheel, or another axis of the robot, on an axis of an ODrive.

    Attributes:
        node_id: `axis.config.can.node_id`.
        axis: Which axis of its board it is, for the serial line of firmware 0.5.
        torque_constant: Torque per current of the motor, N m/A, as configured in the drive: makes the measured current
            of firmware 0.5 a torque; 0.6 sends the torque itself.
    """

    node_id: NodeId
    axis: Literal[0, 1] = 0
    torque_constant: Positive | None = None


class OdriveSettings(BusSettings, frozen=True, kw_only=True, tag="odrive"):
    """ODrives, one of their axes for each of the robot's. The drives must have been configured to match.

    Attributes:
        firmware: What runs on the drives, or `auto`: asked for.
        heartbeat_period_s: Period of the heartbeat, s, shorter than the watchdog's time-out.
        encoder_period_s: Period of the encoder estimates, s.
        torque_period_s: Period of the motor currents (0.5) or torques (0.6), s, where the drive sends them.
        serial: A serial line to the board that has both axes of a robot with two, to fall back on; firmware 0.5.
    """

    firmware: Literal["0.5", "0.6", "auto"] = "auto"
    axes: Axes[OdriveWheelSettings]
    heartbeat_period_s: Period = 0.02
    encoder_period_s: Period = 0.005
    torque_period_s: Period = 0.01
    serial: SerialSettings | None = None

    def __post_init__(self) -> None:
        """Refuse a node or axis used twice, and a heartbeat or serial line too slow or not of 0.5; ValueError."""
        check_axes(self.axes)
        check_unique("node_id", {name: wheel.node_id for name, wheel in self.axes.items()})
        if self.heartbeat_period_s >= self.watchdog_s:
            raise ValueError("heartbeat_period_s must be shorter than watchdog_s, so that the watchdog can be seen")
        if self.serial is None:
            return
        if self.firmware == "0.6":
            raise ValueError("serial is the line of firmware 0.5; 0.6 is reached over CAN only")
        if self.serial.baudrate < _LEAST_BAUDRATE:
            raise ValueError(f"serial.baudrate must be {_LEAST_BAUDRATE} or more: set config.uart_a_baudrate to it")
        if sorted(wheel.axis for wheel in self.axes.values()) != [0, 1]:
            raise ValueError("serial reaches both axes of one board: there must be two, one with axis: 0, one with 1")
