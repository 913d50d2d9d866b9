# SPDX-License-Identifier: MIT
"""What is found out about an axis: its firmware, as configured or as the drive answers, and that its watchdog acts."""

from typing import Final

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.messages import Version

_FIRST_THAT_ANSWERS: Final = (0, 6)
_ASK_EVERY_NS: Final = 100_000_000
"""How often the firmware is asked for its version while that is not known."""
_ANSWERS_WITHIN_NS: Final = 350_000_000
"""A drive that was asked for its version this long, and sends heartbeats, is one that cannot answer: firmware 0.5."""
_CLEAR_EVERY_NS: Final = 300_000_000
"""Shortest time between two attempts to see the watchdog expire; longer than any that may be set."""
_NEVER: Final = -(1 << 62)


class FirmwareSearch:
    """Finds out the firmware of one drive.

    0.6 answers a request for its version, 0.5 never does: one that is silent but sends heartbeats is 0.5. The first
    answer decides, however late: what was taken for 0.5 because answers were lost is then known for what it is.
    `found` is None while it is not known.
    """

    def __init__(self, configured: str) -> None:
        """Take the configured value: a firmware, or `auto`."""
        self.found = None if configured == "auto" else Firmware(configured)
        self._configured = self.found
        self._answered: str | None = None
        self._first_asked_ns: int | None = None
        self._asked_ns = 0
        self._beats = 0

    def should_ask(self, now_ns: int) -> bool:
        """Whether to send the request for the version now; it then counts as sent."""
        if self.found is not None or (self._first_asked_ns is not None and now_ns - self._asked_ns < _ASK_EVERY_NS):
            return False
        self._asked_ns = now_ns
        if self._first_asked_ns is None or not self._beats:
            # A drive that is not there cannot answer: its time begins with its first heartbeat.
            self._first_asked_ns = now_ns
        return True

    def answer(self, version: Version) -> None:
        """Take the drive's version."""
        number = (version.firmware_major, version.firmware_minor)
        self._answered = f"{number[0]}.{number[1]}.{version.firmware_revision}"
        if self._configured is None:
            self.found = Firmware.V0_6 if number >= _FIRST_THAT_ANSWERS else Firmware.V0_5

    def beat(self, received_ns: int) -> None:
        """A heartbeat arrived."""
        self._beats += 1
        asked_ns = self._first_asked_ns
        if self.found is None and asked_ns is not None and received_ns - asked_ns >= _ANSWERS_WITHIN_NS:
            self.found = Firmware.V0_5

    @property
    def mismatch(self) -> str | None:
        """What speaks against the firmware that the robot file names; None where nothing does."""
        if self._configured is Firmware.V0_5 and self._answered is not None:
            return f"answers that its firmware is {self._answered}; set firmware to '0.6' or 'auto'"
        return None

    def __str__(self) -> str:
        return str(self._answered or self.found or "unknown")


class WatchdogProof:
    """Proof, by what it does, that an axis' own watchdog is on and short enough.

    CANSimple of firmware 0.5 cannot read the watchdog's configuration. But the watchdog is checked in every state: an
    idle axis that receives nothing raises its error. So the error of an axis that reports it is cleared, and then it is
    left in silence: a heartbeat without the error shows that the command has arrived, however long that took, and the
    next one with it that the watchdog has expired since. The time between is an upper bound of the time-out.

    Attributes:
        took_ns: From the command to clear the error to the error; None until it was seen.
        within_ns: The longest that it may take.
        is_expired: Whether the newest heartbeat carried the error.
    """

    def __init__(self, within_ns: int) -> None:
        """Take a watchdog for proved that took no longer than `within_ns`."""
        self.took_ns: int | None = None
        self.within_ns = within_ns
        self._begun_ns: int | None = None
        self._cleared_ns = _NEVER
        self._was_clean = False
        self.is_expired = False

    @property
    def is_proven(self) -> bool:
        """Whether the watchdog was seen to expire in time."""
        return self.took_ns is not None and self.took_ns <= self.within_ns

    def feed(self) -> None:
        """A frame was sent to the axis; in firmware 0.5 any feeds the watchdog, which ends an attempt."""
        self._begun_ns = None
        self._was_clean = False

    def clear(self, now_ns: int) -> None:
        """The axis was fed and its error cleared, which begins an attempt."""
        self._cleared_ns = now_ns
        # Heartbeats on their way now all carry the error; without it they can only have been sent after the clearing.
        self._begun_ns = now_ns if self.is_expired else None

    def note_heartbeat(self, received_ns: int, *, expired: bool) -> None:
        """A heartbeat arrived, with or without the watchdog's error."""
        self.is_expired = expired
        if self._begun_ns is None:
            return
        if not expired:
            self._was_clean = True
        elif self._was_clean:
            if not self.is_proven:
                self.took_ns = received_ns - self._begun_ns
            self._begun_ns = None

    def reset(self) -> None:
        """The drive may have been restarted: what was seen means nothing any more."""
        self.took_ns = None
        self._begun_ns = None
        self._was_clean = False

    def needs_clearing(self, now_ns: int) -> bool:
        """Whether another attempt is due: the error stands, so that it cannot be seen to begin.

        One that took too long is tried again: a lost heartbeat may have been the reason.
        """
        return not self.is_proven and self.is_expired and now_ns - self._cleared_ns >= _CLEAR_EVERY_NS
