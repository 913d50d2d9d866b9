# SPDX-License-Identifier: MIT
"""The placement study as a web page of its own, which loads nothing from elsewhere."""

from collections.abc import Mapping
from html import escape
from typing import Final

from segway_ecc.hil.page import figure, page, pairs, section, table, table_row
from segway_ecc.hil.placement import figures
from segway_ecc.hil.placement.results import StudyResult
from segway_ecc.hil.placement.table import BOUNDS, tables
from segway_ecc.hil.placement.verdict import POSITION_M, STOP_S, overall

_TITLE: Final = "Where to place the parts of control"
_INTRODUCTION: Final = (
    "Sequence control, balance control and supervision, each on the robot or on the base station, with a simulated "
    "network between them: plant, drives, guard, node and network run in lock step. Drives, their watchdogs, sensors "
    "and the guard are always on the robot. What stays within one place crosses no network."
)


def render(found: StudyResult, facts: Mapping[str, str]) -> str:
    """Render what was found, as a complete HTML page.

    Args:
        found: Everything that was found.
        facts: What else is known of the study, by name.
    """
    rule = (
        f"Fit is what neither falls nor holds while the network lasts, stays within {POSITION_M:g} m of the robot with "
        f"all control on board, stops within {STOP_S:g} s, and does not fall in a partition. Recommended is, of those "
        "that are fit on the most networks, the one with the most on the station."
    )
    best = str(overall(found) or "none is fit")
    drawn = {
        "How far off each placement is. Red: it fell, never stood up, or is too far off.": figures.distances,
        "From stop to zero torque, the longest of all presses. Dashed: what is allowed.": figures.stops,
        f"{BOUNDS}, by search; the mark is what theory gives.": figures.bounds,
    }
    shown = "".join(figure(caption, draw(found)) for caption, draw in drawn.items()) if found.drives else ""
    sections = (
        section("Verdict", f"<p>Recommended: <strong>{escape(best)}</strong>.</p>\n<p>{escape(rule)}</p>\n"),
        section("Figures", shown) if shown else "",
        *(section(t.title, table(t.title, t.head, map(table_row, t.rows))) for t in tables(found) if t.rows),
        section("Facts of this study", pairs(facts)),
    )
    return page(_TITLE, _INTRODUCTION, sections)
