# SPDX-License-Identifier: MIT
"""Drawings of signals over time: a panel for those of one unit that can be read on one axis, one below the other."""

import math
import textwrap
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from segway_ecc.node.errors import ConfigurationError, printable
from segway_ecc.node.readable import scaled_unit, short, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_Array = npt.NDArray[np.float64]
_MOST_CURVES: Final = 6
"""In one panel: more are not told apart."""
_MOST_LARGER: Final = 10.0
"""So many times as much as a signal moves may its panel show; in more it would look still."""
_STILL: Final = 1e-12
"""What moves by less than this part of the largest value of its unit, or of 1, is rounding: it does not move."""
_NARROW: Final = 0.02
"""Where all that is seen is a smaller part of the values, the axis shows how far they are from the first."""
_LINES: Final = 4
"""Of text above the panels."""
_WIDTH_IN: Final = 10.0
_LETTERS: Final = 170
"""That fit in its width."""
_ENTRY_IN: Final = 0.17
"""Height of a line of text, or of an entry of a legend."""
_LEAST_PANEL_IN: Final = 1.4
_LEAST_IN: Final = 4.0
"""Height of all panels together, where they are few."""
_LONGEST_NAME: Final = 32
_LONGEST_UNIT: Final = 18
_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73", "#aa3377", "#b8860b", "#333333")
_STYLES: Final = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (1, 3)))
"""One over the other, so that of curves that are the same each is seen."""
_TIMES: Final = ((4.0 * 3600.0, 1.0 / 3600.0, "h"), (1200.0, 1.0 / 60.0, "min"), (0.1, 1.0, "s"), (1e-4, 1e3, "ms"))
"""From how long on, s, times are shown in which unit, with its factor."""


class Signal(NamedTuple):
    """A signal to be drawn: its name, its unit ("1" for none), and its values, in one curve for each layer."""

    name: str
    unit: str
    layers: Sequence[Sequence[float]]


@dataclass(frozen=True, slots=True)
class Panel:
    """Signals on one axis: what they are, with the least and the largest of their values."""

    signals: tuple[Signal, ...]
    low: float
    high: float


class _Scale(NamedTuple):
    """How values are shown: what is taken from them, by what the rest is multiplied, and what the axis is called."""

    base: float
    factor: float
    label: str

    def shown(self, values: Sequence[float] | _Array) -> _Array:
        """The values as they are drawn; nothing is drawn of those that are not finite."""
        array = np.asarray(values, dtype=np.float64)
        return np.where(np.isfinite(array), (array - self.base) * self.factor, np.nan)


def draw_panels(path: Path, times: Sequence[float], signals: Sequence[Signal], layers: Sequence[str] = ("",)) -> None:
    """Draw signals over time, s; `layers` name the curves of each. The file's name ends in its format.

    Raises:
        ConfigurationError: There is nothing to draw, or the file cannot be written.
    """
    figure = drawing(times, signals, layers)
    if figure is None:
        raise ConfigurationError(f"cannot draw {path}: there is no signal with a value")
    try:
        with path.open("wb") as file:  # by its name alone it would get an ending
            figure.savefig(file, format=path.suffix[1:].lower() or None)
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"cannot draw {path}: {error}") from error


def drawing(times: Sequence[float], signals: Sequence[Signal], layers: Sequence[str] = ("",)) -> "Figure | None":
    """The same as a figure; None where there is nothing to draw."""
    panels, words = arranged(signals, max(_MOST_CURVES // len(layers), 1))
    if not panels or not times:
        return None
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra that everything else does without

    lines = [line for text in words for line in textwrap.wrap(text, _LETTERS, max_lines=_LINES, placeholder=" ...")]
    least = max(_LEAST_PANEL_IN, _LEAST_IN / len(panels))
    heights = [max(least, _ENTRY_IN * (1 + len(p.signals) * len(layers))) for p in panels]
    size = (_WIDTH_IN, 0.7 + sum(heights) + _ENTRY_IN * len(lines))
    figure = Figure(figsize=size, dpi=120, layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    along = _time_scale(float(times[0]), float(times[-1]))
    for place, panel in zip(axes, panels, strict=True):
        _fill(place, along.shown(times), panel, layers)
    axes[-1].set_xlabel(along.label, fontsize=9)
    _set_ticks(axes[-1].xaxis, 10)
    if lines:
        figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=8)
    figure.align_ylabels(axes)
    return figure


def arranged(signals: Sequence[Signal], most: int) -> tuple[list[Panel], list[str]]:
    """Panels of `most` signals at most, and in words what is in none of them: what never changes, or is not finite.

    Where nothing changes there are panels all the same.
    """
    units: dict[str, list[Panel]] = defaultdict(list)
    lost = []
    for signal in signals:
        ends = _ends(signal)
        if ends is None:
            lost.append(signal)
        else:
            units[signal.unit].append(Panel((signal,), *ends))
    moving, still = [], []
    for alone in units.values():
        least = _STILL * max(1.0, *(max(abs(one.low), abs(one.high)) for one in alone))
        moving.append([one for one in alone if one.high - one.low > least])
        still += [(one.signals[0], one.low, least) for one in alone if one.high - one.low <= least]
    if any(moving):
        panels = [panel for alone in moving for panel in _joined(alone, most, _MOST_LARGER)]
    else:
        panels = [panel for alone in units.values() for panel in _joined(alone, most, math.inf)]
    words = []
    if still:
        values = (
            f"{_name(s.name).strip()} {_plain(with_unit(value, s.unit, least), _LONGEST_NAME)}"
            for s, value, least in still
        )
        words.append(f"Does not change: {', '.join(values)}")
    if lost:
        words.append(f"Has no finite value: {', '.join(_name(signal.name).strip() for signal in lost)}")
    return panels, words


def _ends(signal: Signal) -> tuple[float, float] | None:
    """The least and the largest of its values that are finite; None where none is."""
    arrays = [np.asarray(layer, dtype=np.float64) for layer in signal.layers]
    finite = [array[np.isfinite(array)] for array in arrays]
    there = [array for array in finite if array.size]
    if not there:
        return None
    return float(min(array.min() for array in there)), float(max(array.max() for array in there))


def _joined(alone: Sequence[Panel], most: int, larger: float) -> list[Panel]:
    """Signals of one unit, together where each is seen to move; in their order, by the first of each panel."""
    order = {one.signals[0].name: place for place, one in enumerate(alone)}
    panels: list[tuple[Panel, float]] = []
    for one in sorted(alone, key=lambda one: one.low - one.high):
        for place, (panel, least) in enumerate(panels):
            both = Panel(
                tuple(sorted((*panel.signals, *one.signals), key=lambda signal: order[signal.name])),
                min(panel.low, one.low),
                max(panel.high, one.high),
            )
            moves = min(least, one.high - one.low)
            if len(both.signals) <= most and (larger == math.inf or both.high - both.low <= larger * moves):
                panels[place] = both, moves
                break
        else:
            panels.append((one, one.high - one.low))
    return sorted((panel for panel, _ in panels), key=lambda panel: order[panel.signals[0].name])


def _fill(axes: "Axes", times: _Array, panel: Panel, layers: Sequence[str]) -> None:
    scale = _scale_of(panel)
    for place, signal in enumerate(panel.signals):
        for depth, (layer, values) in enumerate(zip(layers, signal.layers, strict=True)):
            axes.plot(
                times,
                scale.shown(values),
                label=", ".join(part for part in (_name(signal.name), layer) if part),
                color=_COLOURS[place % len(_COLOURS)],
                marker="o" if len(times) == 1 else None,
                **_look(place, depth, len(layers)),
            )
    axes.set_ylabel(scale.label, fontsize=9)
    axes.set_ylim(*_seen(*scale.shown([panel.low, panel.high]).tolist()))
    if len(times) > 1 and times[-1] > times[0]:
        axes.set_xlim(times[0], times[-1])
    _set_ticks(axes.yaxis, 5)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.0), borderaxespad=0.0, frameon=False, fontsize=8)


def _look(place: int, depth: int, depths: int) -> dict[str, Any]:
    """Of several layers the lowest is wide and pale, the highest thin and dark; of one, each curve has its style."""
    if depths > 1:
        return {"linewidth": 1.0, "alpha": 1.0} if depth else {"linewidth": 4.0, "alpha": 0.35}
    return {"linewidth": 1.6 - 0.12 * place, "linestyle": _STYLES[place % len(_STYLES)]}


def _scale_of(panel: Panel) -> _Scale:
    base = _base(panel.low, panel.high, _values(panel))
    own = panel.signals[0].unit
    exponent, unit = scaled_unit(max(abs(panel.low - base), abs(panel.high - base)), own)
    label = _plain(unit, _LONGEST_UNIT) or ("no unit" if own == "1" else "")
    if base:
        label += f"\nfrom {_plain(with_unit(base, own), _LONGEST_UNIT)}"
    return _Scale(base, 10.0**-exponent, label)


def _time_scale(first: float, last: float) -> _Scale:
    base = _base(first, last, iter((first,)))
    ends = max(abs(first - base), abs(last - base))
    factor, unit = next(((factor, unit) for least, factor, unit in _TIMES if ends >= least), (1e6, "\u00b5s"))
    if not ends:
        factor, unit = 1.0, "s"
    return _Scale(base, factor, f"time{f' from {short(base)} s on' if base else ''}, {unit}")


def _base(low: float, high: float, values: Iterator[float]) -> float:
    """What to take from values so that four digits tell them apart: the first, or nothing where they do anyhow."""
    span, largest = high - low, max(abs(low), abs(high))
    return next(values) if _STILL * largest < span < _NARROW * largest else 0.0


def _values(panel: Panel) -> Iterator[float]:
    return (value for signal in panel.signals for layer in signal.layers for value in layer if math.isfinite(value))


def _seen(low: float, high: float) -> tuple[float, float]:
    """What an axis shows: a little more than the values, and something around those that are all the same."""
    span, largest = high - low, max(abs(low), abs(high))
    around = 0.06 * span if span > _STILL * largest else 0.1 * largest or 1.0
    return low - around, high + around


def _set_ticks(axis: "Axis", most: int) -> None:
    """Set marks at numbers of four digits at most, without an exponent or anything to add to them."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator  # noqa: PLC0415 - as above

    axis.set_major_locator(MaxNLocator(nbins=most, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: short(value, _smallest(axis))))


def _smallest(axis: "Axis") -> float:
    """What is nothing on an axis."""
    low, high = axis.get_view_interval()
    return 1e-6 * abs(high - low)


def _name(name: str) -> str:
    """A name as it can stand in a legend, which leaves out what begins with _; of a long one the end tells most."""
    text = _plain(name, _LONGEST_NAME)
    return f" {text}" if text.startswith("_") else text


def _plain(text: str, longest: int) -> str:
    """A text in one line that is no formula to the drawing library; of a long one its end."""
    line = " ".join(printable(text).split())
    return (line if len(line) <= longest else f"...{line[3 - longest :]}").replace("$", r"\$")
