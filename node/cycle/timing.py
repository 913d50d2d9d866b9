# SPDX-License-Identifier: MIT
"""When cycles are, and how long things take in bounded memory: histograms with logarithmic buckets."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.firmware_io.clock import NS_PER_S

_SUB_BITS: Final = 5
_SUB_BUCKETS: Final = 1 << _SUB_BITS
_MAX_BITS: Final = 40
_BUCKETS: Final = (_MAX_BITS - _SUB_BITS + 1) * _SUB_BUCKETS
_COUNTED_AT_ONCE: Final = 32
_FRACTIONS: Final[Sequence[float]] = (0.5, 0.99, 0.999)


@dataclass(frozen=True, slots=True)
class Summary:
    """What a histogram holds, in seconds; percentiles are upper bounds, at most 1/32 too high."""

    count: int
    mean_s: float
    p50_s: float
    p99_s: float
    p999_s: float
    max_s: float

    def as_text(self) -> str:
        """One line in microseconds."""
        return (
            f"p50 {self.p50_s * 1e6:.1f} us, p99 {self.p99_s * 1e6:.1f} us, "
            f"p99.9 {self.p999_s * 1e6:.1f} us, max {self.max_s * 1e6:.1f} us"
        )


@dataclass(slots=True)
class LoopCounters:
    """How the deadlines were met.

    Every deadline since the first is either a cycle or skipped: `cycles + skipped` deadlines have passed.

    Attributes:
        cycles: Cycles run.
        late: Cycles that started more than a tenth of a period after their deadline.
        overrun: Cycles that ended after the next deadline.
        skipped: Deadlines that passed without a cycle, because one before them took too long.
        started_ns: When the first cycle started, monotonic.
        last_ns: When the newest cycle started, monotonic.
    """

    cycles: int = 0
    late: int = 0
    overrun: int = 0
    skipped: int = 0
    started_ns: int = 0
    last_ns: int = 0

    @property
    def mean_rate_hz(self) -> float:
        """Cycles per second from the first start to the newest; zero before the second cycle."""
        elapsed_ns = self.last_ns - self.started_ns
        return (self.cycles - 1) * NS_PER_S / elapsed_ns if elapsed_ns else 0.0


class Histogram:
    """Durations from 0 to about 1000 s in 1152 buckets, each at most 1/32 wide; adding one allocates nothing."""

    __slots__ = ("_counts", "_max_ns", "_sum_ns", "_total")

    def __init__(self) -> None:
        self._counts = [0] * _BUCKETS
        self._total = 0
        self._sum_ns = 0
        self._max_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration; a negative one counts as zero."""
        if duration_ns < 0:  # noqa: PLR1730 - done eight times a cycle, and a call of max() takes longer
            duration_ns = 0
        shift = duration_ns.bit_length() - _SUB_BITS - 1
        index = (shift << _SUB_BITS) + (duration_ns >> shift) if shift > 0 else duration_ns
        self._counts[index if index < _BUCKETS else _BUCKETS - 1] += 1
        self._total += 1
        self._sum_ns += duration_ns
        if duration_ns > self._max_ns:  # noqa: PLR1730 - as above
            self._max_ns = duration_ns

    def percentile_s(self, fraction: float) -> float:
        """The duration that this fraction (0 to 1) of all does not exceed, s; zero when empty."""
        rank = fraction * self._total
        seen = 0
        for index, count in enumerate(self._counts):
            seen += count
            if count and seen >= rank:
                shift = max((index >> _SUB_BITS) - 1, 0)  # below 64 ns a bucket is a nanosecond wide
                upper_ns = ((index - (shift << _SUB_BITS) + 1) << shift) - 1
                return min(upper_ns, self._max_ns) * 1e-9
        return 0.0

    def summary(self) -> Summary:
        """Everything that is reported of it."""
        mean_ns = self._sum_ns / self._total if self._total else 0.0
        p50, p99, p999 = (self.percentile_s(fraction) for fraction in _FRACTIONS)
        return Summary(self._total, mean_ns * 1e-9, p50, p99, p999, self._max_ns * 1e-9)


class Tally:
    """Histograms of durations that come together, one for each, as those of the phases of a cycle do.

    They are counted some cycles at a time: where a loop sleeps between its cycles, no cache holds a histogram any more.
    """

    __slots__ = ("_counted", "_noted")

    def __init__(self, names: Sequence[str]) -> None:
        self._counted = {name: Histogram() for name in names}
        self._noted: list[Sequence[int]] = []

    def note(self, durations_ns: Sequence[int]) -> None:
        """Take a duration for each name, in their order."""
        self._noted.append(durations_ns)
        if len(self._noted) >= _COUNTED_AT_ONCE:
            self._count()

    @property
    def histograms(self) -> dict[str, Histogram]:
        """By name, with all that was noted."""
        self._count()
        return self._counted

    def _count(self) -> None:
        histograms = tuple(self._counted.values())
        for durations_ns in self._noted:
            for histogram, duration_ns in zip(histograms, durations_ns, strict=True):
                histogram.add(duration_ns)
        self._noted.clear()


class TimeBase:
    """The line through the stamps of the cycles: `stamp_ns(k) = anchor_ns + k * period_ns`.

    Attributes:
        realigned: How often the line was moved to follow the wall clock.
    """

    def __init__(self, period_ns: int) -> None:
        """Prepare the line; `anchor` places it."""
        self.period_ns = period_ns
        self.realigned = 0
        self._anchor_ns = 0

    def anchor(self, cycle: int, stamp_ns: int) -> None:
        """Place the line so that a cycle has this stamp."""
        self._anchor_ns = stamp_ns - cycle * self.period_ns

    def stamp_ns(self, cycle: int) -> int:
        """The stamp of a cycle, ns since the Unix epoch."""
        return self._anchor_ns + cycle * self.period_ns

    def cycle_of(self, stamp_ns: int) -> int:
        """The cycle whose stamp is nearest."""
        return (stamp_ns - self._anchor_ns + self.period_ns // 2) // self.period_ns

    def follow(self, cycle: int, deadline_wall_ns: int) -> None:
        """Move the line where this cycle's deadline is more than half a period off it.

        To be called only while no manoeuvre is being played.
        """
        off_ns = deadline_wall_ns - self.stamp_ns(cycle)
        if 2 * abs(off_ns) > self.period_ns:
            self._anchor_ns += off_ns
            self.realigned += 1
