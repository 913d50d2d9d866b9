# SPDX-License-Identifier: MIT
"""The growth study: sizes on four axes, each measured; where each stops being linear; and both as text and page."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Final

import msgspec

from segway_ecc.hil.figure import image, svg
from segway_ecc.hil.growth import lock_step, real
from segway_ecc.hil.growth.cost import Axis, LinearFit, Measured, Point, line, together
from segway_ecc.hil.page import figure as page_figure
from segway_ecc.hil.page import page, pairs, section, table, table_row
from segway_ecc.hil.progress import OnProgress
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.ros.runtime import missing_packages

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
Measure = Callable[[int], Point]
SIZES: Final[Mapping[Axis, Sequence[int]]] = {
    Axis.PORTS: (2, 16, 64, 128, 256, 512, 1024, 2048, 8192),
    Axis.DRIVES: (2, 4, 6, 8, 10, 12, 14, 16, 18),
    Axis.SUBSCRIBERS: (0, 2, 4, 8, 16),
    Axis.ROBOTS: (1, 2, 4, 8),
}
QUICK: Final[Mapping[Axis, Sequence[int]]] = {Axis.PORTS: (2, 64, 256, 1024), Axis.DRIVES: (2, 4, 8, 16)}
"""What takes some seconds, and needs no ROS."""
MEASURES: Final[Mapping[Axis, Measure]] = {
    Axis.PORTS: lock_step.measure_ports,
    Axis.DRIVES: lock_step.measure_drives,
    Axis.SUBSCRIBERS: real.subscribers,
    Axis.ROBOTS: real.robots,
}
_WITH_ROS: Final = (Axis.SUBSCRIBERS, Axis.ROBOTS)
_HEAD: Final = ("p50, us", "p99, us", "spread, us", "line, us")
_ROUNDS: Final = dict.fromkeys(_WITH_ROS, 2)
"""In real time a machine's other work comes and goes: every size is run again after all of them were run."""


class AxisResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one axis; `line` goes through the small sizes, None where fewer than three could be run."""

    axis: Axis
    points: tuple[Point, ...]
    line: LinearFit | None

    @property
    def refused(self) -> Point | None:
        """The first size that does not run."""
        return next((point for point in self.points if point.cost is None), None)


def conduct(
    sizes: Mapping[Axis, Sequence[int]], on_progress: OnProgress, measures: Mapping[Axis, Measure] = MEASURES
) -> list[AxisResult]:
    """Measure every size; those axes that need ROS are left out where it is not there.

    Raises:
        RigError: A process failed.
    """
    axes = [axis for axis in sizes if axis not in _WITH_ROS or not missing_packages()]
    todo = [(axis, size) for axis in axes for size in list(sizes[axis]) * _ROUNDS.get(axis, 1)]
    points: dict[tuple[Axis, int], list[Point]] = {}
    for done, (axis, size) in enumerate(todo, 1):
        points.setdefault((axis, size), []).append(measures[axis](size))
        on_progress(done, len(todo))
    whole = {}
    for key, rounds in points.items():  # a size that does not run in one round never does
        costs = [point.cost for point in rounds if point.cost is not None]
        whole[key] = msgspec.structs.replace(rounds[-1], cost=together(costs)) if costs else rounds[-1]
    return [grown(axis, [whole[axis, size] for size in sizes[axis]]) for axis in axes]


def grown(axis: Axis, points: Sequence[Point]) -> AxisResult:
    """Lay the line through what was measured on an axis."""
    measured = [Measured(p.size, p.cost.p50_us, p.cost.spread_us) for p in points if p.cost is not None]
    return AxisResult(axis=axis, points=tuple(points), line=line(measured) if len(measured) >= 3 else None)  # noqa: PLR2004 - a line's least


def text(found: Sequence[AxisResult]) -> str:
    """All tables, for a terminal."""
    return "\n".join("\n  ".join([verdict(grown), *aligned(rows(grown), left=0)]) + "\n" for grown in found)


def verdict(grown: AxisResult) -> str:
    """Where it is linear, and where it stops being so."""
    line, refused = grown.line, grown.refused
    described = f"{grown.axis}: too few sizes for a line"
    if line is not None:
        described = (
            f"{grown.axis}: {line.at_zero:.1f} us and {line.per_one:.3g} us for each, linear up to {line.up_to:g}"
        )
        if line.left_at is None:
            described += ", the most that was tried"
        else:
            described += f"; at {line.left_at:g} it is {line.off:+.1f} us off (spread {line.spread:.1f} us)"
    return described if refused is None else f"{described}; {refused.size} do not run: {refused.refused}"


def rows(grown: AxisResult) -> list[list[str]]:
    """The head and a row for each size."""
    notes = list(dict.fromkeys(name for p in grown.points if p.cost is not None for name in p.cost.notes))
    made = [[str(grown.axis), *_HEAD, *notes]]
    for point in grown.points:
        cost = point.cost
        if cost is None:
            made.append([str(point.size), *["-"] * (len(_HEAD) + len(notes))])
            continue
        at = "-" if grown.line is None else f"{grown.line(point.size):.1f}"
        figures = [f"{cost.p50_us:.1f}", f"{cost.p99_us:.1f}", f"{cost.spread_us:.1f}", at]
        made.append([str(point.size), *figures, *(cost.notes.get(name, "-") for name in notes)])
    return made


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


def _draw(figure: "Figure", found: Sequence[AxisResult]) -> None:
    panels = figure.subplots(-(-len(found) // _COLUMNS), _COLUMNS, squeeze=False)
    for place, panel in enumerate(panels.flat):
        if place < len(found):
            _panel(panel, found[place])
        else:
            panel.set_visible(False)


def _panel(panel: "Axes", grown: AxisResult) -> None:
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
