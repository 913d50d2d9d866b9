# SPDX-License-Identifier: MIT
"""Between a motor and its wheel: gear ratio and direction, and counters that wrap."""

from dataclasses import dataclass
from typing import Final

TURN: Final = 6.283185307179586
"""One turn, rad."""


@dataclass(frozen=True, slots=True)
class Drivetrain:
    """How a wheel follows its motor.

    Attributes:
        gear_ratio: Turns of the motor for one turn of the wheel.
        direction: 1 where a positive motor turn rolls the robot forward, -1 where it rolls it back.
    """

    gear_ratio: float = 1.0
    direction: int = 1

    def wheel(self, motor: float) -> float:
        """A motor's angle (rad) or velocity (rad/s) as its wheel's."""
        return motor * self.direction / self.gear_ratio

    def motor(self, wheel: float) -> float:
        """A wheel's angle (rad) or velocity (rad/s) as its motor's."""
        return wheel * self.direction * self.gear_ratio

    def motor_torque(self, wheel_torque: float) -> float:
        """The motor torque that gives a wheel torque, N m; losses in the gear are not counted."""
        return wheel_torque * self.direction / self.gear_ratio

    def wheel_torque(self, motor_torque: float) -> float:
        """The wheel torque of a motor torque, N m."""
        return motor_torque * self.direction * self.gear_ratio


class WrappedCounter:
    """Follows a counter of a few bits over its wraps; exact, since Python's integers do not wrap.

    Attributes:
        total: Counts since the first, which counts as itself.
    """

    __slots__ = ("_half", "_is_resumed", "_last", "_modulus", "total")

    def __init__(self, bits: int) -> None:
        """Follow a counter of this many bits."""
        self.total = 0
        self._modulus = 1 << bits
        self._half = self._modulus >> 1
        self._last: int | None = None
        self._is_resumed = False

    def follow(self, raw: int) -> int:
        """Take a count, signed or unsigned, and return the total; steps of up to half the range are followed."""
        if self._last is not None:
            self.total += (raw - self._last + self._half) % self._modulus - self._half
        elif not self._is_resumed:
            self.total = raw
        self._last = raw
        return self.total

    def resume(self) -> None:
        """Keep the total over the next count, whatever that is: the device has restarted, perhaps at another count."""
        self._last = None
        self._is_resumed = True
