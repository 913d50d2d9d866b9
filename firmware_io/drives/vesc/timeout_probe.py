# SPDX-License-Identifier: MIT
"""Does a controller's time-out act? Measured while the motors are off, without moving anything.

The time-out cannot be read, but a controller reports, when asked, whether it acts. So commands stop for as long as the
time-out was set to, and a little more, and the controller is asked. While it is, its motor is free, or held by the
brake current that was set for the time-out; zero was commanded before. Questions do not count as commands.
"""

import enum
from typing import Final

_MARGIN_NS: Final = 25_000_000
"""The firmware looks at its time-out every 10 ms; and the last command took a while to arrive."""
_ASK_FOR_NS: Final = 50_000_000
_TRIES: Final = 3
_AGAIN_NS: Final = 1_000_000_000


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
    """Stops the commands for a moment, asks, and judges the answers.

    Attributes:
        found: What is known.
        silence_s: How long commands had stopped when the time-out was seen to act, or last seen not to, s.
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
