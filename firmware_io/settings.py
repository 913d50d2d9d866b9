# SPDX-License-Identifier: MIT
"""Settings in a robot file for its hardware: the parts that every drive family shares."""

from typing import Annotated, Literal

import msgspec

from segway_ecc.firmware_io.imus.settings import ImuSettings
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings
from segway_ecc.firmware_io.value import Positive, Section


class WheelSettings(Section, frozen=True, kw_only=True):
    """Between a motor and its wheel: how the one follows the other.

    Attributes:
        gear_ratio: Turns of the motor for one turn of the wheel.
        direction: 1 where a positive motor turn rolls the robot forward, -1 where it rolls it back.
        max_torque: Largest torque that is asked for at the wheel, N m.
    """

    gear_ratio: Positive = 1.0
    direction: Literal[1, -1] = 1
    max_torque: Positive

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


class HardwareSettings(Section, frozen=True, kw_only=True):
    """Drives, on whatever line they are; a family's settings are `BusSettings` or `SerialOnlySettings`.

    Attributes:
        watchdog_s: How long a drive waits for a command before it switches its motors off by itself, s.
        ride_through_s: How much longer than otherwise (three of its periods) a device may be silent, s; meanwhile the
            robot goes on with the last values: one that balances on its estimate does not fall for a gap.
        guard: Whether the robot arms only while a guard answers.
        external_imu: An IMU of its own, where there is one.
    """

    watchdog_s: Annotated[float, msgspec.Meta(ge=0.02, le=0.05)] = 0.05
    ride_through_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.1)] = 0.0
    guard: Literal["required", "optional"] = "optional"
    external_imu: ImuSettings | None = None

    @property
    def line(self) -> CanSettings | PortSettings:
        """The line that the drives are on; where they have one to fall back on, the first."""
        raise NotImplementedError


class BusSettings(HardwareSettings, frozen=True, kw_only=True):
    """Drives on a CAN bus; an IMU of its own is on the same bus. See `HardwareSettings`."""

    can: CanSettings = CanSettings()

    @property
    def line(self) -> CanSettings:
        """The bus."""
        return self.can


class SerialOnlySettings(HardwareSettings, frozen=True, kw_only=True):
    """Drives whose only line is a serial one; see `HardwareSettings`."""

    serial: PortSettings

    @property
    def line(self) -> PortSettings:
        """The serial line."""
        return self.serial
