# SPDX-License-Identifier: MIT
"""Whether a quantity grew while it was watched."""

import statistics
from collections.abc import Sequence
from typing import Final

import msgspec

WARM_UP: Final = 0.2
"""Share of the time that is not judged: caches fill, and what is used rarely is used for the first time."""
_BINS: Final = 60
_FEWEST: Final = 8
"""Samples, the fewest that are judged."""


class Series(msgspec.Struct, frozen=True, kw_only=True):
    """A quantity of a process over time.

    Attributes:
        process: Whose.
        quantity: What.
        unit: In what; empty for a count.
        allowed: How much it may grow from the end of the warm-up on; None where that is not judged.
        most: What it may never exceed; None for no bound.
        times_s: When it was looked at, s, of the time that the run simulates or takes.
        values: What it was.
    """

    process: str
    quantity: str
    unit: str = ""
    allowed: float | None
    most: float | None = None
    times_s: list[float] = msgspec.field(default_factory=list)
    values: list[float] = msgspec.field(default_factory=list)


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a quantity.

    Attributes:
        process: Whose.
        quantity: What.
        unit: In what.
        at_first: Median of the first quarter after the warm-up.
        at_last: Median of the last quarter.
        largest: Largest of all, the warm-up included.
        per_hour: Robust slope after the warm-up.
        growth: What that slope makes of the time judged, or the last quarter less the first: the larger.
        allowed: How much it may grow; None where that is not judged.
        most: What it may never exceed; None for no bound.
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
    from_s = 0.0
    if series.times_s:
        from_s = series.times_s[0] + WARM_UP * (series.times_s[-1] - series.times_s[0])
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
    slopes = [
        (values[j] - values[i]) / (times[j] - times[i])
        for i in range(len(times))
        for j in range(i + 1, len(times))
        if times[j] > times[i]
    ]
    return statistics.median(slopes) if slopes else 0.0
