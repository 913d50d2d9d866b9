# SPDX-License-Identifier: MIT
"""Rates of a link from its counts."""

from collections.abc import Callable, Mapping
from typing import Final

from segway_ecc.firmware_io.links.link import LinkCounters

NowNs = Callable[[], int]

_NS_PER_S: Final = 1e9


class Meter:
    """Measures how fast a link's counts grow."""

    def __init__(self, counters: LinkCounters, now_ns: NowNs) -> None:
        """Begin now, from the counts as they are."""
        self._counters = counters
        self._now_ns = now_ns
        self._looked_ns = now_ns()
        self._counts = self._read()
        self._per_s = (0.0,) * len(self._counts)

    def measure(self, bitrate: int) -> Mapping[str, str]:
        """The rates since the last call, as text; those of the last call where no time has passed since.

        Args:
            bitrate: Of the bus, bit/s, for the share of it that was in use.
        """
        now_ns, counts = self._now_ns(), self._read()
        elapsed_s = (now_ns - self._looked_ns) / _NS_PER_S
        if elapsed_s > 0.0:
            self._per_s = tuple((new - old) / elapsed_s for new, old in zip(counts, self._counts, strict=True))
            self._looked_ns, self._counts = now_ns, counts
        sent, received, errors, bits = self._per_s
        return {
            "sent_per_s": f"{sent:.1f}",
            "received_per_s": f"{received:.1f}",
            "errors_per_s": f"{errors:.1f}",
            "load_percent": f"{100.0 * bits / bitrate:.1f}",
        }

    def _read(self) -> tuple[int, ...]:
        counters = self._counters
        return counters.sent, counters.received, counters.error_frames, counters.bits
