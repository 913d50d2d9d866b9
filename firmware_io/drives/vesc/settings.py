# SPDX-License-Identifier: MIT
"""Settings in a robot file for VESC controllers."""

from typing import Annotated, Final

import msgspec

from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.firmware_io.settings import Axes, BusSettings, WheelSettings, check_axes, check_unique

_MAX_CURRENT: Final = 1_000.0
"""More motor current than any VESC gives, A; a robot file that asks for more is wrong."""
_WATCHDOG_DEFAULT = BusSettings().watchdog_s
_FIRST_HOST_ID: Final = 254
"""What a PC calls itself in VESC's protocol; 255 means all controllers."""


class VescWheelSettings(WheelSettings, frozen=True, kw_only=True):
    """One controller with its motor.

    Attributes:
        controller_id: As set in VESC Tool; from 254 down, this computer has one of its own for each controller.
        pole_pairs: Electrical turns of the motor for one mechanical turn.
        torque_constant: Torque at the motor's shaft for one ampere of motor current, N m/A.
    """

    controller_id: Annotated[int, msgspec.Meta(ge=0, le=252)]
    pole_pairs: Annotated[int, msgspec.Meta(ge=1, le=100)]
    torque_constant: Annotated[float, msgspec.Meta(ge=1e-4, le=100.0)]

    def __post_init__(self) -> None:
        """Refuse a torque that no VESC gives; ValueError."""
        if self.max_current > _MAX_CURRENT:
            raise ValueError(
                f"max_torque {self.max_torque:g} N m takes {self.max_current:g} A of motor current; "
                "are torque_constant and gear_ratio right?"
            )

    @property
    def max_current(self) -> float:
        """Motor current at the largest torque, A."""
        return abs(self.motor_torque(self.max_torque)) / self.torque_constant


class VescSettings(BusSettings, frozen=True, kw_only=True, tag="vesc"):
    """VESC controllers, one for each axis.

    Attributes:
        timeout_set_s: The time-out that was set in all controllers with VESC Tool, s. It has no default: who writes
            it confirms that it was set. 0.02 to 0.1; the firmware looks every 10 ms.
        status_rate_hz: The rate that was set for STATUS and STATUS_5, 1/s.
        serial: The UART of one controller, to fall back on.
        serial_controller: The axis whose controller's UART it is, by default the first one; the others are reached
            through it, over CAN.
    """

    axes: Axes[VescWheelSettings]
    timeout_set_s: Annotated[float, msgspec.Meta(ge=0.02, le=0.1)]
    status_rate_hz: Annotated[float, msgspec.Meta(ge=50.0, le=1_000.0)] = 200.0
    serial: SerialSettings | None = None
    serial_controller: str | None = None

    def __post_init__(self) -> None:
        """Refuse two controllers of one id, and a watchdog that the VESC does not have; ValueError."""
        check_axes(self.axes)
        check_unique("controller_id", {name: wheel.controller_id for name, wheel in self.axes.items()})
        least = min(self.host_ids.values())
        for name, wheel in self.axes.items():
            if wheel.controller_id >= least:
                raise ValueError(f"{name}.controller_id must be below {least}: from there on they are this computer's")
        if self.serial_controller not in {None, *self.axes}:
            raise ValueError(f"serial_controller must be one of the axes: {', '.join(self.axes)}")
        if self.watchdog_s != _WATCHDOG_DEFAULT:
            raise ValueError("a VESC takes no watchdog_s: set its time-out in VESC Tool and write it as timeout_set_s")

    @property
    def host_ids(self) -> dict[str, int]:
        """Under which identifier this computer asks about each axis, so that answers can be distinguished."""
        return {name: _FIRST_HOST_ID - place for place, name in enumerate(self.axes)}
