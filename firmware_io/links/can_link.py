"""A CAN bus through python-can, on any interface it offers."""

import contextlib
import errno
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import can

from firmware_io.errors import BusNotFoundError, LinkLostError
from firmware_io.links.link import Frame, LinkCounters

NowNs = Callable[[], int]

_CAN_HARDWARE_TYPE: Final = "280"
"""ARPHRD_CAN of linux/if_arp.h, as sysfs prints it."""
_NETWORK_DEVICES: Final = Path("/sys/class/net")
_MAX_FRAMES: Final = 512
"""Taken in one drain, so that a flooded bus cannot hold up the loop; the rest waits for the next."""
_GONE: Final = {errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF}


def socketcan_interfaces(devices: Path = _NETWORK_DEVICES) -> list[str]:
    """The names of this machine's CAN network interfaces, up or down."""
    names = []
    for device in sorted(devices.glob("*")):
        with contextlib.suppress(OSError):
            if (device / "type").read_text().strip() == _CAN_HARDWARE_TYPE:
                names.append(device.name)
    return names


def resolve(interface: str, channel: str) -> tuple[str, str]:
    """Choose the python-can interface and channel that a configuration means.

    Args:
        interface: A python-can interface, or `auto`: SocketCAN where the channel exists, else the virtual bus.
        channel: The channel, or `auto`: the first SocketCAN interface, else `robot`.
    """
    present = socketcan_interfaces()
    if interface not in ("auto", "socketcan"):
        return interface, "robot" if channel == "auto" else channel
    if channel == "auto" and present:
        return "socketcan", present[0]
    if interface == "socketcan" or channel in present:
        return "socketcan", channel
    return "local", "robot" if channel == "auto" else channel


def wall_ns() -> int:
    """The wall clock, ns: what SocketCAN stamps received frames with."""
    return time.clock_gettime_ns(time.CLOCK_REALTIME)


class CanLink:
    """A link over one python-can bus.

    A frame's `received_ns` is the kernel's own receive stamp moved to the loop's clock, kept between the last drain and
    now, so that neither a step of the wall clock nor a backend with a clock of its own can make a frame look fresh
    or old.
    """

    def __init__(
        self, interface: str, channel: str, bitrate: int, now_ns: NowNs = time.monotonic_ns, wall_ns: NowNs = wall_ns
    ) -> None:
        """Describe the bus; `open` opens it. `bitrate` in bit/s is used by backends that set it themselves."""
        self.counters = LinkCounters()
        self._interface, self._channel = resolve(interface, channel)
        self._asked = f"{interface} {channel}"
        self._bitrate = bitrate
        self._now_ns = now_ns
        self._wall_ns = wall_ns
        self._drained_ns = 0
        self._bus: can.BusABC | None = None

    @property
    def description(self) -> str:
        """The interface in use, and what was asked for where that was left open."""
        chosen = f"{self._interface} {self._channel}"
        return f"{chosen} (chosen by '{self._asked}')" if "auto" in self._asked else chosen

    def open(self) -> None:
        """Open the bus; see `Link.open`."""
        if self._interface == "socketcan":
            self._check_socketcan()
        try:
            self._bus = can.Bus(channel=self._channel, interface=self._interface, bitrate=self._bitrate)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            raise BusNotFoundError(
                f"cannot open CAN bus {self.description}: {error}; check interface and channel"
            ) from error
        self._drained_ns = self._now_ns()

    def send(self, frame: Frame) -> bool:
        """Queue a frame; see `Link.send`. A full queue drops it: an old command is worse than none."""
        message = can.Message(
            arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=frame.is_extended, check=False
        )
        try:
            self._open_bus().send(message, timeout=0)
        except (can.CanError, OSError, LinkLostError):
            # On the way out there may be no bus left; what matters is that the loss is counted and nothing waits.
            self.counters.send_dropped += 1
            return False
        self.counters.sent += 1
        return True

    def receive(self) -> list[Frame]:
        """Take what has arrived; see `Link.receive`."""
        bus = self._open_bus()
        frames: list[Frame] = []
        now_ns = self._now_ns()
        offset_ns = now_ns - self._wall_ns()
        try:
            for _ in range(_MAX_FRAMES):
                message = bus.recv(0)
                if message is None:
                    break
                self._take(message, offset_ns, now_ns, frames)
        except (can.CanError, OSError) as error:
            code = getattr(error, "error_code", None) or getattr(error, "errno", None)
            if code in _GONE:
                raise LinkLostError(f"CAN bus {self.description} is gone: {error}") from error
            self.counters.undecodable += 1
        self._drained_ns = now_ns
        return frames

    def close(self) -> None:
        """Close the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _take(self, message: can.Message, offset_ns: int, now_ns: int, frames: list[Frame]) -> None:
        # Error frames first: their identifier is a bit field that can equal a data frame's.
        if message.is_error_frame:
            self.counters.error_frames += 1
        elif message.is_remote_frame:
            self.counters.remote_frames += 1
        else:
            self.counters.received += 1
            stamp_ns = int(message.timestamp * 1e9) + offset_ns
            received_ns = min(max(stamp_ns, self._drained_ns), now_ns)
            frames.append(Frame(message.arbitration_id, bytes(message.data), received_ns, message.is_extended_id))

    def _open_bus(self) -> can.BusABC:
        if self._bus is None:
            raise LinkLostError(f"CAN bus {self.description} is not open")
        return self._bus

    def _check_socketcan(self) -> None:
        present = socketcan_interfaces()
        if self._channel not in present:
            there = f"there is {', '.join(present)}" if present else "this machine has no CAN interface"
            raise BusNotFoundError(
                f"no CAN interface is called '{self._channel}'; {there}. "
                "Use interface: auto for a virtual bus, or set the interface up first"
            )
        if not _is_up(self._channel):
            raise BusNotFoundError(
                f"CAN interface {self._channel} is down; "
                f"set it up: sudo ip link set {self._channel} up type can bitrate {self._bitrate}"
            )


def _is_up(name: str) -> bool:
    try:
        flags = int((_NETWORK_DEVICES / name / "flags").read_text(), 16)
    except OSError:  # it has gone since it was listed
        return False
    return bool(flags & 1)
