# SPDX-License-Identifier: MIT
"""Proof, by what it does, that an axis' own watchdog is on and short enough.

CANSimple of firmware 0.5 cannot read the watchdog's configuration. But the watchdog is checked in every state: an idle
axis that receives nothing raises its error. So the error of an axis that reports it is cleared, and then it is left in
silence: a heartbeat without the error shows that the command has arrived, however long that took, and the next one with
it that the watchdog has expired since. The time from the order to that heartbeat is an upper bound of the time-out.
"""

from typing import Final

from segway_ecc.firmware_io.drives.odrive.limits import CLEAR_EVERY_NS

_NEVER: Final = -(1 << 62)


class WatchdogProof:
    """Follows what was sent to one axis, and its heartbeats.

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
        return not self.is_proven and self.is_expired and now_ns - self._cleared_ns >= CLEAR_EVERY_NS
