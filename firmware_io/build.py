# SPDX-License-Identifier: MIT
"""The settings of a robot's hardware made into its parts."""

from typing import TYPE_CHECKING, Final, TypeVar

import msgspec

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.command_gate import CommandGate
from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.firmware_io.hardware import Hardware
from segway_ecc.firmware_io.heartbeat import BusOwner
from segway_ecc.firmware_io.imus.family import imu_of
from segway_ecc.firmware_io.imus.settings import SerialImuSettings
from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.joined_link import JoinedLink
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings, SerialSettings
from segway_ecc.firmware_io.settings import HardwareSettings

if TYPE_CHECKING:
    from segway_ecc.firmware_io.links.serial_link import OpenPort, SerialCodec, SerialLink

Drives = TypeVar("Drives", bound=HardwareSettings)

_STALE_PERIODS: Final = 3
"""Of a loop so slow that its drives' watchdog would not do: commands may be as late as this."""


def can_link(settings: CanSettings, clock: Clock) -> Link:
    """The link that a robot file describes."""
    return make_can_link(
        settings.interface,
        settings.channel,
        settings.bitrate,
        clock.now_ns,
        clock.wall_ns,
        fd_bitrate=settings.fd_bitrate,
    )


def make_link(
    settings: HardwareSettings, clock: Clock, bus: Link | None = None, open_port: "OpenPort | None" = None
) -> Link:
    """The way to the drives that a robot file describes: a bus, with a serial line to fall back on where it has one.

    Or a serial line alone; beside it that of an IMU which has one. `bus` is used instead of the one that the settings
    name, `open_port` instead of what opens the system's ports.
    """
    main, imu = _drives_link(settings, clock, bus, open_port), imu_line(settings)
    if imu is None:
        return main
    from segway_ecc.firmware_io.links.serial_link import SerialLink, open_serial_port  # noqa: PLC0415 - see below

    codec = imu_of(imu).serial_codec
    if codec is None:
        raise ValueError(f"IMU {imu.__struct_config__.tag} has a serial line, and no codec for it")
    return JoinedLink(main, SerialLink(imu.serial, codec(), clock.now_ns, open_port or open_serial_port))


def imu_line(settings: HardwareSettings) -> SerialImuSettings | None:
    """The settings of an IMU that is on a serial line of its own; None where there is none."""
    imu = settings.external_imu
    return imu if isinstance(imu, SerialImuSettings) else None


def _drives_link(settings: HardwareSettings, clock: Clock, bus: Link | None, open_port: "OpenPort | None") -> Link:
    line, serial = settings.line, serial_of(settings)
    if not isinstance(line, CanSettings):
        only = _serial_link(settings, line, clock, open_port)
        only.is_active = True
        return only
    first = can_link(line, clock) if bus is None else bus
    if serial is None:
        return first
    second = _serial_link(settings, serial, clock, open_port)
    return RedundantLink(first, second, clock.now_ns, round(serial.lost_after_s * 1e9), round(serial.dwell_s * 1e9))


def _serial_link(
    settings: HardwareSettings, line: PortSettings, clock: Clock, open_port: "OpenPort | None"
) -> "SerialLink":
    # Here, since a robot without such a line starts without pyserial.
    from segway_ecc.firmware_io.links.serial_link import PacketPause, SerialLink, open_serial_port  # noqa: PLC0415

    pause_bytes = family_of(settings).packet_pause_bytes
    pause = PacketPause(pause_bytes, clock.sleep_until_ns) if pause_bytes else None
    return SerialLink(line, serial_codec(settings), clock.now_ns, open_port or open_serial_port, pause)


def guard_link(settings: HardwareSettings, clock: Clock) -> Link:
    """The guard's way to the drives, beside the node's: the same bus; or the same serial line, to write on alone."""
    line = settings.line
    if isinstance(line, CanSettings):
        return can_link(line, clock)
    from segway_ecc.firmware_io.links.serial_writer import SerialWriter  # noqa: PLC0415 - as above

    return SerialWriter(line, serial_codec(settings), clock.now_ns)


def takes_serial(settings: HardwareSettings) -> bool:
    """Whether the drive family has a serial line, be one named or not."""
    return "serial" in settings.__struct_fields__


def with_port(settings: Drives, port: str) -> Drives:
    """The settings with their serial line at another port; where they name none, one like any other.

    Raises:
        ValueError: The drive family has no serial line; see `takes_serial`.
    """
    if not takes_serial(settings):
        raise ValueError(f"{type(settings).__name__} has no serial line")
    named: PortSettings | None = getattr(settings, "serial", None)
    serial = msgspec.structs.replace(named or SerialSettings(port=port), port=port)
    return msgspec.structs.replace(settings, serial=serial)


def with_imu_port(settings: Drives, port: str) -> Drives:
    """The settings with their IMU's serial line at another port.

    Raises:
        ValueError: No IMU has one; see `imu_line`.
    """
    imu = imu_line(settings)
    if imu is None:
        raise ValueError(f"{type(settings).__name__} has no IMU on a serial line of its own")
    imu = msgspec.structs.replace(imu, serial=msgspec.structs.replace(imu.serial, port=port))
    return msgspec.structs.replace(settings, external_imu=imu)


def serial_of(settings: HardwareSettings) -> SerialSettings | None:
    """The serial line that drives on a bus fall back on; None where they have none or none is named."""
    serial = getattr(settings, "serial", None)
    return serial if isinstance(serial, SerialSettings) else None


def serial_codec(settings: HardwareSettings) -> "SerialCodec":
    """What a drive family speaks on its serial line.

    Raises:
        ValueError: It has none; see `takes_serial`.
    """
    codec = family_of(settings).serial_codec
    if codec is None:
        raise ValueError(f"{settings.__struct_config__.tag} drives have no serial line")
    return codec(settings)


def build_hardware(
    settings: HardwareSettings, loop_period_s: float, clock: Clock, link: Link | None = None
) -> Hardware:
    """The drives and sensors that a robot file describes, exchanged with once in each loop period, s.

    `link` is used instead of what the settings name, as the rig does.
    """
    used = make_link(settings, clock) if link is None else link
    drives = family_of(settings).drives(settings, used, loop_period_s, clock)
    imu = settings.external_imu
    sensors = [] if imu is None else [imu_of(imu).sensor(imu, used, loop_period_s, clock, settings.ride_through_s)]
    # What runs on a link of the rig is alone there, has no guard, and must be the same every time.
    owner = None
    if link is None:
        owner = BusOwner(settings.line, clock.now_ns, needs_guard=settings.guard == "required")
    stale_ns = round(max(settings.watchdog_s, _STALE_PERIODS * loop_period_s) * 1e9)
    gate = CommandGate(drives, owner, stale_ns, clock.now_ns)
    return Assembly(used, drives, sensors, clock.now_ns, gate=gate)
