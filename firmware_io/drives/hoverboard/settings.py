# SPDX-License-Identifier: MIT
"""Settings in a robot file for the board of a hoverboard."""

from typing import Annotated, Final, Literal

import msgspec

from segway_ecc.firmware_io.settings import HardwareSettings, SerialOnlySettings, WheelSettings
from segway_ecc.firmware_io.value import Positive

LOOP_S: Final = 0.0050625  # of the firmware's main loop: it waits for more than 80 ticks of 1/16 ms (main.c)
_WATCHDOG_DEFAULT = HardwareSettings().watchdog_s


class HoverboardWheelSettings(WheelSettings, frozen=True, kw_only=True):
    """One motor; `direction` is 1 where a positive command rolls the robot forward, as on a board without INVERT_*.

    Attributes:
        torque_constant: Torque at the motor's shaft for one ampere of its current, N m/A.
    """

    torque_constant: Annotated[float, msgspec.Meta(ge=1e-3, le=100.0)]


class HoverboardSettings(SerialOnlySettings, frozen=True, kw_only=True, tag="hoverboard"):
    """A board with two motors.

    Attributes:
        max_current: I_MOT_MAX of config.h, A: the motor's current at the command 1000.
        serial_timeout_cycles: SERIAL_TIMEOUT of config.h: who writes it confirms that it was compiled in.
        feedback: `odometry` for a firmware that sends the counts of the Hall sensors too, so that angles are measured.
    """

    left: HoverboardWheelSettings
    right: HoverboardWheelSettings
    max_current: Positive = 15.0
    serial_timeout_cycles: Annotated[int, msgspec.Meta(ge=4, le=2_000)]
    feedback: Literal["standard", "odometry"] = "standard"
    guard: Literal["required", "optional"] = "required"

    def __post_init__(self) -> None:
        """Refuse torques that the board does not give, and a watchdog that it does not have; ValueError."""
        for name, wheel in (("left", self.left), ("right", self.right)):
            full = abs(wheel.wheel_torque(wheel.torque_constant * self.max_current))
            if wheel.max_torque > full:
                raise ValueError(
                    f"{name}: max_torque {wheel.max_torque:g} N m is more than the {full:g} N m that max_current gives"
                )
        if self.watchdog_s != _WATCHDOG_DEFAULT:
            raise ValueError("a hoverboard takes no watchdog_s: compile SERIAL_TIMEOUT, write serial_timeout_cycles")

    @property
    def timeout_s(self) -> float:
        """How long the firmware goes on without a command, s."""
        return (self.serial_timeout_cycles + 1) * LOOP_S
