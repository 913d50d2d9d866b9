# SPDX-License-Identifier: MIT
"""Settings in a robot file for its hardware: the parts that every drive family shares."""

from collections.abc import Collection, Mapping
from typing import Annotated, Final, Literal, TypeVar

import msgspec

from segway_ecc.firmware_io.imus.settings import ImuSettings
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings
from segway_ecc.firmware_io.value import Positive, Section

AxisName = Annotated[str, msgspec.Meta(pattern="^[a-z][a-z0-9_]{0,23}$")]
"""What an axis is called: it begins the names of its signals, `left.velocity`."""
_Axis = TypeVar("_Axis")
Axes = Annotated[dict[AxisName, _Axis], msgspec.Meta(min_length=1, max_length=16)]
"""The axes of a robot by name, in the order in which they are commanded; the first one measures the supply."""
_RESERVED: Final = frozenset(
    {
        *("board", "drives", "guard", "imu", "link", "supply"),
        *("odometry", "set", "setpoint", "topic", "truth", "valid"),
    }
)
"""What begins the names of other values: of devices, and of what joins a model to the robot."""


def check_axes(names: Collection[str]) -> None:
    """Refuse an axis, or what axes move together, that is called as what is none; ValueError."""
    for name in names:
        if name in _RESERVED:
            raise ValueError(f"no axis can be called '{name}', which begins the names of other signals")


def check_unique(key: str, used: Mapping[str, int]) -> None:
    """Refuse two axes with the same number under `key`, such as a node id; ValueError."""
    owners: dict[int, str] = {}
    for name, number in used.items():
        other = owners.setdefault(number, name)
        if other != name:
            raise ValueError(f"{other} and {name} have the same {key}, {number}; each axis needs its own")


class WheelSettings(Section, frozen=True, kw_only=True):
    """Between a motor and its wheel, or whatever else it turns: how the one follows the other.

    Attributes:
        gear_ratio: Turns of the motor for one turn of the wheel.
        direction: 1 where a positive motor turn rolls the robot forward, or turns a joint in its positive direction; -1
            where it is the other way round.
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
