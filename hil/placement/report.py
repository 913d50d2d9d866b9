# SPDX-License-Identifier: MIT
"""The placement study as a web page of its own, with its figures; it loads nothing from elsewhere."""

import functools
import textwrap
from collections.abc import Callable, Mapping
from html import escape
from typing import TYPE_CHECKING, Final, NamedTuple

from segway_ecc.hil.figure import image
from segway_ecc.hil.page import figure, page, pairs, section, table, table_row
from segway_ecc.hil.placement.judging import UPRIGHT
from segway_ecc.hil.placement.results import (
    BOUNDS,
    POSITION_M,
    STOP_S,
    Bound,
    Drive,
    Placement,
    StudyResult,
    network_names,
    overall,
    placements,
    tables,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLE: Final = "Where to place the parts of control"
_INTRODUCTION: Final = (
    "Sequence control, balance control and supervision, each on the robot or on the base station, with a simulated "
    "network between them: plant, drives, guard, node and network run in lock step. Drives, their watchdogs, sensors "
    "and the guard are always on the robot. What stays within one place crosses no network."
)
_BAD: Final = "#b3261e"
_GOOD: Final = "#2e6f9e"
_INK: Final = "#111111"
_PALE: Final = "#f3d6d3"
_HATCH: Final = "#c98a84"
_NOTHING: Final = "nothing crosses the network"
_STOP: Final = "the stop crosses it"
_COMMANDS: Final = "the commands cross it"
_WAYS: Final = (_NOTHING, _STOP, _COMMANDS)
_BARS: Final = ("#9aa5ad", _GOOD, "#b8860b")
_LABEL_LETTERS: Final = 34
_NETWORK_LETTERS: Final = 7
_FLOOR_M: Final = 1e-3
"""Distances below this stand at the foot of the logarithmic axis, m."""


def render(found: StudyResult, facts: Mapping[str, str]) -> str:
    """What was found, and named facts of the study, as a complete HTML page."""
    rule = (
        f"Fit is what neither falls nor holds while the network lasts, stays within {POSITION_M:g} m of the robot with "
        f"all control on board, stops within {STOP_S:g} s, and does not fall in a partition. Recommended is, of those "
        "that are fit on the most networks, the one with the most on the station."
    )
    best = str(overall(found) or "none is fit")
    shown = "".join(
        figure(each.caption, image(each.name, each.label, each.size(found), functools.partial(each.draw, found)))
        for each in FIGURES
        if each.has_data(found)
    )
    sections = (
        section("Verdict", f"<p>Recommended: <strong>{escape(best)}</strong>.</p>\n<p>{escape(rule)}</p>\n"),
        section("Figures", shown) if shown else "",
        *(section(t.title, table(t.title, t.head, map(table_row, t.rows))) for t in tables(found) if t.rows),
        section("Facts of this study", pairs(facts)),
    )
    return page(_TITLE, _INTRODUCTION, sections)


def _size_of_distances(found: StudyResult) -> tuple[float, float]:
    return 3.6 + max(0.62 * len(network_names(found)), 1.2), 0.6 + 0.4 * len(placements(found))


def _draw_distances(found: StudyResult, figure: "Figure") -> None:
    """How far off each choice is on each network."""
    axes = figure.subplots()
    networks, shown = network_names(found), placements(found)
    axes.set_xlim(-0.5, len(networks) - 0.5)
    axes.set_ylim(len(shown) - 0.5, -0.5)
    axes.set_xticks(range(len(networks)), [_in_lines(name, _NETWORK_LETTERS) for name in networks])
    axes.set_yticks(range(len(shown)), [_in_lines(str(choice), _LABEL_LETTERS) for choice in shown])
    axes.tick_params(length=0, labelsize=8.5)
    for side in axes.spines.values():
        side.set_visible(False)
    for drive in found.drives:
        _draw_distance(axes, drive, found)


def _size_of_stops(found: StudyResult) -> tuple[float, float]:
    rows = sum(len(bars) for _, bars in stop_bars(found))
    return 8.0, 1.2 + 0.23 * rows + 0.1 * len(network_names(found))


def _draw_stops(found: StudyResult, figure: "Figure") -> None:
    """How long each stop took: of each network a bar for each way, the longest; or what came of it instead."""
    axes = figure.subplots()
    colours = dict(zip(_WAYS, _BARS, strict=True))
    names, y, most = [], 0.0, STOP_S * 1e3
    for name, bars in stop_bars(found):
        names.append((y + 0.5 * (len(bars) - 1), name))
        for way, time_s, instead in bars:
            ms = (time_s or 0.0) * 1e3
            most = max(most, ms)
            axes.barh(y, ms, height=0.8, color=colours[way], label=way)
            text, colour = (instead, _BAD) if time_s is None else (f"{ms:.0f}", _INK)
            axes.annotate(text, (ms, y), (4, 0), textcoords="offset points", va="center", color=colour, fontsize=8)
            y += 1.0
        y += 0.4
    axes.axvline(STOP_S * 1e3, color=_BAD, linewidth=1, linestyle="--", label="allowed")
    axes.set_yticks([place for place, _ in names], [name for _, name in names])
    axes.set_ylim(y - 0.8, -0.6)
    axes.set_xlim(0.0, 1.15 * most)
    axes.set_xlabel("from stop to zero torque, ms")
    _draw_legend(figure, axes)


def _times(found: StudyResult) -> list[Bound]:
    return [bound for bound in found.bounds if bound.unit == "s"]


def _size_of_bounds(found: StudyResult) -> tuple[float, float]:
    return 8.0, 1.1 + 0.55 * len(_times(found))


def _draw_bounds(found: StudyResult, figure: "Figure") -> None:
    """The limits of balance control on the station that are a time: tolerated, lost, and what lies between."""
    axes = figure.subplots()
    shown, most = _times(found), 0.0
    for place, bound in enumerate(shown):
        tolerated = bound.tolerated * 1e3
        end, text = tolerated, f"over {tolerated:.4g}"
        axes.barh(place, tolerated, height=0.6, color=_GOOD, label="tolerated")
        if bound.lost is not None:
            lost = bound.lost * 1e3
            between = lost - tolerated
            axes.barh(
                place,
                between,
                left=tolerated,
                height=0.6,
                color=_PALE,
                hatch="///",
                edgecolor=_HATCH,
                label="between what held and what did not",
            )
            end, text = lost, f"{tolerated:.4g} to {lost:.4g}"
        if bound.theory is not None:
            mark = bound.theory * 1e3
            axes.plot(
                [mark] * 2, [place - 0.4, place + 0.4], color=_BAD, linewidth=2, label="delay margin of the design"
            )
            end = max(end, mark)
        axes.annotate(text, (end, place), (5, 0), textcoords="offset points", va="center", fontsize=8.5)
        most = max(most, end)
    names = [_in_lines(f"{bound.robot}: {bound.what}", _LABEL_LETTERS) for bound in shown]
    axes.set_yticks(range(len(shown)), names, fontsize=8.5)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.25 * most or 1.0)
    axes.set_xlabel("ms")
    _draw_legend(figure, axes)


def _draw_legend(figure: "Figure", axes: "Axes") -> None:
    """Name each kind of bar once, above the axes, where it hides nothing."""
    handles, labels = axes.get_legend_handles_labels()
    kinds = dict(zip(labels, handles, strict=True))
    figure.legend(kinds.values(), kinds.keys(), loc="outside upper center", ncols=4, frameon=False, fontsize=8.5)


def _draw_distance(axes: "Axes", drive: Drive, found: StudyResult) -> None:
    x, y = network_names(found).index(drive.network), placements(found).index(drive.placement)
    is_up = drive.outcome in UPRIGHT
    text = f"{drive.max_position_m * 1e3:.0f} mm" if is_up else drive.outcome.value.replace(" ", "\n", 1)
    is_bad = not is_up or drive.max_position_m > POSITION_M
    share = min(max(drive.max_position_m, _FLOOR_M) / POSITION_M, 1.0)
    colour = _PALE if is_bad else (0.93 - 0.28 * share, 0.96 - 0.14 * share, 1.0)
    axes.fill_between([x - 0.48, x + 0.48], y - 0.46, y + 0.46, color=colour, linewidth=0)
    axes.annotate(text, (x, y), ha="center", va="center", fontsize=7.5, color=_BAD if is_bad else _INK)


class StopBar(NamedTuple):
    """The longest that stops took, s, of which so much crosses the network; None with what came of one instead."""

    way: str
    longest_s: float | None
    instead: str = ""


def stop_bars(found: StudyResult) -> list[tuple[str, list[StopBar]]]:
    """Of each network what stops took, by what crosses it; one that did nothing comes before the longest."""
    rows = []
    for name in network_names(found):
        bars = []
        for way in _WAYS:
            stops = [stop for stop in found.stops if stop.network == name and _way(stop.placement) == way]
            failed = next((stop for stop in stops if stop.worst_s is None), None)
            if failed is not None:
                bars.append(StopBar(way, None, "no stop" if failed.outcome in UPRIGHT else failed.outcome.value))
            elif stops:
                bars.append(StopBar(way, max(stop.worst_s or 0.0 for stop in stops)))
        if bars:
            rows.append((name, bars))
    return rows


def _way(placement: Placement) -> str:
    """What of a stop crosses the network: the commands that end torque, the stop itself, or nothing."""
    if placement.balance_crosses:
        return _COMMANDS
    return _STOP if placement.supervision_crosses else _NOTHING


def _in_lines(text: str, letters: int) -> str:
    """A label of which no line is longer than that, where its words let it; a number keeps its per cent."""
    return "\n".join(
        textwrap.wrap(text.replace(" %", "\u00a0%"), letters, break_long_words=False, break_on_hyphens=False)
    )


class StudyFigure(NamedTuple):
    """One figure of the report: what it is called, how large it is, inches, and what draws it."""

    name: str
    label: str
    caption: str
    has_data: Callable[[StudyResult], bool]
    size: Callable[[StudyResult], tuple[float, float]]
    draw: Callable[[StudyResult, "Figure"], None]


FIGURES: Final = (
    StudyFigure(
        "distances",
        "Each placement on each network: how far from the robot with all control on board, or that it fell",
        "How far off each placement is. Red: it fell, never stood up, or is too far off.",
        lambda found: bool(found.drives),
        _size_of_distances,
        _draw_distances,
    ),
    StudyFigure(
        "stops",
        "From pressing stop to zero torque on each network",
        "From stop to zero torque, the longest of all presses.",
        lambda found: bool(stop_bars(found)),
        _size_of_stops,
        _draw_stops,
    ),
    StudyFigure(
        "bounds",
        BOUNDS,
        f"{BOUNDS}, by search: between what was tolerated and what was lost.",
        lambda found: bool(_times(found)),
        _size_of_bounds,
        _draw_bounds,
    ),
)
