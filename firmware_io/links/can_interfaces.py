# SPDX-License-Identifier: MIT
"""Which CAN bus a configuration means, and whether it is there."""

import contextlib
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.errors import BusNotFoundError

NETWORK_DEVICES: Final = Path("/sys/class/net")
_CAN_HARDWARE_TYPE: Final = "280"
"""ARPHRD_CAN of linux/if_arp.h, as sysfs prints it."""
_IS_UP: Final = 1
"""IFF_UP of linux/if.h."""


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


def describe(asked: tuple[str, str], chosen: tuple[str, str]) -> str:
    """The bus in use, and what was asked for where that was left open; each is an interface and a channel."""
    text = " ".join(chosen)
    return f"{text} (chosen by '{' '.join(asked)}')" if "auto" in asked else text


def check_socketcan(channel: str, bitrate: int) -> None:
    """Find out whether a CAN network interface can be used.

    Args:
        channel: Its name.
        bitrate: What it should be set to, bit/s, for the command that is proposed.

    Raises:
        BusNotFoundError: It is missing or down.
    """
    present = socketcan_interfaces()
    if channel not in present:
        there = f"there is {', '.join(present)}" if present else "this machine has no CAN interface"
        raise BusNotFoundError(
            f"no CAN interface is called '{channel}'; {there}. "
            "Use interface: auto for a virtual bus, or set the interface up first"
        )
    flags = 0
    with contextlib.suppress(OSError):  # it may have gone since it was listed
        flags = int((NETWORK_DEVICES / channel / "flags").read_text(), 16)
    if not flags & _IS_UP:
        raise BusNotFoundError(
            f"CAN interface {channel} is down; set it up: sudo ip link set {channel} up type can bitrate {bitrate}"
        )


def cannot_open(description: str, error: Exception) -> BusNotFoundError:
    """The error for a bus that is there but does not open."""
    return BusNotFoundError(f"cannot open CAN bus {description}: {error}; check interface and channel")
