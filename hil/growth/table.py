# SPDX-License-Identifier: MIT
"""What the growth study found, as text."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.hil.growth.study import AxisResult
from segway_ecc.hil.text_table import aligned

HEAD: Final = ("p50, us", "p99, us", "spread, us", "line, us")


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
    made = [[str(grown.axis), *HEAD, *notes]]
    for point in grown.points:
        cost = point.cost
        if cost is None:
            made.append([str(point.size), *["-"] * (len(HEAD) + len(notes))])
            continue
        at = "-" if grown.line is None else f"{grown.line(point.size):.1f}"
        figures = [f"{cost.p50_us:.1f}", f"{cost.p99_us:.1f}", f"{cost.spread_us:.1f}", at]
        made.append([str(point.size), *figures, *(cost.notes.get(name, "-") for name in notes)])
    return made
