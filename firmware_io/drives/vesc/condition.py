# SPDX-License-Identifier: MIT
"""What a controller reports only when asked: its fault, and whether its time-out has acted.

Both are values of the serial protocol, asked for one at a time so that question and answer each fit one CAN frame; see
`packets`. A serial line gives the same frames.
"""

import enum
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.vesc.frames import TIMED_OUT, ask_selective, decode_values, mask_of
from segway_ecc.firmware_io.drives.vesc.packets import Mode, ShortBuffer, frames_of
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

FAULT: Final = mask_of(("fault",))
FLAGS: Final = mask_of(("flags",))

_FAULT_NAMES: Final = {
    1: "over-voltage",
    2: "under-voltage",
    3: "gate driver",
    4: "over-current",
    5: "over-temperature of the power stage",
    6: "over-temperature of the motor",
    7: "gate driver over-voltage",
    8: "gate driver under-voltage",
    9: "under-voltage of the processor",
    10: "restarted by its own watchdog",
    11: "encoder",
    18: "unbalanced currents",
    25: "encoder without magnet",
}
"""The codes of VESC's firmware (mc_fault_code in its datatypes.h) that a robot is likely to meet."""

_MARGIN_NS: Final = 25_000_000
"""The firmware looks at its time-out every 10 ms; and the last command took a while to arrive."""
_ASK_FOR_NS: Final = 50_000_000
_TRIES: Final = 3
_AGAIN_NS: Final = 1_000_000_000


class Answer(NamedTuple):
    """What a controller answered: one of the two, or neither where its firmware does not know what was asked."""

    fault: int | None = None
    timed_out: bool | None = None


def fault_name(code: int) -> str:
    """What a fault code means."""
    return f"{_FAULT_NAMES[code]} (fault {code})" if code in _FAULT_NAMES else f"fault {code}"


def ask(host_id: int, controller_id: int, mask: int) -> Frame:
    """The frame by which `host_id`, this computer, asks a controller for FAULT or FLAGS."""
    return frames_of(controller_id, host_id, Mode.PROCESS, ask_selective(mask))[0]


def answer(buffer: ShortBuffer, controller_id: int) -> Answer:
    """What a controller's short packet answers; FrameRefusedError for no answer of that controller to `ask`."""
    if buffer.sender_id != controller_id or buffer.mode is not Mode.PASS_ON:
        raise FrameRefusedError(Refusal.UNKNOWN, f"packet from {buffer.sender_id}")
    mask, values = decode_values(buffer.packet)
    if mask not in (FAULT, FLAGS):
        raise FrameRefusedError(Refusal.UNKNOWN, f"answer to 0x{mask:08X}")
    if "fault" in values:
        return Answer(fault=int(values["fault"]))
    return Answer(timed_out=bool(int(values["flags"]) & TIMED_OUT)) if "flags" in values else Answer()


@enum.unique
class Found(enum.StrEnum):
    """What is known of the time-out."""

    NOTHING = "not measured yet"
    ACTS = "measured"
    DOES_NOT_ACT = "does not act"
    NOT_REPORTED = "affirmed in the robot file, not measured: the controller does not report it"


@enum.unique
class Step(enum.Enum):
    """What to send in this cycle."""

    ZERO = enum.auto()
    NOTHING = enum.auto()
    ASK = enum.auto()


class TimeoutProbe:
    """Measures whether a controller's time-out acts, while the motors are off and without moving anything.

    The time-out cannot be read, but a controller reports, when asked, whether it acts. So commands stop for as long as
    the time-out was set to, and a little more, and the controller is asked. While it is, its motor is free, or held by
    the brake current that was set for the time-out; zero was commanded before. Questions do not count as commands.
    `silence_s` is how long, s, they had stopped when the time-out was seen to act, or last seen not to.
    """

    __slots__ = ("_answered", "_quiet_ns", "_tries", "_wait_until_ns", "_zero_ns", "found", "silence_s")

    def __init__(self, timeout_s: float) -> None:
        """Measure a time-out that was set to `timeout_s`."""
        self._quiet_ns = round(timeout_s * 1e9) + _MARGIN_NS
        self.reset()

    def reset(self) -> None:
        """Begin anew: the controller may be another one."""
        self.found = Found.NOTHING
        self.silence_s = 0.0
        self._tries = 0
        self._wait_until_ns = 0
        self.break_off()

    def break_off(self) -> None:
        """Commands go out again: a measurement under way means nothing."""
        self._zero_ns: int | None = None
        self._answered = False

    def step(self, now_ns: int) -> Step:
        """What to send while the motors are off."""
        if self.found in (Found.ACTS, Found.NOT_REPORTED) or now_ns < self._wait_until_ns:
            return Step.ZERO
        if self._zero_ns is None:
            self._zero_ns = now_ns
            return Step.ZERO
        silence_ns = now_ns - self._zero_ns
        if silence_ns < self._quiet_ns:
            return Step.NOTHING
        if silence_ns < self._quiet_ns + _ASK_FOR_NS:
            return Step.ASK
        # No answer showed that the time-out acts.
        self._tries += 1
        if self._answered:
            self.found = Found.DOES_NOT_ACT
            self._wait_until_ns = now_ns + _AGAIN_NS
        elif self._tries >= _TRIES:
            self.found = Found.NOT_REPORTED
        self.break_off()
        return Step.ZERO

    def note_answer(self, timed_out: bool | None, received_ns: int) -> None:  # noqa: FBT001 - a value, not an option
        """Take an answer; None where the controller does not know the question."""
        if self._zero_ns is None or received_ns - self._zero_ns < self._quiet_ns:
            return
        if timed_out is not None:
            self._answered = True
            self.silence_s = (received_ns - self._zero_ns) * 1e-9
        if timed_out:
            self.found = Found.ACTS
            self.break_off()
