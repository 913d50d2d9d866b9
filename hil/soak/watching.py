# SPDX-License-Identifier: MIT
"""Watches processes while they run, keeps what they take as series, judges whether it grew, and draws it."""

import contextlib
import itertools
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from segway_ecc.hil.figure import svg
from segway_ecc.hil.process_usage import usage
from segway_ecc.node.recording.log_quota import MB, LogQuota

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BAD: Final = "#b3261e"
_GOOD: Final = "#2e6f9e"
_GREY: Final = "#6b6b6b"
_HEIGHT: Final = 1.5
_COLUMNS: Final = 3
WARM_UP: Final = 0.2
"""Share of the time that is not judged: caches fill, and what is used rarely is used for the first time."""
_BINS: Final = 60
_FEWEST: Final = 8
"""Samples, the fewest that are judged."""
ALLOWED_KB: Final = 512.0
"""Growth of a process' memory that is none: allocators take from the kernel up to a megabyte at a time. In half an hour
at 200 Hz a byte and a half per cycle is more than that, in four hours a fifth of a byte."""
LOG: Final = LogQuota(total_bytes=32 * MB, file_bytes=8 * MB)
"""Room for the log of a soak: small, so that files are begun, finished and removed all the time."""
_NONE: Final = 0.5
"""Of what is counted in whole numbers, one more is growth."""


class Series(msgspec.Struct, frozen=True, kw_only=True):
    """A quantity of a process over time.

    Attributes:
        unit: In what; empty for a count.
        allowed: How much it may grow from the end of the warm-up on; None where that is not judged.
        most: What it may never exceed; None for no bound.
        times_s: When it was looked at, s, of the time that the run simulates or takes.
    """

    process: str
    quantity: str
    unit: str = ""
    allowed: float | None
    most: float | None = None
    times_s: list[float] = msgspec.field(default_factory=list)
    values: list[float] = msgspec.field(default_factory=list)


class Counted(NamedTuple):
    """What a process counts of itself and reports, with how much it may grow; None where that is not judged."""

    quantity: str
    allowed: float | None


class Watching:
    """Series of processes and of a log, in the order in which each was seen first.

    The folder is that of the log, and of the messages of those who are watched.
    """

    def __init__(self, folder: Path) -> None:
        """Watch; the log is in `folder`."""
        self.series: list[Series] = []
        self.folder = folder
        self._found: dict[tuple[str, str], Series] = {}

    def look(self, time_s: float, processes: Mapping[str, int]) -> None:
        """Take a sample of each process that runs, by what it is, and of the log."""
        for name, process in processes.items():
            taken = usage(process)
            if taken is None:
                continue
            self._add(name, "memory", time_s, taken.memory_kb, unit="kB", allowed=ALLOWED_KB)
            self._add(name, "proportional set size", time_s, taken.pss_kb, unit="kB", allowed=None)
            self._add(name, "open files", time_s, taken.files)
            self._add(name, "threads", time_s, taken.threads)
        sizes = []
        for path in self.folder.glob("*.mcap"):
            with contextlib.suppress(OSError):  # it was removed just now
                sizes.append(path.stat().st_size)
        room = LOG.total_bytes + LOG.file_bytes
        self._add("log", "room", time_s, sum(sizes) / MB, unit="MB", most=room / MB)
        self._add("log", "files", time_s, len(sizes), most=room // LOG.file_bytes + 1)

    def count(self, time_s: float, process: str, counted: Counted, value: float) -> None:
        """Take what a process counts of itself."""
        self._add(process, counted.quantity, time_s, value, allowed=counted.allowed)

    def _add(  # noqa: PLR0913 - what a series is made of
        self,
        process: str,
        quantity: str,
        time_s: float,
        value: float,
        *,
        unit: str = "",
        allowed: float | None = _NONE,
        most: float | None = None,
    ) -> None:
        key = process, quantity
        if key not in self._found:
            made = Series(process=process, quantity=quantity, unit=unit, allowed=allowed, most=most)
            self._found[key] = made
            self.series.append(made)
        self._found[key].times_s.append(time_s)
        self._found[key].values.append(value)


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a quantity; see `Series`.

    Attributes:
        at_first: Median of the first quarter after the warm-up.
        at_last: Median of the last quarter.
        largest: Largest of all, the warm-up included.
        per_hour: Robust slope after the warm-up.
        growth: What that slope makes of the time judged, or the last quarter less the first: the larger.
        is_growing: Whether it grew by more, or exceeded its bound.
    """

    process: str
    quantity: str
    unit: str
    at_first: float
    at_last: float
    largest: float
    per_hour: float
    growth: float
    allowed: float | None
    most: float | None
    is_growing: bool


def judge(series: Series) -> Verdict:
    """Judge a quantity: the slope after Theil and Sen, which up to 29 % of outliers do not move.

    A slope alone overlooks what grows in one large step, and the two quarters alone what went up and down: the larger
    of the two decides. A bounded quantity, such as the room of a log that is cut off at a size, is held to its bound.

    Raises:
        ValueError: There are too few samples to judge.
    """
    from_s = series.times_s[0] + WARM_UP * (series.times_s[-1] - series.times_s[0]) if series.times_s else 0.0
    kept = [(t, v) for t, v in zip(series.times_s, series.values, strict=True) if t >= from_s]
    times_s, values = [t for t, _ in kept], [v for _, v in kept]
    if len(values) < _FEWEST:
        raise ValueError(f"{len(values)} samples of {series.quantity} of {series.process} are too few to judge")
    quarter = len(values) // 4
    at_first, at_last = statistics.median(values[:quarter]), statistics.median(values[-quarter:])
    size = -(-len(values) // _BINS)  # medians of neighbours: all pairs of thousands of samples are too many
    starts = range(0, len(values), size)
    binned = ([statistics.median(column[at : at + size]) for at in starts] for column in (times_s, values))
    slope = theil_sen(*binned)
    growth = max(slope * (times_s[-1] - times_s[0]), at_last - at_first)
    largest = max(series.values)
    if series.most is None:
        is_growing = series.allowed is not None and growth > series.allowed
    else:
        is_growing = largest > series.most
    return Verdict(
        process=series.process,
        quantity=series.quantity,
        unit=series.unit,
        at_first=at_first,
        at_last=at_last,
        largest=largest,
        per_hour=slope * 3600.0,
        growth=growth,
        allowed=series.allowed,
        most=series.most,
        is_growing=is_growing,
    )


def theil_sen(times: Sequence[float], values: Sequence[float]) -> float:
    """The median of the slopes between all pairs (Theil 1950, Sen 1968); 0 where there are none."""
    pairs = itertools.combinations(zip(times, values, strict=True), 2)
    slopes = [(later - value) / (then - at) for (at, value), (then, later) in pairs if then > at]
    return statistics.median(slopes) if slopes else 0.0


def figure(series: Sequence[Series]) -> bytes:
    """Draw every series in a panel of its own, as SVG; what grew is red."""
    rows = -(-len(series) // _COLUMNS)

    def draw(figure: "Figure") -> None:
        panels = figure.subplots(rows, _COLUMNS, squeeze=False)
        for panel in panels.flat[len(series) :]:
            panel.set_visible(False)
        for panel, one in zip(panels.flat, series, strict=False):
            minutes = [time_s / 60.0 for time_s in one.times_s]
            panel.plot(minutes, one.values, color=_BAD if judge(one).is_growing else _GOOD, linewidth=1)
            panel.axvspan(minutes[0], minutes[0] + WARM_UP * (minutes[-1] - minutes[0]), color="#eeeeee", linewidth=0)
            if one.most is not None:
                panel.axhline(one.most, color=_GREY, linestyle="--", linewidth=1)
            panel.set_title(f"{one.process}: {one.quantity}{f', {one.unit}' if one.unit else ''}", fontsize=9)
            panel.tick_params(labelsize=8)
            panel.margins(y=0.2)
            panel.ticklabel_format(axis="y", useOffset=False)
        figure.supxlabel("time, min; grey: the warm-up, which is not judged")

    return svg("soak", (12.0, 0.6 + _HEIGHT * rows), draw)
