# SPDX-License-Identifier: MIT
"""What a robot file defines of its lines."""

from typing import Annotated

import msgspec

from segway_ecc.firmware_io.value import Section


class CanSettings(Section, frozen=True, kw_only=True):
    """A CAN bus.

    Attributes:
        interface: A python-can interface, or `auto`: SocketCAN where the channel exists, else a virtual bus.
        channel: The channel, or `auto`: the first SocketCAN interface.
        bitrate: bit/s, for interfaces that set it themselves, for the bus load and for the simulated bus.
        fd: Whether the bus carries frames of CAN FD too.
        data_bitrate: Of the data in those, bit/s; that of the rest where it is not given.
    """

    interface: str = "auto"
    channel: str = "auto"
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 500_000
    fd: bool = False
    data_bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=8_000_000)] | None = None

    def __post_init__(self) -> None:
        """Refuse a bit rate of data that no frame has, or that is the slower one; ValueError."""
        if self.data_bitrate is None:
            return
        if not self.fd:
            raise ValueError("data_bitrate is that of CAN FD: add fd: true, or leave it out")
        if self.data_bitrate < self.bitrate:
            raise ValueError(f"data_bitrate must be {self.bitrate} bit/s, which is bitrate, or more")

    @property
    def fd_bitrate(self) -> int | None:
        """Of the data in frames of CAN FD, bit/s; None where the bus carries classic frames only."""
        return (self.data_bitrate or self.bitrate) if self.fd else None


Baudrate = Annotated[int, msgspec.Meta(ge=9_600, le=12_000_000)]


class PortSettings(Section, frozen=True, kw_only=True):
    """A serial line.

    Attributes:
        port: A device, or any other URL that pyserial takes.
        baudrate: bit/s on the line, of which one in ten carries a byte.
    """

    port: str
    baudrate: Baudrate = 115_200


class SerialSettings(PortSettings, frozen=True, kw_only=True):
    """A serial line to fall back on; see `PortSettings`.

    Attributes:
        lost_after_s: A drive unheard on the bus for longer than this, s, is a reason to pass to this line.
        dwell_s: Shortest time between two changes of lines, s.
    """

    baudrate: Baudrate = 921_600
    lost_after_s: Annotated[float, msgspec.Meta(ge=0.005, le=0.05)] = 0.02
    dwell_s: Annotated[float, msgspec.Meta(ge=0.1, le=60.0)] = 1.0
