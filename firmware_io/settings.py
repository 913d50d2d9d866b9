"""What a robot file says of its hardware: the parts that every drive family shares."""

from typing import Annotated, Literal

import msgspec

from firmware_io.drivetrain import Drivetrain
from firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from firmware_io.section import Section

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]


class CanSettings(Section, frozen=True, kw_only=True):
    """A CAN bus.

    Attributes:
        interface: A python-can interface, or `auto`: SocketCAN where the channel exists, else a virtual bus.
        channel: The channel, or `auto`: the first SocketCAN interface.
        bitrate: bit/s, for interfaces that set it themselves, for the bus load and for the simulated bus.
    """

    interface: str = "auto"
    channel: str = "auto"
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 500_000


class SerialSettings(Section, frozen=True, kw_only=True):
    """A serial line.

    Attributes:
        port: A device, or any other URL that pyserial takes.
        baudrate: bit/s on the line, of which one in ten carries a byte.
        lost_after_s: A drive unheard on the bus for longer than this, s, is a reason to pass to this line.
        dwell_s: Shortest time between two changes of lines, s.
    """

    port: str
    baudrate: Annotated[int, msgspec.Meta(ge=9_600, le=12_000_000)] = 921_600
    lost_after_s: Annotated[float, msgspec.Meta(ge=0.005, le=0.05)] = 0.02
    dwell_s: Annotated[float, msgspec.Meta(ge=0.1, le=60.0)] = 1.0


class WheelSettings(Section, frozen=True, kw_only=True):
    """Between a motor and its wheel; see `Drivetrain`.

    Attributes:
        gear_ratio: Turns of the motor for one turn of the wheel.
        direction: 1 where a positive motor turn rolls the robot forward, -1 where it rolls it back.
        max_torque: Largest torque that is asked for at the wheel, N m.
    """

    gear_ratio: Positive = 1.0
    direction: Literal[1, -1] = 1
    max_torque: Positive

    @property
    def drivetrain(self) -> Drivetrain:
        """Gear ratio and direction as what converts."""
        return Drivetrain(self.gear_ratio, self.direction)


class BusSettings(Section, frozen=True, kw_only=True):
    """How drives are reached.

    Attributes:
        can: The bus they are on.
        watchdog_s: How long a drive waits for a command before it switches its motors off by itself, s.
        external_imu: An IMU of its own on the same bus, where there is one.
    """

    can: CanSettings = CanSettings()
    watchdog_s: Annotated[float, msgspec.Meta(ge=0.02, le=0.05)] = 0.05
    external_imu: XsensMtiSettings | None = None
