# SPDX-License-Identifier: MIT
"""Which firmware a drive has: as configured in the robot file, or as the drive answers."""

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.limits import ANSWERS_WITHIN_NS, ASK_EVERY_NS
from segway_ecc.firmware_io.drives.odrive.telemetry import Version

_FIRST_THAT_ANSWERS = (0, 6)


class FirmwareSearch:
    """Finds out the firmware of one drive.

    0.6 answers a request for its version, 0.5 never does: one that is silent but sends heartbeats is 0.5. The first
    answer decides, however late: what was taken for 0.5 because answers were lost is then known for what it is.

    Attributes:
        found: The firmware; None while it is not known.
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
        if self.found is not None or (self._first_asked_ns is not None and now_ns - self._asked_ns < ASK_EVERY_NS):
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
        if self.found is None and asked_ns is not None and received_ns - asked_ns >= ANSWERS_WITHIN_NS:
            self.found = Firmware.V0_5

    @property
    def mismatch(self) -> str | None:
        """What speaks against the firmware that the robot file names; None where nothing does."""
        if self._configured is Firmware.V0_5 and self._answered is not None:
            return f"answers that its firmware is {self._answered}; set firmware to '0.6' or 'auto'"
        return None

    def __str__(self) -> str:
        return str(self._answered or self.found or "unknown")
