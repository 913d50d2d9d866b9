# SPDX-License-Identifier: MIT
"""The placement study as a web page of its own, with its figures; it loads nothing from elsewhere."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Final

from segway_ecc.hil.figure import image
from segway_ecc.hil.page import figure, page, pairs, section, table, table_row
from segway_ecc.hil.placement.judging import UPRIGHT
from segway_ecc.hil.placement.results import (
    BOUNDS,
    POSITION_M,
    STOP_S,
    Drive,
    Stop,
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
_GREY: Final = "#6b6b6b"
_PALE: Final = "#f3d6d3"
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
    drawn = {
        "How far off each placement is. Red: it fell, never stood up, or is too far off.": _draw_distances,
        "From stop to zero torque, the longest of all presses. Dashed: what is allowed.": _draw_stops,
        f"{BOUNDS}, by search; the mark is what theory gives.": _draw_bounds,
    }
    shown = "".join(figure(caption, draw(found)) for caption, draw in drawn.items()) if found.drives else ""
    sections = (
        section("Verdict", f"<p>Recommended: <strong>{escape(best)}</strong>.</p>\n<p>{escape(rule)}</p>\n"),
        section("Figures", shown) if shown else "",
        *(section(t.title, table(t.title, t.head, map(table_row, t.rows))) for t in tables(found) if t.rows),
        section("Facts of this study", pairs(facts)),
    )
    return page(_TITLE, _INTRODUCTION, sections)


def _draw_distances(found: StudyResult) -> str:
    """How far off each choice is on each network."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        networks, shown = network_names(found), placements(found)
        axes.set_xlim(-0.5, len(networks) - 0.5)
        axes.set_ylim(len(shown) - 0.5, -0.5)
        axes.set_xticks(range(len(networks)), networks, rotation=20, ha="right")
        axes.set_yticks(range(len(shown)), [str(choice) for choice in shown])
        axes.tick_params(length=0)
        for side in axes.spines.values():
            side.set_visible(False)
        for drive in found.drives:
            _draw_distance(axes, drive, found)

    label = "Each placement on each network: how far from the robot with all control on board, or that it fell"
    return image("distances", label, (11.0, 5.4), draw)


def _draw_stops(found: StudyResult) -> str:
    """How long each stop took."""

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        names = network_names(found)
        for place, (title, chosen) in enumerate(_stop_groups(found.stops)):
            times = {s.network: s.worst_s for s in chosen}
            ends = [(names.index(n) + 0.27 * (place - 1), t * 1e3) for n, t in times.items() if t is not None]
            if ends:
                axes.bar([x for x, _ in ends], [ms for _, ms in ends], width=0.25, label=title)
        axes.axhline(STOP_S * 1e3, color=_BAD, linewidth=1, linestyle="--")
        axes.set_xticks(range(len(names)), names, rotation=20, ha="right")
        axes.set_ylabel("from stop to zero torque, ms")
        if axes.patches:
            axes.legend(frameon=False)

    return image("stops", "From pressing stop to zero torque on each network", (9.5, 4.2), draw)


def _draw_bounds(found: StudyResult) -> str:
    """The limits of balance control on the station that are a time."""
    times = [bound for bound in found.bounds if bound.unit == "s"]

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        for place, bound in enumerate(times):
            ms = bound.tolerated * 1e3
            axes.barh(place, ms, height=0.6, color=_GOOD)
            if bound.theory is not None:
                axes.plot([bound.theory * 1e3] * 2, [place - 0.4, place + 0.4], color=_BAD, linewidth=2)
            axes.annotate(f"{ms:.4g}", (ms, place), (4, 0), textcoords="offset points", va="center", color=_GREY)
        axes.set_yticks(range(len(times)), [f"{b.robot}: {b.what}" for b in times])
        axes.invert_yaxis()
        axes.set_xlabel("ms; the mark is the delay margin of the design")

    return image("bounds", BOUNDS, (9.5, 1.2 + 0.5 * len(times)), draw)


def _draw_distance(axes: "Axes", drive: Drive, found: StudyResult) -> None:
    x, y = network_names(found).index(drive.network), placements(found).index(drive.placement)
    is_up = drive.outcome in UPRIGHT
    text = f"{drive.max_position_m * 1e3:.0f} mm" if is_up else drive.outcome.value.replace(" ", "\n", 1)
    is_bad = not is_up or drive.max_position_m > POSITION_M
    share = min(max(drive.max_position_m, _FLOOR_M) / POSITION_M, 1.0)
    colour = _PALE if is_bad else (1.0 - 0.35 * share, 1.0 - 0.18 * share, 1.0)
    axes.fill_between([x - 0.48, x + 0.48], y - 0.46, y + 0.46, color=colour, linewidth=0)
    axes.annotate(text, (x, y), ha="center", va="center", fontsize=7.5, color=_BAD if is_bad else "#111111")


def _stop_groups(stops: Sequence[Stop]) -> list[tuple[str, list[Stop]]]:
    """Those over the same flows."""
    rows = [row for row in stops if row.sequence == row.balance]
    on_board = [row for row in rows if row.balance != "station"]
    return [
        ("nothing crosses the network", [row for row in on_board if row.supervision != "station"]),
        ("the stop crosses it", [row for row in on_board if row.supervision == "station"]),
        ("the commands cross it", [row for row in rows if row.balance == "station"]),
    ]
