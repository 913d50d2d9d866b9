# SPDX-License-Identifier: MIT
"""The wheel board's commands in version 2 of its protocol: a frame for each wheel, bound to a session and a counter.

A command is two frames with the same counter, the left wheel's first, and acts when both have passed. Eight bytes:

    voltage i16 0.001 V | counter, 15 bits, and Enable as bit 15, u16 | code u32        little-endian

SESSION_SETUP has the watchdog's time, u16 0.001 s, in place of the voltage. The code is CRC-32/ISO-HDLC (as in zlib)
over session u32, whole counter u32, identifier u16, and the first four bytes. Of the counter the frame carries 15 bits;
both ends count the rest, so that no count comes again in a session, and the board begins a session with a number that
it never had before. That is against noise and recordings, not against somebody who means to forge: nothing is secret.
A CRC and not a keyed hash, since without a secret a hash adds nothing, and every microcontroller has this one. It tells
apart for certain what differs in no more than 32 bits in a row: counts that agree in the 15 bits among them.
"""

import binascii
import enum
import struct
from collections import Counter
from typing import Final

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSetup,
    FrameId,
    WheelCommand,
    voltage_steps,
    voltage_value,
    watchdog_steps,
    watchdog_value,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

WINDOW: Final = 64
"""How far ahead of the last command the next may be: what is missed in 64 ms at 1 kHz, when the watchdog is due."""
SESSION_SILENT_S: Final = 0.2
"""Without a command for so long, a board that is not enabled begins a new session: its host may have restarted."""

_LEFTS_KEPT: Final = 4
"""Left frames that wait: of two commands that are queued at once the lower identifiers win the bus, the left ones."""
CARRIED: Final = 0x7FFF
"""The bits of the counter that a frame carries."""
_EPOCH_BITS: Final = 15
_ENABLE: Final = 0x8000
_COUNTS: Final = 1 << 32
_LENGTH: Final = 8
_BODY: Final = 4
_SIGNED: Final = struct.Struct("<hH")
_UNSIGNED: Final = struct.Struct("<HH")
_CONTEXT: Final = struct.Struct("<IIH")
_CODE: Final = struct.Struct("<I")
_VERSION_1: Final = frozenset({int(FrameId.WHEEL_COMMAND), int(FrameId.BOARD_SETUP)})


@enum.unique
class CommandId(enum.IntEnum):
    """Arbitration ids; lower than those of telemetry, and the setup, which is sent before a command, lowest."""

    SESSION_SETUP = 0x112
    LEFT_COMMAND = 0x113
    RIGHT_COMMAND = 0x114


_OURS: Final = _VERSION_1 | frozenset(map(int, CommandId))


def code_of(session: int, counter: int, identifier: int, body: bytes) -> int:
    """The code of a frame from its first four bytes."""
    return binascii.crc32(body, binascii.crc32(_CONTEXT.pack(session, counter, identifier)))


def voltage_of(data: bytes) -> float:
    """The voltage in LEFT_COMMAND or RIGHT_COMMAND, V, for who only looks on: neither counter nor code is checked."""
    steps: int = _SIGNED.unpack_from(data)[0]
    return voltage_value(steps)


class CommandSession:
    """What both ends know of a session: its number, and the count of the newest command, sent or obeyed.

    Attributes:
        number: 0 to 2**32 - 1; meaningless before `begin`.
        counter: Of the newest command; the first of a session has 1.
        is_begun: Whether there is a session.
    """

    __slots__ = ("counter", "is_begun", "number")

    def __init__(self) -> None:
        """Begin with none."""
        self.number = 0
        self.counter = 0
        self.is_begun = False

    def begin(self, number: int, epoch: int = 0) -> None:
        """Enter a session, of whose counter the upper bits are `epoch`."""
        self.number, self.counter, self.is_begun = number, epoch << _EPOCH_BITS, True

    @property
    def epoch(self) -> int:
        """The bits of the counter that frames do not carry; the board announces them."""
        return self.counter >> _EPOCH_BITS & 0xFFFF

    def command(self, payload: WheelCommand) -> tuple[Frame, Frame]:
        """The next command's frames, the left wheel's first; FrameRefusedError for a voltage that is out of range."""
        try:
            left, right = voltage_steps(payload.left_voltage), voltage_steps(payload.right_voltage)
        except ValueError as error:
            raise FrameRefusedError(Refusal.RANGE, "wheel command") from error
        word = self._next_word(_ENABLE if payload.enable else 0)
        return (
            self._sealed(CommandId.LEFT_COMMAND, _SIGNED.pack(left, word)),
            self._sealed(CommandId.RIGHT_COMMAND, _SIGNED.pack(right, word)),
        )

    def setup(self, payload: BoardSetup) -> Frame:
        """The next setup's frame; FrameRefusedError for a time that is out of range."""
        try:
            steps = watchdog_steps(payload.watchdog_s)
        except ValueError as error:
            raise FrameRefusedError(Refusal.RANGE, "session setup") from error
        return self._sealed(CommandId.SESSION_SETUP, _UNSIGNED.pack(steps, self._next_word(0)))

    def _next_word(self, flags: int) -> int:
        self.counter = (self.counter + 1) % _COUNTS
        return self.counter & CARRIED | flags

    def _sealed(self, identifier: CommandId, body: bytes) -> Frame:
        return Frame(identifier, body + _CODE.pack(code_of(self.number, self.counter, identifier, body)))


class CommandReceiver:
    """Checks the commands that arrive over one line, of a session that all lines share.

    Nothing that was received changes the session but a whole command: one frame that passes by chance moves nothing,
    and does not put the counter ahead of the host's.

    Attributes:
        refused: Frames that were refused, by cause.
    """

    def __init__(self, session: CommandSession, window: int = WINDOW) -> None:
        """Take what is at most `window` ahead in `session`."""
        self.refused: Counter[Refusal] = Counter()
        self._session = session
        self._window = window
        self._lefts: dict[int, tuple[int, float]] = {}

    def check(self, frame: Frame) -> WheelCommand | BoardSetup | None:
        """What a frame completes; None for half a command, and for any other frame, counted where it was refused.

        Frames with other identifiers are somebody else's. Those of version 1 are refused.
        """
        identifier = frame.arbitration_id
        if identifier not in _OURS or frame.is_extended or frame.is_remote:
            return None
        taken = Refusal.UNKNOWN if identifier in _VERSION_1 else self._take(identifier, frame.data)
        if isinstance(taken, Refusal):  # returned, not raised: a bus may be full of frames that are to be refused
            self.refused[taken] += 1
            return None
        return taken

    def _take(self, identifier: int, data: bytes) -> WheelCommand | BoardSetup | Refusal | None:
        if len(data) != _LENGTH:
            return Refusal.LENGTH
        session, word = self._session, data[2] | data[3] << 8
        ahead = (word - session.counter) & CARRIED
        if not session.is_begun or not 1 <= ahead <= self._window:
            return Refusal.COUNTER
        counter, body = (session.counter + ahead) % _COUNTS, data[:_BODY]
        if _CODE.unpack_from(data, _BODY)[0] != code_of(session.number, counter, identifier, body):
            return Refusal.CRC
        try:
            if identifier == CommandId.SESSION_SETUP:
                return BoardSetup(watchdog_value(data[0] | data[1] << 8))
            steps: int = _SIGNED.unpack(body)[0]
            voltage = voltage_value(steps)
        except ValueError:
            return Refusal.RANGE
        return self._join(identifier, counter, word, voltage)

    def _join(self, identifier: int, counter: int, word: int, voltage: float) -> WheelCommand | Refusal | None:
        """Keep the left wheel's frame; with the right one's, which agrees with it, make a command of both."""
        lefts = self._lefts
        if identifier == CommandId.LEFT_COMMAND:
            lefts[counter] = (word, voltage)
            if len(lefts) > _LEFTS_KEPT:
                del lefts[next(iter(lefts))]
            return None
        left = lefts.pop(counter, None)
        if left is None or left[0] != word:
            return Refusal.COUNTER
        self._session.counter = counter
        return WheelCommand(left[1], voltage, bool(word & _ENABLE))
