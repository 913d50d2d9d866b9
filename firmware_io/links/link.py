# SPDX-License-Identifier: MIT
"""The interface between a device and the wire, and what is counted there."""

import enum
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Final, Protocol

from segway_ecc.firmware_io.value import Value

NowNs = Callable[[], int]
"""The clock of the loop, monotonic, ns."""
_NS_PER_S: Final = 1e9
_SHORT_CRC_BYTES: Final = 16
"""Up to so many bytes the CRC of a CAN FD frame has 17 bits."""


FD_LENGTHS: Final[tuple[int, ...]] = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Bytes of data that a CAN FD frame can have (ISO 11898-1:2015)."""


class Frame(Value, frozen=True):
    """A CAN frame, classic or of CAN FD; on a serial line, what the line carries in place of one.

    Attributes:
        arbitration_id: 11 bits, or 29 where `is_extended`.
        data: 0 to 8 bytes; of CAN FD, as many as one of `FD_LENGTHS`.
        received_ns: When it arrived, on the clock of the loop, ns; 0 for a frame to be sent.
        is_extended: Whether the identifier is a 29-bit one.
        is_remote: Whether it asks for the data instead of carrying it; a robot sends such frames, and receives none.
        is_fd: Whether it is of CAN FD. Whether its data go at a bit rate of their own is up to the bus it is sent on.
    """

    arbitration_id: int
    data: bytes
    received_ns: int = 0
    is_extended: bool = False
    is_remote: bool = False
    is_fd: bool = False


def fd_length(size: int) -> int:
    """The least length of a CAN FD frame that has room for `size` bytes; ValueError for more than 64."""
    for length in FD_LENGTHS:
        if length >= size:
            return length
    raise ValueError(f"a CAN FD frame has room for {FD_LENGTHS[-1]} bytes, not for {size}")


def worst_case_bits(length: int, *, is_extended: bool) -> int:
    """Bits of a frame with `length` bytes of data, with the most stuffing possible and the space after it.

    Source: Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis", Real-Time Systems 35
    (2007), equations 1 and 2: 55 + 10 n bits for 11-bit identifiers, 80 + 10 n for 29-bit ones, n bytes of data.
    """
    return (80 if is_extended else 55) + 10 * length


def worst_case_fd_bits(length: int, *, is_extended: bool) -> tuple[int, int]:
    """Bits of a CAN FD frame: those at the bus's bit rate, and those at the rate of its data; as `worst_case_bits`.

    Source: the fields of ISO 11898-1:2015. At the bus's rate: from start of frame to the bit-rate switch, 17 bits or
    36, with a stuff bit after each four, and 13 from the delimiter of the CRC to the space after it. At that of the
    data: five bits and the data with their stuff bits, a stuff count of four, a CRC of 17 bits or, above 16 bytes, of
    21, and the fixed stuff bits of those two.
    """
    head, covered = (36 if is_extended else 17), 5 + 8 * length
    check = 4 + (17 if length <= _SHORT_CRC_BYTES else 21)
    return head + (head - 1) // 4 + 13, covered + -(-covered // 4) + check + 1 + check // 4


@enum.unique
class LinkState(enum.StrEnum):
    """What a link can still do: the states of a CAN controller (ISO 11898-1), and gone."""

    ACTIVE = "active"
    WARNING = "warning"
    """An error counter has reached 96."""
    PASSIVE = "passive"
    """An error counter has reached 128: nobody acknowledges, or the bus is disturbed."""
    BUS_OFF = "bus-off"
    """The controller has left the bus."""
    GONE = "gone"
    """The interface, adapter or port is down or not there."""


@dataclass(slots=True)
class LinkCounters:
    """What passed over a link since it was opened, and what did not."""

    sent: int = 0
    received: int = 0
    bits: int = 0
    """Of the frames sent and received, with the most stuffing possible; faster ones as what they take at the bus's bit
    rate."""
    send_dropped: int = 0
    """Frames the transmit queue had no room for."""
    error_frames: int = 0
    remote_frames: int = 0
    echoes: int = 0
    """Frames that came back from ourselves, ignored."""
    undecodable: int = 0
    """Received data that was no frame at all."""
    overflows: int = 0
    """Frames that arrived while the receive queue was full, and were lost there."""
    reopened: int = 0
    """Times that the interface went and came back."""

    def as_text(self) -> Mapping[str, str]:
        """Every count by name."""
        return {name: str(count) for name, count in asdict(self).items()}


class Meter:
    """Measures how fast a link's counts grow."""

    def __init__(self, counters: LinkCounters, now_ns: NowNs) -> None:
        """Begin now, from the counts as they are."""
        self._counters = counters
        self._now_ns = now_ns
        self._looked_ns = now_ns()
        self._counts = self._read()
        self._per_s = (0.0,) * len(self._counts)

    def measure(self, bitrate: int) -> Mapping[str, str]:
        """The rates since the last call, as text; those of the last call where no time has passed since.

        The load is the share of `bitrate`, bit/s, that was in use.
        """
        now_ns, counts = self._now_ns(), self._read()
        elapsed_s = (now_ns - self._looked_ns) / _NS_PER_S
        if elapsed_s > 0.0:
            self._per_s = tuple((new - old) / elapsed_s for new, old in zip(counts, self._counts, strict=True))
            self._looked_ns, self._counts = now_ns, counts
        sent, received, errors, bits = self._per_s
        return {
            "sent_per_s": f"{sent:.1f}",
            "received_per_s": f"{received:.1f}",
            "errors_per_s": f"{errors:.1f}",
            "load_percent": f"{100.0 * bits / bitrate:.1f}",
        }

    def _read(self) -> tuple[int, ...]:
        counters = self._counters
        return counters.sent, counters.received, counters.error_frames, counters.bits


class LinkStatus(Protocol):
    """What a link reports of itself."""

    @property
    def counters(self) -> LinkCounters:
        """What passed over it, and what did not."""

    @property
    def description(self) -> str:
        """Which bus this is, for people."""

    @property
    def state(self) -> LinkState:
        """What the link can still do, as far as it knows."""

    @property
    def health(self) -> Mapping[str, str]:
        """The link's state, counts and rates as text, for diagnostics; called about once a second."""


class Link(LinkStatus, Protocol):
    """A bus as the loop uses it: nothing here waits, except `open`.

    Four methods move frames; the four of `LinkStatus` are what diagnostics show of any link, data that it has anyway.
    A link that is lost tries by itself to come back, off the loop where that takes time.
    """

    def open(self) -> None:
        """Open the bus.

        Raises:
            BusNotFoundError: The bus is not there or cannot be used.
        """

    def send(self, frame: Frame) -> bool:
        """Queue a frame; False where it was dropped, which is counted."""

    def receive(self) -> list[Frame]:
        """Take every data frame of others that has arrived, oldest first; anything else is counted.

        Raises:
            LinkLostError: The bus is gone, and is not back yet.
        """

    def close(self) -> None:
        """Close the bus; a closed link may be closed again."""
