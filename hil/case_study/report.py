# SPDX-License-Identifier: MIT
"""The case study as a web page of its own, which loads nothing from elsewhere; its figures are SVG elements in it."""

import math
import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from segway_ecc.hil.case_study.study import (
    NOT_RUN,
    Cell,
    Edge,
    Seat,
    Study,
    Trajectory,
    difference,
    difference_text,
    worst_difference,
    worst_text,
    worst_thesis_difference,
)
from segway_ecc.hil.figure import Draw, svg
from segway_ecc.hil.page import figure, page, pairs, section, wide

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

_TURN_TIME = 10.0
"""When the turn run changes its angular set-point, s."""
_ZOOM = 0.5
"""How much of a step's response the insets show, s."""
_ROUNDING = 0.005
"""Half of the last digit the thesis printed, m."""
_FLOOR = 1e-4
"""Errors below this, zero among them, stand at the foot of the logarithmic axis, m."""

_GREY = "#6b6b6b"
_STYLE: "Mapping[RcKeyType, str | float | bool]" = {
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e3e3e3",
    "legend.frameon": False,
}

_Run = tuple[Trajectory, Sequence[float]]
_T = TypeVar("_T")

_TITLE = "Case study: a thesis' cart, re-run"
_INTRODUCTION = (
    "A thesis (Hoftijzer, University of Twente, 2019) simulated a cart, ran code generated from the same model as a "
    "ROS node, and printed where the cart ends after 10 s in both. Here that model is re-run with the same set-points "
    "in up to four seats: offline in one process, as a C submodel, behind ROS 2, and in a loop over a CAN bus."
)


def render(study: Study) -> str:
    """A run of the case study as a complete HTML page; positions and differences in m, velocities in m/s and rad/s."""
    sections = (
        section("Verdict", _verdict(study)),
        section("Where the cart ends", _table(study.cells, study.seats)),
        section("Figures", _figures(study)),
        section("Facts of this run", pairs({**study.facts, "Repeated runs": " | ".join(study.repeated) or "none"})),
    )
    return page(_TITLE, _INTRODUCTION, sections)


def _verdict(study: Study) -> str:
    cells, sentences = study.cells, []
    yardstick = "No cell was given, so there is nothing to compare."
    if cells:
        thesis = worst_thesis_difference(cells)
        yardstick = (
            f"The thesis' own ROS run differs from its simulation by up to {thesis:.2f} m. "
            "The worst difference of each seat from the same simulation, in one coordinate of one cell:"
        )
    for seat in Seat:
        worst = worst_difference(cells, seat)
        if seat not in study.seats or math.isnan(worst):
            sentences.append(f"The {seat} seat did not run.")
            continue
        comparison = "smaller than" if worst < thesis else "not smaller than"
        ran = f"{sum(seat in cell.positions for cell in cells)} of {len(cells)} cells"
        sentences.append(f"The {seat} seat: {worst:.4f} m in {ran}, {comparison} the thesis' {thesis:.2f} m.")
    sentences += [_sameness(cells), *([study.real_time.text] if study.real_time else [])]
    items = "".join(f"<li>{escape(sentence)}</li>\n" for sentence in sentences)
    return f"<p>{escape(yardstick)}</p>\n<ul>\n{items}</ul>\n"


def _sameness(cells: Sequence[Cell]) -> str:
    """Whether the ROS seat computed what the offline seat did."""
    ran = [cell.positions for cell in cells if {Seat.ROS, Seat.OFFLINE} <= cell.positions.keys()]
    if not ran:
        return "Whether the ros seat equals the offline seat is not known: no cell ran in both."
    unequal = [difference(at[Seat.ROS], at[Seat.OFFLINE]) for at in ran if at[Seat.ROS] != at[Seat.OFFLINE]]
    if not unequal:
        return f"The ros seat equals the offline seat to the last bit in every one of the {len(ran)} cells both ran."
    return (
        f"The ros seat does not equal the offline seat to the last bit: {len(unequal)} of {len(ran)} cells differ, "
        f"by up to {max(unequal):.3g} m."
    )


def _table(cells: Sequence[Cell], seats: Sequence[Seat]) -> str:
    count = len(seats)
    groups = [("Set-point", 2), ("Thesis: x, y in m", 2), ("Re-run: x, y in m", count), ("Difference in m", 1 + count)]
    upper = "".join(
        f'<th scope="colgroup" class="group" colspan="{span}">{escape(name)}</th>' for name, span in groups if span
    )
    names = ["linear, m/s", "angular, rad/s", "offline", "ROS", *seats, "thesis ROS", *seats]
    lower = "".join(f'<th scope="col"{_edge(i, seats)}>{escape(name)}</th>' for i, name in enumerate(names))
    footer = ""
    if cells:
        worst = (worst_text(cells, seat).removesuffix(" m") for seat in seats)
        data = _data((f"{worst_thesis_difference(cells):.4f}", *worst), 4 + count, seats)
        footer = f'<tfoot>\n<tr><th scope="row" colspan="{4 + count}">worst</th>{data}</tr>\n</tfoot>\n'
    return wide(
        "Positions and differences",
        "<table>\n<caption><span>Position (x, y) of the cart after 10 s, and the difference from the thesis' offline "
        "table in the worse coordinate.</span></caption>\n"
        f"<thead>\n<tr>{upper}</tr>\n<tr>{lower}</tr>\n</thead>\n"
        f"<tbody>\n{''.join(_row(cell, seats) for cell in cells)}</tbody>\n{footer}</table>\n",
    )


def _row(cell: Cell, seats: Sequence[Seat]) -> str:
    positions = [cell.positions.get(seat) for seat in seats]
    values = [
        _position(cell.thesis_offline, 2),
        _position(cell.thesis_ros, 2),
        *(_position(position, 4) if position else NOT_RUN for position in positions),
        f"{difference(cell.thesis_ros, cell.thesis_offline):.4f}",
        *(difference_text(cell, seat) for seat in seats),
    ]
    heads = f'<th scope="row">{cell.linear:g}</th><th scope="row">{cell.angular:g}</th>'
    return f"<tr>{heads}{_data(values, 2, seats)}</tr>\n"


def _data(values: Iterable[str], first: int, seats: Sequence[Seat]) -> str:
    return "".join(f"<td{_edge(i, seats)}>{value}</td>" for i, value in enumerate(values, first))


def _edge(column: int, seats: Sequence[Seat]) -> str:
    """The class that draws a line before the first column of a group."""
    return ' class="group"' if column in {2, 4, 4 + len(seats)} else ""


def _position(position: tuple[float, float], decimals: int) -> str:
    # "z": a position of -0.0 is printed as 0.
    return f"{position[0]:z.{decimals}f}, {position[1]:z.{decimals}f}"


def _figures(study: Study) -> str:
    several = len(study.seats) > 1
    overlap = " Seats that agree lie on each other, each drawn thinner than the one before it." if several else ""
    held = f"Velocities while 1 m/s and 0.5 rad/s are held; the insets enlarge the first half second.{overlap}"
    turn = f"The turn run: the angular set-point changes to -0.5 rad/s at 10 s.{overlap}"
    errors = "Position error of each cell against the thesis' offline table, which prints whole centimetres."
    graph = "Nodes and topics as ROS reported them while the ros seat ran. A node that does both stands on both sides."
    return (
        _figure(study.velocities, velocities_svg, held, "No seat ran the velocity run.")
        + _figure(study.velocities, path_svg, "Path of the same run.", "")
        + _figure(study.turn, turn_svg, turn, "No seat ran the turn run.")
        + _figure(study.cells, lambda cells: errors_svg(cells, study.seats), errors, "No cell was given.")
        + _figure(study.graph, graph_svg, graph, "No ROS graph was recorded.")
    )


def _figure(data: Sequence[_T], draw: Callable[[Sequence[_T]], str], caption: str, missing: str) -> str:
    if not data:
        return f"<p>{escape(missing)}</p>\n" if missing else ""
    return figure(caption, draw(data))


class _Look(NamedTuple):
    """How a seat is drawn: later seats are thinner, so that one which is identical lets the earlier ones show."""

    colour: str
    width: float
    dashes: str | tuple[float, tuple[float, float]]
    marker: str
    marker_size: float


_LOOKS = {
    Seat.OFFLINE: _Look("#7cc4ee", 6.0, "-", "o", 13.0),
    Seat.SUBMODEL: _Look("#2e8b57", 4.0, "-", "D", 10.5),
    Seat.ROS: _Look("#c44e00", 2.6, (0, (4, 2)), "s", 8.0),
    Seat.CAN: _Look("#111111", 1.3, (0, (1.2, 2)), ".", 8.0),
}
_THESIS_LOOK = _Look(_GREY, 0.0, "", "x", 8.0)


def velocities_svg(trajectories: Sequence[Trajectory]) -> str:
    """Draw the linear (m/s) and angular (rad/s) velocity of every seat over time (s), the first moments enlarged."""

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True)
        zoom = (0.3, 0.16, 0.5, 0.58)
        _time_panel(upper, [(t, t.linear_velocity) for t in trajectories], "linear velocity, m/s", zoom, 0.0)
        _time_panel(lower, [(t, t.angular_velocity) for t in trajectories], "angular velocity, rad/s", zoom, 0.0)
        _legend(figure, upper)

    return _svg("velocities", "Linear and angular velocity of the cart over time, in each seat", (8.5, 6.4), draw)


def path_svg(trajectories: Sequence[Trajectory]) -> str:
    """Draw the path (m) of every seat, with its start and end."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        _path_panel(axes, trajectories)
        _legend(figure, axes)

    return _svg("path", "Path of the cart in the plane, in each seat", (7.0, 5.6), draw)


def turn_svg(trajectories: Sequence[Trajectory]) -> str:
    """Draw the turn run: angular velocity (rad/s) over time (s) and path (m), the change of set-point (10 s) marked."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, width_ratios=(1.2, 1))
        runs = [(t, t.angular_velocity) for t in trajectories]
        _time_panel(left, runs, "angular velocity, rad/s", (0.16, 0.1, 0.3, 0.5), _TURN_TIME - _ZOOM / 5)
        left.axvline(_TURN_TIME, color=_GREY, linewidth=1)
        across = (left.get_xaxis_transform(), "offset points")
        left.annotate("set-point becomes\n-0.5 rad/s", (_TURN_TIME, 0.7), (8, 0), *across)
        _path_panel(right, trajectories)
        for run in trajectories[:1]:
            at = min(bisect_left(run.time, _TURN_TIME), len(run.time) - 1)
            _mark(right, (run.x[at], run.y[at]), "D", "10 s")
        _legend(figure, left)

    return _svg("turn", "Angular velocity and path of the cart when the turn is reversed at 10 s", (10.0, 4.6), draw)


def errors_svg(cells: Sequence[Cell], seats: Sequence[Seat]) -> str:
    """Draw each cell's position error (m) against the thesis' offline table, beside the thesis' own ROS run."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set_yscale("log")
        axes.axhspan(_FLOOR / 2, _ROUNDING, color="#efefef", zorder=0, label="rounding of the thesis' table")
        thesis = {i: difference(c.thesis_ros, c.thesis_offline) for i, c in enumerate(cells)}
        _error_series(axes, thesis, "thesis' own ROS run", _THESIS_LOOK)
        for seat in seats:
            ran = {i: c for i, c in enumerate(cells) if seat in c.positions}
            errors = {i: difference(c.positions[seat], c.thesis_offline) for i, c in ran.items()}
            _error_series(axes, errors, seat, _LOOKS[seat])
        axes.set_xticks(range(len(cells)), [f"{c.linear:g}, {c.angular:g}" for c in cells])
        axes.set(xlabel="set-points: linear in m/s, angular in rad/s", ylabel="position error, m")
        axes.set_ylim(_FLOOR / 1.6, max(1.0, axes.get_ylim()[1]))
        below = "\N{LESS-THAN OR EQUAL TO} "
        axes.yaxis.set_major_formatter(lambda value, _: f"{below if value <= _FLOOR else ''}{value:g}")
        axes.grid(visible=False, axis="x")
        _legend(figure, axes)

    return _svg("errors", "Position error of each cell against the thesis' offline table", (9.5, 4.8), draw)


def graph_svg(edges: Sequence[Edge]) -> str:
    """Draw the ROS graph: publishing nodes on the left, topics in the middle, subscribing nodes on the right."""
    ordered = sorted(edges, key=lambda edge: (edge.publisher, edge.subscriber, edge.topic))
    topics = list(dict.fromkeys((edge.topic, edge.type_name) for edge in ordered))
    rows = {topic: row for row, (topic, _) in enumerate(topics)}

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.set(xlim=(0, 10), ylim=(len(topics) + 0.1, -0.7))
        axes.axis("off")
        for row, (topic, type_name) in enumerate(topics):
            _box(axes, (3.2, 6.8), (row, row + 1), f"{topic}\n{type_name}", "#8a8a8a")
        # A topic with nobody at one end stands without an arrow there.
        published = [(edge.publisher, rows[edge.topic]) for edge in ordered if edge.publisher]
        subscribed = [(edge.subscriber, rows[edge.topic]) for edge in ordered if edge.subscriber]
        _nodes(axes, "published by", (0.1, 2.2, 3.2), published)
        _nodes(axes, "subscribed by", (7.8, 9.9, 6.8), subscribed)

    return _svg("graph", "Nodes and topics of the ROS graph", (9.5, 0.55 * (len(topics) + 0.8)), draw)


def _time_panel(
    axes: Axes, runs: Sequence[_Run], label: str, zoom: tuple[float, float, float, float], start: float
) -> None:
    """Draw values over time, and again within the bounds `zoom` enlarged from a time (s) on."""
    inset = axes.inset_axes(zoom, xlim=(start, start + _ZOOM))
    for run, values in runs:
        _line(axes, run.seat, run.time, values)
        _line(inset, run.seat, run.time, values)
    axes.set(xlabel="time, s", ylabel=label)
    axes.margins(y=0.12)
    inset.set_title(f"{start:g} s to {start + _ZOOM:g} s", fontsize=9.5, color=_GREY)
    inset.tick_params(labelsize=9.5)


def _path_panel(axes: Axes, trajectories: Sequence[Trajectory]) -> None:
    for run in trajectories:
        _line(axes, run.seat, run.x, run.y)
    for run in trajectories[:1]:
        _mark(axes, (run.x[0], run.y[0]), "o", "start", -16)
        _mark(axes, (run.x[-1], run.y[-1]), "s", "end")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    axes.set(xlabel="x, m", ylabel="y, m")


def _line(axes: Axes, seat: Seat, across: Sequence[float], up: Sequence[float]) -> None:
    look = _LOOKS[seat]
    axes.plot(across, up, label=seat, color=look.colour, linewidth=look.width, linestyle=look.dashes)


def _mark(axes: Axes, at: tuple[float, float], marker: str, text: str, lift: float = 8) -> None:
    axes.plot(*at, marker, markersize=8, markerfacecolor="white", markeredgecolor="black", zorder=4)
    axes.annotate(text, at, (9, lift), textcoords="offset points", zorder=5)


def _error_series(axes: Axes, errors: Mapping[int, float], label: str, look: _Look) -> None:
    heights = [max(error, _FLOOR) for error in errors.values()]
    (marks,) = axes.plot(list(errors), heights, look.marker, ms=look.marker_size, color=look.colour, label=label)
    marks.set(markeredgewidth=2, markerfacecolor="none")


def _nodes(axes: Axes, title: str, across: tuple[float, float, float], links: Sequence[tuple[str, int]]) -> None:
    """Draw one column of nodes, each with an arrow for every topic; `across` is its left, its right and the topics'."""
    left, right, topic = across
    rows = {node: sorted({row for name, row in links if name == node}) for node, _ in links}
    # Nodes as tall as their share of the links, in the order of their topics: most arrows are then level.
    scale = len({row for _, row in links}) / max(1, sum(map(len, rows.values())))
    top = 0.0
    axes.text((left + right) / 2, -0.3, title, ha="center", va="center", color=_GREY)
    for node in sorted(rows, key=lambda name: fmean(rows[name])):
        bottom = top + scale * len(rows[node])
        _box(axes, (left, right), (top, bottom), node, "#0072b2")
        for row in rows[node]:
            inner = (right if topic > right else left, min(max(row + 0.5, top + 0.25), bottom - 0.25))
            ends = (inner, (topic, row + 0.5)) if topic > right else ((topic, row + 0.5), inner)
            arrow = {"arrowstyle": "-|>", "color": "#333333", "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", ends[1], ends[0], arrowprops=arrow)
        top = bottom


def _box(axes: Axes, across: tuple[float, float], down: tuple[float, float], text: str, colour: str) -> None:
    """A rounded box with a text, a little lower than the rows it takes."""
    (left, right), (top, bottom) = across, down
    size = (right - left, bottom - top - 0.2)
    style = "round,pad=0,rounding_size=0.15"
    axes.add_patch(FancyBboxPatch((left, top + 0.1), *size, boxstyle=style, facecolor="#f7f7f7", edgecolor=colour))
    longest = max(map(len, text.splitlines()), default=1)
    middle = ((left + right) / 2, (top + bottom) / 2)
    # A character is about 0.6 of the font size wide and a unit of this drawing about 68 points.
    font_size = min(10.0, 68 * size[0] / (0.6 * longest))
    axes.text(*middle, text, ha="center", va="center", fontsize=font_size)


def _legend(figure: Figure, axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=5, handlelength=3.2)


def _svg(name: str, label: str, size: tuple[float, float], draw: Draw) -> str:
    """Draw a figure of a size (inches) and return it as an SVG element that shares no id with another figure."""
    # No mathematics: a topic's name may contain a dollar sign.
    with mpl.rc_context({**_STYLE, "text.parse_math": False}):
        drawn = svg(name, size, draw, font_size=10.5).decode()
    # matplotlib numbers ids from 1 in every figure; only tags are touched, never the text of a label.
    drawn = re.sub(r"<[^>]*>", lambda tag: re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", tag[0]), drawn)
    # Its style sheet would apply to the whole page; as attributes of the element the same settings are inherited.
    drawn = re.sub(r"<defs>\s*<style.*?</defs>\s*", "", drawn, count=1, flags=re.DOTALL)
    described = f'<svg role="img" aria-label="{escape(label)}" stroke-linejoin="round" '
    return drawn[drawn.index("<svg ") :].replace("<svg ", described, 1)
