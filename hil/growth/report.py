# SPDX-License-Identifier: MIT
"""The growth study as a web page of its own, with its figures."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from segway_ecc.hil.figure import image, svg
from segway_ecc.hil.growth.study import AxisResult, rows, verdict
from segway_ecc.hil.page import figure as page_figure
from segway_ecc.hil.page import page, pairs, section, table, table_row

_TITLE: Final = "What a cycle costs as the robot grows"
_INTRODUCTION: Final = (
    "CPU time of the loop's thread from the end of one wait to the beginning of the next, by the number of model "
    "ports, drives, subscribers and robots on one host. Ports and drives in lock step, where the caches are warm; "
    "subscribers and robots in real time, with ROS and the recorder."
)
_P50: Final = "#2e6f9e"
_P99: Final = "#b3261e"
_GREY: Final = "#6b6b6b"
_COLUMNS: Final = 2


def render(found: Sequence[AxisResult], facts: Mapping[str, str]) -> str:
    """Render what was found, as a complete HTML page; `facts` are what else is known, by name."""
    verdicts = "".join(f"<p>{escape(verdict(grown))}.</p>\n" for grown in found)
    caption = "Median (dots, with the spread) and p99 (crosses) of each size; the line is laid through the small ones."
    drawn = image("growth", caption, _size(found), lambda figure: _draw(figure, found))
    shown = page_figure(caption, drawn)
    tables = []
    for grown in found:
        head, *body = rows(grown)
        tables.append(section(str(grown.axis).capitalize(), table(str(grown.axis), head, map(table_row, body))))
    return page(
        _TITLE,
        _INTRODUCTION,
        (section("Where it is linear", verdicts), section("Figure", shown), *tables, section("Facts", pairs(facts))),
    )


def figure(found: Sequence[AxisResult]) -> bytes:
    """The figure alone, as SVG."""
    return svg("growth", _size(found), lambda figure: _draw(figure, found))


def _size(found: Sequence[AxisResult]) -> tuple[float, float]:
    return 10.0, 3.4 * -(-len(found) // _COLUMNS)


def _draw(figure: Figure, found: Sequence[AxisResult]) -> None:
    panels = figure.subplots(-(-len(found) // _COLUMNS), _COLUMNS, squeeze=False)
    for place, panel in enumerate(panels.flat):
        if place < len(found):
            _panel(panel, found[place])
        else:
            panel.set_visible(False)


def _panel(panel: Axes, grown: AxisResult) -> None:
    run = [(p.size, p.cost) for p in grown.points if p.cost is not None]
    sizes = [size for size, _ in run]
    spreads = [0.5 * cost.spread_us for _, cost in run]
    panel.errorbar(sizes, [c.p50_us for _, c in run], yerr=spreads, fmt="o", color=_P50, markersize=4, capsize=2)
    panel.plot(sizes, [c.p99_us for _, c in run], "x", color=_P99, markersize=5)
    if grown.line is not None and sizes:
        panel.plot([sizes[0], sizes[-1]], [grown.line(sizes[0]), grown.line(sizes[-1])], color=_GREY, linewidth=1)
        if grown.line.left_at is not None:
            panel.axvline(grown.line.left_at, color=_P99, linestyle="--", linewidth=1)
    if grown.refused is not None:
        panel.axvspan(grown.refused.size, grown.refused.size * 1.05, color="#f3d6d3", linewidth=0)
    panel.set_ylim(bottom=0.0)
    panel.set_xlabel(str(grown.axis))
    panel.set_ylabel("CPU time per cycle, us")
