# SPDX-License-Identifier: MIT
"""The case study as a web page of its own, which loads nothing from elsewhere."""

import math
from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import TypeVar

from segway_ecc.hil.case_study import figures
from segway_ecc.hil.case_study.study import (
    NOT_RUN,
    Cell,
    Seat,
    Study,
    difference,
    difference_text,
    worst_difference,
    worst_text,
    worst_thesis_difference,
)
from segway_ecc.hil.page import figure, page, pairs, section, wide

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
        _figure(study.velocities, figures.velocities_svg, held, "No seat ran the velocity run.")
        + _figure(study.velocities, figures.path_svg, "Path of the same run.", "")
        + _figure(study.turn, figures.turn_svg, turn, "No seat ran the turn run.")
        + _figure(study.cells, lambda cells: figures.errors_svg(cells, study.seats), errors, "No cell was given.")
        + _figure(study.graph, figures.graph_svg, graph, "No ROS graph was recorded.")
    )


def _figure(data: Sequence[_T], draw: Callable[[Sequence[_T]], str], caption: str, missing: str) -> str:
    if not data:
        return f"<p>{escape(missing)}</p>\n" if missing else ""
    return figure(caption, draw(data))
