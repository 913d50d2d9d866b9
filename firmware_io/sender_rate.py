# SPDX-License-Identifier: MIT
"""Whether an identifier of one of our devices has a second sender: it arrives more often than the device sends it."""

from typing import Final

from segway_ecc.firmware_io.links.link import Frame

_LEAST_WORTH: Final = 0.95
"""A device's clock may run this much fast, so each of its frames counts for a little less than its period."""
_JITTER_PERIODS: Final = 0.7
_JITTER_NS: Final = 3_000_000
"""Frames may come this many periods, and in any case this long, sooner after one another than they were sent."""
_BEHIND: Final = 10
"""A copy of one of the last two frames, this part of a period behind another, is a repetition on the way."""
_SPARE_NS: Final = 1_000_000_000
"""The longest gap of which the frames may still arrive."""
_FADES_NS: Final = 500_000_000
"""What is left of a gap fades with this time constant, while no more frames come than usual."""


class SenderRate:
    """How far one identifier is ahead of what its device sends.

    Every frame is worth a period, and time takes them away: what is left over beyond a period and some jitter is
    somebody else's. It is counted by exchange and not by receive stamp, so that a loop that stalls finds as many frames
    as time has passed. Frames that are missing are remembered for a while: they may have waited somewhere, and come
    together.

    Attributes:
        period_ns: How often the device sends it, ns.
    """

    def __init__(self, period_ns: int) -> None:
        """Follow an identifier that its device sends every `period_ns`."""
        self.period_ns = period_ns
        self._worth_ns = round(period_ns * _LEAST_WORTH)
        self._jitter_ns = max(round(period_ns * _JITTER_PERIODS), _JITTER_NS)
        self._limit_ns = period_ns + self._jitter_ns
        self._behind_ns = period_ns // _BEHIND
        self._received_ns = 0
        self._newest = self._before = b""
        self.begin()

    def take_frame(self, frame: Frame) -> None:
        """Count a frame, unless it is repeated: a gateway does that, and a CAN controller on an error at its end."""
        data = frame.data
        is_behind = frame.received_ns - self._received_ns < self._behind_ns
        self._received_ns = frame.received_ns
        if is_behind and data in (self._newest, self._before):
            return
        self._before, self._newest = self._newest, data
        self._frames += 1

    def begin(self) -> None:
        """Begin anew: what has come until now is left out."""
        self._frames = self._ahead_ns = self._elapsed_ns = self._spare_ns = 0

    def finds_another(self, elapsed_ns: int) -> bool:
        """Whether more came than one sender sends; `elapsed_ns` have passed since the last call."""
        self._elapsed_ns += elapsed_ns
        ahead_ns = self._ahead_ns - elapsed_ns + self._frames * self._worth_ns
        if not self._frames:
            self._ahead_ns = max(ahead_ns, -_SPARE_NS)
            return False
        self._frames = 0
        too_far_ns = ahead_ns - self._limit_ns
        if too_far_ns > self._spare_ns:
            self.begin()
            return True
        if too_far_ns > 0:
            self._spare_ns -= too_far_ns
            ahead_ns = self._limit_ns
        else:
            self._spare_ns -= self._spare_ns * min(self._elapsed_ns, _FADES_NS) // _FADES_NS
        if ahead_ns < -self._jitter_ns:
            self._spare_ns = min(self._spare_ns - ahead_ns, _SPARE_NS)
        self._ahead_ns, self._elapsed_ns = max(ahead_ns, 0), 0
        return False
