# SPDX-License-Identifier: MIT
"""Which firmware a drive has: asked for, and believed once the drive has answered the same twice.

Get_Version has neither counter nor checksum, so one frame of a stranger that happens to bear its identifier reads as
an answer. Two that are equal in all eight bytes do not come by chance.
"""

from typing import Final

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.messages import Version

_FIRST_THAT_ANSWERS: Final = (0, 6)
_ASK_EVERY_NS: Final = 100_000_000
"""How often the firmware is asked for its version while that is not known."""
_CONFIRM_EVERY_NS: Final = 10_000_000
"""How often it is asked again once it has answered."""
_ANSWERS_WITHIN_NS: Final = 350_000_000
"""A drive that was asked for its version this long, and sends heartbeats, is one that cannot answer: firmware 0.5."""
_DOUBT_EVERY_NS: Final = 1_000_000_000
_DOUBT_FOR_NS: Final = 100_000_000
"""A drive whose firmware is known is asked about another answer for so long, no more often than every second: each
question feeds the watchdog of 0.5, which has to prove itself by silence."""


class FirmwareSearch:
    """Finds out the firmware of one drive.

    0.6 answers a request for its version, 0.5 never does: one that is silent but sends heartbeats is 0.5. The answer
    that came twice decides, however late: what was taken for 0.5 because answers were lost is then known for what it
    is.

    Attributes:
        found: The firmware; None while it is not known.
        version: What the drive answered twice; None where it did not.
        unconfirmed: Answers that were discarded, since the next one was another.
    """

    def __init__(self, configured: str, *, needs_release: bool = False) -> None:
        """Take the configured value: a firmware, or `auto`.

        `needs_release` has a drive of 0.6 asked for its release even where its firmware is known.
        """
        self._needs_release = needs_release
        self.found = None if configured == "auto" else Firmware(configured)
        self.unconfirmed = 0
        self._configured = self.found
        self.version: Version | None = None
        self._heard: Version | None = None
        """The newest answer where it differs from the one that is believed."""
        self._first_asked_ns: int | None = None
        self._asked_ns = 0
        self._doubted_ns: int | None = None
        self._beats = 0

    def should_ask(self, now_ns: int) -> bool:
        """Whether to send the request for the version now; it then counts as sent."""
        if self.found is not None and not (self._is_release_wanted or self._is_doubted(now_ns)):
            return False
        period_ns = _ASK_EVERY_NS if self._heard is None else _CONFIRM_EVERY_NS
        if self._first_asked_ns is not None and now_ns - self._asked_ns < period_ns:
            return False
        self._asked_ns = now_ns
        if self._first_asked_ns is None or not self._beats:
            # A drive that is not there cannot answer: its time begins with its first heartbeat.
            self._first_asked_ns = now_ns
        return True

    def answer(self, version: Version) -> None:
        """Take an answer: one as before is believed, another one makes the drive be asked again."""
        if version not in (self.version, self._heard):
            self.unconfirmed += self._heard is not None
            self._heard = version
            return
        self.unconfirmed += self._heard not in (None, version)
        self._heard = None
        if version == self.version:
            return
        self.version = version
        if self._configured is None:
            number = (version.firmware_major, version.firmware_minor)
            self.found = Firmware.V0_6 if number >= _FIRST_THAT_ANSWERS else Firmware.V0_5

    def beat(self, received_ns: int) -> None:
        """A heartbeat arrived."""
        self._beats += 1
        asked_ns = self._first_asked_ns
        if self.found is None and asked_ns is not None and received_ns - asked_ns >= _ANSWERS_WITHIN_NS:
            self.found = Firmware.V0_5
            self.unconfirmed += self._heard is not None
            self._heard = None

    def forget_release(self) -> None:
        """The drive may be another one: where its release matters it is asked again."""
        if self._needs_release:
            self.version = self._heard = None

    @property
    def mismatch(self) -> str | None:
        """What speaks against the firmware that the robot file names; None where nothing does."""
        if self._configured is Firmware.V0_5 and self.version is not None:
            return f"answers that its firmware is {self}; set firmware to '0.6' or 'auto'"
        return None

    def __str__(self) -> str:
        version = self.version
        if version is None:
            return str(self.found or "unknown")
        return f"{version.firmware_major}.{version.firmware_minor}.{version.firmware_revision}"

    @property
    def _is_release_wanted(self) -> bool:
        return self._needs_release and self.found is Firmware.V0_6 and self.version is None

    def _is_doubted(self, now_ns: int) -> bool:
        """Whether to ask about an answer that differs from what is known; one that nothing confirms is discarded."""
        if self._heard is None:
            return False
        if self._doubted_ns is None or now_ns - self._doubted_ns >= _DOUBT_EVERY_NS:
            self._doubted_ns = now_ns
        elif now_ns - self._doubted_ns > _DOUBT_FOR_NS:
            self.unconfirmed += 1
            self._heard = None
            return False
        return True
