# SPDX-License-Identifier: MIT
"""What the kernel's CAN error frames report of a bus: its state, its error counters and what went wrong.

Source: linux/can/error.h. An error frame's identifier is a set of class bits; its eight bytes carry details.
"""

from collections import Counter
from typing import Final, NamedTuple

from segway_ecc.firmware_io.links.link import LinkState

_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_RESTARTED: Final = 0x100
_COUNTERS: Final = 0x200
_CLASSES: Final = {
    0x001: "tx_timeout",
    0x002: "lost_arbitration",
    _CONTROLLER: "controller",
    0x008: "protocol",
    0x010: "transceiver",
    0x020: "no_acknowledgement",
    _BUS_OFF: "bus_off",
    0x080: "bus_error",
    _RESTARTED: "restarted",
}
_DETAILS: Final = {0x01: "rx_overflow", 0x02: "tx_overflow"}
"""Of byte 1, where the class is `controller`: queues of the controller that ran over."""
_STATES: Final = ((0x30, LinkState.PASSIVE), (0x0C, LinkState.WARNING), (0x40, LinkState.ACTIVE))
"""Bits of the same byte, for reception or transmission; a controller is in the worse of the two."""
_LENGTH: Final = 8


class BusError(NamedTuple):
    """One error frame.

    Attributes:
        causes: What went wrong, by the kernel's classes; `other` where it names none.
        state: What the controller has become; None where the frame does not carry it.
        tec: The controller's transmit error counter; None where the frame does not carry it.
        rec: Its receive error counter; likewise.
    """

    causes: tuple[str, ...]
    state: LinkState | None = None
    tec: int | None = None
    rec: int | None = None


def decode_error(classes: int, data: bytes) -> BusError:
    """Read an error frame from its identifier, without flags, and its bytes, of which missing ones count as zero.

    Never raises.
    """
    filled = data.ljust(_LENGTH, b"\0")
    is_of_controller = bool(classes & _CONTROLLER)
    causes = [name for bit, name in _CLASSES.items() if classes & bit]
    if is_of_controller:
        causes += [name for bit, name in _DETAILS.items() if filled[1] & bit]
    state = LinkState.ACTIVE if classes & _RESTARTED else None
    if is_of_controller:
        state = next((state for bits, state in _STATES if filled[1] & bits), state)
    if classes & _BUS_OFF:
        state = LinkState.BUS_OFF
    tec, rec = (filled[6], filled[7]) if classes & _COUNTERS else (None, None)
    return BusError(tuple(causes) or ("other",), state, tec, rec)


class BusErrors:
    """What is known of a controller from all its error frames: the newest of each, as `BusError` has it, and causes."""

    def __init__(self) -> None:
        self.state = LinkState.ACTIVE
        self.tec: int | None = None
        self.rec: int | None = None
        self.counts: Counter[str] = Counter()

    def begin(self) -> None:
        """Begin with a bus of which nothing is known, and so is taken to be well; the counts stay."""
        self.state, self.tec, self.rec = LinkState.ACTIVE, None, None

    def learn(self, state: LinkState | None, tec: int | None, rec: int | None) -> None:
        """Take over what is known; None is not."""
        self.state = self.state if state is None else state
        self.tec = self.tec if tec is None else tec
        self.rec = self.rec if rec is None else rec

    def take_frame(self, classes: int, data: bytes) -> None:
        """Take one error frame; see `decode_error`."""
        error = decode_error(classes, data)
        self.counts.update(error.causes)
        self.learn(error.state, error.tec, error.rec)

    def as_text(self) -> dict[str, str]:
        """Error counters where known, and counts of what happened at all."""
        levels = {} if self.tec is None else {"tec": str(self.tec), "rec": str(self.rec)}
        return levels | {f"errors.{cause}": str(count) for cause, count in self.counts.items()}
