# SPDX-License-Identifier: MIT
"""What is at the other end of a link: sensors, and drives, which are sensors that also move something."""

from collections.abc import Collection, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from segway_ecc.firmware_io.hardware import Diagnosed
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.value import Value

SUPPLY_VOLTAGE: Final = "supply.voltage"
"""The signal of what feeds the motors, V. A robot has one: of two drives that each measure it, the left one's."""


class FrameKey(NamedTuple):
    """What identifies one kind of frame on a bus."""

    arbitration_id: int
    is_extended: bool = False


class Readings(Value, frozen=True):
    """The newest values of one device, in the order of its `signals`; see `Sensors`."""

    values: tuple[float, ...]
    ages: tuple[float, ...]
    valid: tuple[bool, ...]


def with_one_more(readings: Readings, value: float, age: tuple[float, bool]) -> Readings:
    """Readings and one value more: in SI, with its age, s, and whether it is fresh enough."""
    return Readings((*readings.values, value), (*readings.ages, age[0]), (*readings.valid, age[1]))


class Sensor(Diagnosed, Protocol):
    """A device that measures. It sends over a link that it was given, and is handed what is received; nothing waits.

    Attributes:
        name: What people call it.
        signals: Names of the values it measures, such as `left.velocity`, with their units.
        listens_to: The frames it wants to be handed.
    """

    name: str
    signals: Mapping[str, str]
    listens_to: Collection[FrameKey]

    def start(self) -> None:
        """Send what the device must receive once the link is open."""

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the frames it listens to; True where it was intact, else it has been counted by cause."""

    def read(self) -> Readings:
        """The newest values."""


class MotorState(Protocol):
    """What a drive reports of its motors."""

    @property
    def is_enabled(self) -> bool:
        """Whether the drive has confirmed that its motors follow commands."""

    @property
    def is_off(self) -> bool:
        """Whether the drive reports that its motors are off.

        By its newest report, fresh, and received after it was last commanded to switch off; False without one.
        """

    def faults(self) -> tuple[str, ...]:
        """The faults that the drive has reported since it was commanded to enable; empty where there are none."""


class Drive(Sensor, MotorState, Protocol):
    """A motor controller for one or more wheels.

    Its part of `Sensor`, `MotorState` and `Diagnosed` is the same for every family; `PhasedDrive` has that of the
    motors.

    Attributes:
        commands: Names of the values it takes, such as `left.torque`, with their units.
        limits: Largest magnitude of each command.
    """

    commands: Mapping[str, str]
    limits: Sequence[float]

    def enable(self) -> None:
        """Begin to switch the motors on, through the drive's own states; zero is sent until it confirms."""

    def command(self, commands: Sequence[float]) -> None:
        """Send this cycle's frames: the commands where the drive is enabled, else zero or the next step of enabling."""

    def disable(self) -> None:
        """Send zero and switch the motors off; may be called at any time, and sends every time."""
