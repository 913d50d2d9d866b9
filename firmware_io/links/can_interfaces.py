# SPDX-License-Identifier: MIT
"""Which CAN bus a configuration means, whether it is there, and what the kernel knows of it.

The last by one RTM_GETLINK over a netlink socket. Sources: linux/netlink.h, linux/rtnetlink.h, linux/if_link.h,
linux/can/netlink.h. Netlink speaks the machine's own byte order.
"""

import contextlib
import socket
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.link import LinkState
from segway_ecc.firmware_io.links.reopening import BackgroundTask

NETWORK_DEVICES: Final = Path("/sys/class/net")
_CAN_HARDWARE_TYPE: Final = "280"
"""ARPHRD_CAN of linux/if_arp.h, as sysfs prints it."""
_IS_UP: Final = 1
"""IFF_UP of linux/if.h."""
_FD_MTU: Final = 72
"""CANFD_MTU of linux/can.h: an interface that carries classic frames only has 16."""

_HEADER: Final = struct.Struct("=IHHII")
"""nlmsghdr: length, type, flags, sequence number, port."""
_INTERFACE: Final = struct.Struct("=BxHiII")
"""ifinfomsg: family, hardware type, index, flags, change mask."""
_ATTRIBUTE: Final = struct.Struct("=HH")
"""rtattr: length with this header, type."""
_U32: Final = struct.Struct("=I")
_TWO_U16: Final = struct.Struct("=HH")

_REQUEST: Final = 1
_GETLINK: Final = 18
_NEWLINK: Final = 16
_TYPE_BITS: Final = 0x3FFF
"""What of an attribute's type is its number; the two bits above are flags."""
_NAME, _LINKINFO = 3, 18
_KIND, _DATA = 1, 2
_BIT_TIMING, _STATE, _RESTART_MS, _ERROR_COUNTERS, _DATA_BIT_TIMING = 1, 4, 6, 8, 9
_STATES: Final = (LinkState.ACTIVE, LinkState.WARNING, LinkState.PASSIVE, LinkState.BUS_OFF)
"""can_state 0 to 3; those above are of an interface that is down."""
_NO_BITRATE: Final = (0, 0xFFFFFFFF)
"""Not set, and set where the kernel does not see it (slcan)."""
_REPLY_BYTES: Final = 1 << 15
_NAME_BYTES: Final = 15
"""IFNAMSIZ without its end."""


def socketcan_interfaces(devices: Path | None = None) -> list[str]:
    """The names of this machine's CAN network interfaces, up or down."""
    names = []
    for device in sorted((devices or NETWORK_DEVICES).glob("*")):
        with contextlib.suppress(OSError):
            if (device / "type").read_text().strip() == _CAN_HARDWARE_TYPE:
                names.append(device.name)
    return names


def resolve(interface: str, channel: str) -> tuple[str, str]:
    """Choose the python-can interface and channel that a configuration means.

    The interface `auto` is SocketCAN where the channel exists, else the virtual bus; the channel `auto`, the first
    SocketCAN interface, else `robot`.
    """
    present = socketcan_interfaces()
    if interface not in ("auto", "socketcan"):
        return interface, "robot" if channel == "auto" else channel
    if channel == "auto" and present:
        return "socketcan", present[0]
    if interface == "socketcan" or channel in present:
        return "socketcan", channel
    return "local", "robot" if channel == "auto" else channel


def set_up_options(bitrate: int, fd_bitrate: int | None) -> str:
    """What `ip link set ... type can` takes for a bus, whose CAN FD, if any, sends data at `fd_bitrate`, bit/s."""
    return f"bitrate {bitrate}" + ("" if fd_bitrate is None else f" dbitrate {fd_bitrate} fd on")


def check_socketcan(channel: str, bitrate: int, fd_bitrate: int | None = None) -> None:
    """Find out whether the CAN network interface `channel` can be used.

    The bit rates, bit/s, are what to propose for it; with that of CAN FD's data the interface must carry CAN FD.

    Raises:
        BusNotFoundError: It is missing or down, or carries classic frames only.
    """
    options = set_up_options(bitrate, fd_bitrate)
    present = socketcan_interfaces()
    if channel not in present:
        there = f"there is {', '.join(present)}" if present else "this machine has no CAN interface"
        raise BusNotFoundError(
            f"no CAN interface is called '{channel}'; {there}. "
            "Use interface: auto for a virtual bus, or set the interface up first"
        )
    flags, longest = 0, _FD_MTU
    with contextlib.suppress(OSError):  # it may have gone since it was listed
        flags = int((NETWORK_DEVICES / channel / "flags").read_text(), 16)
        if fd_bitrate is not None:
            longest = int((NETWORK_DEVICES / channel / "mtu").read_text())
    if not flags & _IS_UP:
        raise BusNotFoundError(
            f"CAN interface {channel} is down; set it up: sudo ip link set {channel} up type can {options}"
        )
    if longest < _FD_MTU:
        raise BusNotFoundError(
            f"CAN interface {channel} carries classic frames only, and the robot's drives are on CAN FD; set it up: "
            f"sudo ip link set {channel} down; sudo ip link set {channel} up type can {options}"
        )


@dataclass(frozen=True, slots=True)
class InterfaceState:
    """A CAN interface; what its driver does not report is None. A virtual one reports only its kind.

    Attributes:
        kind: The kernel's name for the sort of interface: `can`, `vcan`.
        is_up: Whether it is set up.
        bitrate: In bit/s.
        restart_ms: After how long the kernel restarts a controller that is bus-off, ms; 0 for never.
        tec: The controller's transmit error counter.
        rec: Its receive error counter.
        data_bitrate: Of the data in frames of CAN FD, bit/s; None too where the interface carries classic frames only.
    """

    kind: str
    is_up: bool
    state: LinkState | None = None
    bitrate: int | None = None
    restart_ms: int | None = None
    tec: int | None = None
    rec: int | None = None
    data_bitrate: int | None = None

    def __str__(self) -> str:
        """In a few words, for people."""
        if self.state is None and self.bitrate is None:
            return f"{self.kind or 'unknown'}: no controller that reports"
        words = [str(self.state or "down")]
        words += [f"{self.bitrate} bit/s"] if self.bitrate is not None else []
        words += [f"data at {self.data_bitrate} bit/s"] if self.data_bitrate is not None else []
        words.append(
            f"restarted {self.restart_ms} ms after bus-off" if self.restart_ms else "not restarted after bus-off"
        )
        return ", ".join(words)


UNKNOWN: Final = InterfaceState("", is_up=False)
"""An interface of which the kernel reports nothing."""


def read_interface_state(name: str) -> InterfaceState:
    """Ask the kernel for an interface; `UNKNOWN` where there is no such one, or the kernel does not answer.

    The kernel answers at once, but may be blocked by somebody who is changing an interface: not for the loop.
    """
    try:
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as sock:
            sock.setblocking(False)  # noqa: FBT003 - the standard library's signature
            sock.send(encode_request(name))
            return parse_reply(sock.recv(_REPLY_BYTES))
    except OSError:
        return UNKNOWN


def encode_request(name: str) -> bytes:
    """The message that asks for one interface by name."""
    text = name.encode()[:_NAME_BYTES] + b"\0"
    attribute = _ATTRIBUTE.pack(_ATTRIBUTE.size + len(text), _NAME) + text
    body = _INTERFACE.pack(socket.AF_UNSPEC, 0, 0, 0, 0) + attribute.ljust(-(-len(attribute) // 4) * 4, b"\0")
    return _HEADER.pack(_HEADER.size + len(body), _GETLINK, _REQUEST, 1, 0) + body


def parse_reply(reply: bytes) -> InterfaceState:
    """Read the kernel's answer; `UNKNOWN` where it is not one about an interface. Never raises."""
    fixed = _HEADER.size + _INTERFACE.size
    if len(reply) < fixed:
        return UNKNOWN
    length, kind, *_ = _HEADER.unpack_from(reply)
    if kind != _NEWLINK or not fixed <= length <= len(reply):
        return UNKNOWN
    flags = _INTERFACE.unpack_from(reply, _HEADER.size)[3]
    info = _attributes(_attributes(reply[fixed:length]).get(_LINKINFO, b""))
    name = info.get(_KIND, b"").rstrip(b"\0").decode("ascii", "replace")
    # Only the kind `can` has a controller; in others the same numbers mean something else.
    controller = _attributes(info.get(_DATA, b"")) if name == "can" else {}
    state, bitrate = _u32(controller, _STATE), _u32(controller, _BIT_TIMING)
    data_bitrate = _u32(controller, _DATA_BIT_TIMING)
    errors = controller.get(_ERROR_COUNTERS, b"")
    tec, rec = _TWO_U16.unpack_from(errors) if len(errors) >= _TWO_U16.size else (None, None)
    return InterfaceState(
        name,
        bool(flags & _IS_UP),
        _STATES[state] if state is not None and state < len(_STATES) else None,
        None if bitrate in _NO_BITRATE else bitrate,
        _u32(controller, _RESTART_MS),
        tec,
        rec,
        None if data_bitrate in _NO_BITRATE else data_bitrate,
    )


def _u32(attributes: Mapping[int, bytes], number: int) -> int | None:
    value = attributes.get(number, b"")
    return int(_U32.unpack_from(value)[0]) if len(value) >= _U32.size else None


def _attributes(data: bytes) -> dict[int, bytes]:
    found: dict[int, bytes] = {}
    offset = 0
    while offset + _ATTRIBUTE.size <= len(data):
        length, number = _ATTRIBUTE.unpack_from(data, offset)
        if not _ATTRIBUTE.size <= length <= len(data) - offset:
            break
        found[number & _TYPE_BITS] = data[offset + _ATTRIBUTE.size : offset + length]
        offset += -(-length // 4) * 4
    return found


class InterfaceWatch:
    """Keeps the newest answer, and asks again at each look; a bus that is no network interface is never asked about."""

    def __init__(self, name: str | None) -> None:
        """Watch the network interface `name`."""
        self.state = UNKNOWN
        self._name = name
        self._task: BackgroundTask[InterfaceState] | None = None
        self._error_frames = 0

    def read(self) -> InterfaceState:
        """Ask now, and wait for the answer; for use off the loop."""
        return UNKNOWN if self._name is None else read_interface_state(self._name)

    def begin(self, state: InterfaceState) -> None:
        """Start from an answer, and discard the answer to an earlier question."""
        self.state = state
        self._task = None

    def look(self, error_frames: int) -> bool:
        """See whether an answer has come, and ask anew.

        True where `state` is new, and was asked for after the last of the `error_frames` received so far had come.
        """
        if self._name is None:
            return False
        is_news = False
        if self._task is not None:
            answer = self._task.take_outcome()
            if answer is None:
                return False
            if isinstance(answer, InterfaceState):
                self.state = answer
                is_news = error_frames == self._error_frames
        self._error_frames = error_frames
        self._task = BackgroundTask(self.read)
        return is_news

    def as_text(self) -> Mapping[str, str]:
        """The interface in a few words; nothing for a bus that is none."""
        return {} if self._name is None else {"interface": str(self.state)}
