"""The case study's table as plain text, for a terminal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from segway_ecc.hil.case_study.study import Cell, Seat, difference, worst_difference, worst_thesis_difference

NOT_RUN = "not run"
"""What stands where a seat has no position for a cell."""

_GAP = "  "
_THESIS_DECIMALS = 2
# A millimetre keeps four seats within about 100 characters; the difference keeps a tenth of it.
_SEAT_DECIMALS = 3

_Position = tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Column:
    """One column: two lines of heading and a value per cell."""

    heading: tuple[str, str]
    values: Sequence[str]

    def lines(self) -> list[str]:
        """Heading, rule and values, all of the same width."""
        width = max(map(len, (*self.heading, *self.values)))
        return [text.rjust(width) for text in (*self.heading, "-" * width, *self.values)]


def table(study_cells: Sequence[Cell], seats: Sequence[Seat]) -> str:
    """Lay out the cells as aligned text.

    Args:
        study_cells: The cells, one row each.
        seats: The seats to show, in order.

    Returns:
        Lines of text: the set-points (m/s, rad/s), the positions (m) the thesis printed and each seat that ran
        reached, the worst difference (m) of these from the thesis' offline table, then one line per seat with its own.
    """
    columns = [column.lines() for column in _columns(study_cells, seats)]
    rows = [_GAP.join(fields).rstrip() for fields in zip(*columns, strict=True)]
    return "\n".join([*rows, "", *_summary(study_cells, seats)]) + "\n"


def difference_text(cell: Cell, seat: Seat) -> str:
    """The difference (m) of a seat from the thesis' offline table in one cell, or that it did not run."""
    if seat not in cell.positions:
        return NOT_RUN
    return f"{difference(cell.positions[seat], cell.thesis_offline):.4f}"


def worst_text(cells: Sequence[Cell], seat: Seat) -> str:
    """The worst difference of a seat with its unit, m, or that it did not run."""
    worst = worst_difference(cells, seat)
    return "did not run" if math.isnan(worst) else f"{worst:.4f} m"


def _columns(cells: Sequence[Cell], seats: Sequence[Seat]) -> list[_Column]:
    return [
        _Column(("", "m/s"), [f"{cell.linear:g}" for cell in cells]),
        _Column(("", "rad/s"), [f"{cell.angular:g}" for cell in cells]),
        _Column(("thesis", "offline, m"), _pairs([cell.thesis_offline for cell in cells], _THESIS_DECIMALS)),
        _Column(("thesis", "ROS, m"), _pairs([cell.thesis_ros for cell in cells], _THESIS_DECIMALS)),
        *(_position_column(cells, seat) for seat in seats if any(seat in cell.positions for cell in cells)),
        _Column(("worst", "diff, m"), [_worst_of_cell(cell, seats) for cell in cells]),
    ]


def _worst_of_cell(cell: Cell, seats: Sequence[Seat]) -> str:
    ran = [cell.positions[seat] for seat in seats if seat in cell.positions]
    return f"{max(difference(p, cell.thesis_offline) for p in ran):.4f}" if ran else NOT_RUN


def _position_column(cells: Sequence[Cell], seat: Seat) -> _Column:
    return _Column((seat, "x y, m"), _pairs([cell.positions.get(seat) for cell in cells], _SEAT_DECIMALS))


def _pairs(positions: Sequence[_Position | None], decimals: int) -> list[str]:
    """Positions with their x below each other and their y below each other."""
    # "z": a position of -0.0 is printed as 0.
    texts = [p and (f"{p[0]:z.{decimals}f}", f"{p[1]:z.{decimals}f}") for p in positions]
    x_width = max((len(text[0]) for text in texts if text), default=0)
    y_width = max((len(text[1]) for text in texts if text), default=0)
    return [f"{text[0]:>{x_width}} {text[1]:>{y_width}}" if text else NOT_RUN for text in texts]


def _summary(cells: Sequence[Cell], seats: Sequence[Seat]) -> list[str]:
    width = max(map(len, seats), default=0)
    heading = "Worst difference from the thesis' offline table"
    if cells:
        heading += f" (the thesis' own ROS run: {worst_thesis_difference(cells):.2f} m)"
    return [heading + ":", *(f"{seat:<{width}}{_GAP}{worst_text(cells, seat)}" for seat in seats)]
