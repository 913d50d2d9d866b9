# SPDX-License-Identifier: MIT
"""The case study's table as plain text, for a terminal."""

import math
from collections.abc import Sequence

from segway_ecc.hil.case_study.study import Cell, Seat, difference, worst_difference, worst_thesis_difference
from segway_ecc.hil.text_table import aligned

NOT_RUN = "not run"
"""What stands where a seat has no position for a cell."""

_THESIS_DECIMALS = 2
# A millimetre keeps four seats within about 100 characters; the difference keeps a tenth of it.
_SEAT_DECIMALS = 3

_Position = tuple[float, float]


def table(study_cells: Sequence[Cell], seats: Sequence[Seat]) -> str:
    """Lay out the cells as aligned text.

    Args:
        study_cells: The cells, one row each.
        seats: The seats to show, in order.

    Returns:
        Lines of text: the set-points (m/s, rad/s), the positions (m) the thesis printed and each seat that ran
        reached, the worst difference (m) of these from the thesis' offline table, then one line per seat with its own.
    """
    cells = list(study_cells)
    columns = [
        ("", "m/s", [f"{cell.linear:g}" for cell in cells]),
        ("", "rad/s", [f"{cell.angular:g}" for cell in cells]),
        ("thesis", "offline, m", _pairs([cell.thesis_offline for cell in cells], _THESIS_DECIMALS)),
        ("thesis", "ROS, m", _pairs([cell.thesis_ros for cell in cells], _THESIS_DECIMALS)),
    ]
    columns += [
        (seat, "x y, m", _pairs([cell.positions.get(seat) for cell in cells], _SEAT_DECIMALS))
        for seat in seats
        if any(seat in cell.positions for cell in cells)
    ]
    ran = [[difference(c.positions[s], c.thesis_offline) for s in seats if s in c.positions] for c in cells]
    columns.append(("worst", "diff, m", [f"{max(each):.4f}" if each else NOT_RUN for each in ran]))
    ruled = [(*head, "-" * max(map(len, (*head, *values))), *values) for *head, values in columns]
    width = max(map(len, seats), default=0)
    heading = "Worst difference from the thesis' offline table"
    if cells:
        heading += f" (the thesis' own ROS run: {worst_thesis_difference(cells):.2f} m)"
    summary = [heading + ":", *(f"{seat:<{width}}  {worst_text(cells, seat)}" for seat in seats)]
    return "\n".join([*aligned(list(zip(*ruled, strict=True)), left=0), "", *summary]) + "\n"


def difference_text(cell: Cell, seat: Seat) -> str:
    """The difference (m) of a seat from the thesis' offline table in one cell, or that it did not run."""
    if seat not in cell.positions:
        return NOT_RUN
    return f"{difference(cell.positions[seat], cell.thesis_offline):.4f}"


def worst_text(cells: Sequence[Cell], seat: Seat) -> str:
    """The worst difference of a seat with its unit, m, or that it did not run."""
    worst = worst_difference(cells, seat)
    return "did not run" if math.isnan(worst) else f"{worst:.4f} m"


def _pairs(positions: Sequence[_Position | None], decimals: int) -> list[str]:
    """Positions with their x below each other and their y below each other."""
    # "z": a position of -0.0 is printed as 0.
    texts = [p and (f"{p[0]:z.{decimals}f}", f"{p[1]:z.{decimals}f}") for p in positions]
    x_width = max((len(text[0]) for text in texts if text), default=0)
    y_width = max((len(text[1]) for text in texts if text), default=0)
    return [f"{text[0]:>{x_width}} {text[1]:>{y_width}}" if text else NOT_RUN for text in texts]
