# SPDX-License-Identifier: MIT
"""Frames of others under our identifiers: another controller, a recording that is played, a device of the same id."""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from typing import Final

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.links.link import Frame, NowNs

RECENT_NS: Final = 1_000_000_000
"""For so long after the last of them the robot may not arm."""
_NAMED: Final = 4
_CLOSING: Final = "another controller commands this robot's drives, or a recording is played; find it and stop it"
_ALSO_SENT: Final = (
    "somebody else sends it too, such as a recording, a simulator, or a device of the same id: find it and stop it; "
    "a device that is set to send more often needs that in the robot file"
)


class Strangers:
    """Counts such frames since the start, and names them.

    Attributes:
        total: Commands to our drives.
        doubled: Times that an identifier brought more telemetry than its device sends.
    """

    def __init__(self, ours: Collection[FrameKey], now_ns: NowNs) -> None:
        """Know the frames that only we may send."""
        self.total = self.doubled = 0
        self._ours = frozenset(ours)
        self._now_ns = now_ns
        self._new: Counter[FrameKey] = Counter()
        self._new_doubled: dict[FrameKey, int] = {}
        self._newest_ns: int | None = None
        self._doubled_ns: int | None = None
        self._recent_doubled: dict[FrameKey, int] = {}

    def take_frame(self, frame: Frame) -> None:
        """Take a frame that none of our devices listens to."""
        key = FrameKey(frame.arbitration_id, frame.is_extended)
        if key in self._ours:
            self._new[key] += 1
            self.total += 1
            self._newest_ns = self._now_ns()

    def note_another_sender(self, key: FrameKey, period_ns: int) -> None:
        """Note that a device's identifier came more often than every `period_ns`, as the device sends it."""
        self.doubled += 1
        if not self._is_recent(self._doubled_ns):
            self._recent_doubled.clear()
        self._new_doubled[key] = self._recent_doubled[key] = period_ns
        self._doubled_ns = self._now_ns()

    def report(self) -> str:
        """Name those that came since the last report; empty where none did."""
        found = []
        if self._new:
            named = [f"0x{key.arbitration_id:X} ({count})" for key, count in sorted(self._new.items())[:_NAMED]]
            self._new.clear()
            found.append(f"command frames that this node did not send, {', '.join(named)}: {_CLOSING}")
        if self._new_doubled:
            found.append(_description(self._new_doubled))
            self._new_doubled.clear()
        return "; ".join(found)

    @property
    def is_recent(self) -> bool:
        """Whether one came within the last second."""
        return self._is_recent(self._newest_ns) or self._is_recent(self._doubled_ns)

    def arming_failures(self) -> Iterator[str]:
        """Who must stop before the robot may be armed; empty where none came within the last second."""
        if self._is_recent(self._newest_ns):
            yield "another controller commanded this robot's drives within the last second; find it and stop it"
        if self._is_recent(self._doubled_ns):
            yield f"within the last second, {_description(self._recent_doubled)}"

    def _is_recent(self, at_ns: int | None) -> bool:
        return at_ns is not None and self._now_ns() - at_ns < RECENT_NS


def _description(doubled: Mapping[FrameKey, int]) -> str:
    """Names identifiers that brought too much, with the periods of their devices, ns."""
    named = [f"0x{key.arbitration_id:X} (every {ns * 1e-6:g} ms)" for key, ns in sorted(doubled.items())[:_NAMED]]
    return f"more telemetry than the device sends, {', '.join(named)}: {_ALSO_SENT}"
