# SPDX-License-Identifier: MIT
"""What the placement study found, as tables of text."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.placement.judging import RunOutcome
from segway_ecc.hil.placement.results import (
    Bound,
    Drive,
    Placement,
    Row,
    StudyResult,
    network_names,
    overall,
    placements,
    recommended,
)
from segway_ecc.hil.text_table import aligned

NOTHING: Final = "-"
BOUNDS: Final = "Limits of balance control on the station"


class Table(NamedTuple):
    """A table.

    Attributes:
        rows: Its rows; the first columns identify them.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


_Cell = tuple[Placement, str]
"""A placement, and the name of a network."""
_WHICH: Final = ("sequence", "balance", "supervision", "set-points on")


def tables(found: StudyResult) -> list[Table]:
    """Everything, as tables."""
    stops = {_key(s): NOTHING if s.worst_s is None else f"{s.worst_s * 1e3:.0f}" for s in found.stops}
    stopped = list(dict.fromkeys(row.placement for row in found.stops))
    cuts = [
        _marked((*c.placement, f"{c.partition_s:g}", c.outcome.value, f"{c.max_position_m:.2f}", c.did))
        for c in sorted(found.cuts, key=lambda c: (c.partition_s,))
    ]
    bounds = [(b.robot, b.what, *bound_text(b), b.lost_by) for b in found.bounds]
    best = [(name, str(recommended(found, name) or "none is fit")) for name in network_names(found)]
    best.append(("all", str(overall(found) or "none is fit")))
    return [
        _drives(found, "Largest distance from the robot with all control on board, m", lambda d: d.max_position_m),
        _drives(found, "Its root mean square, m", lambda d: d.rms_position_m),
        _drives(found, "Largest difference of the velocity ahead, m/s", lambda d: d.max_velocity_m_s),
        _drives(found, "Its root mean square, m/s", lambda d: d.rms_velocity_m_s),
        _drives(found, "Largest tilt, rad", lambda d: d.max_tilt_rad),
        _pivot(
            "From pressing stop to zero torque, the longest of all presses, ms", network_names(found), stopped, stops
        ),
        Table("Partitions while it drives", (*_WHICH, "s", "outcome", "off, m", "what the robot did by itself"), cuts),
        Table(BOUNDS, ("robot", "of what", "tolerated", "lost", "theory", "lost by"), bounds),
        Table("Recommended placement", ("network", "placement"), best),
    ]


def text(found: StudyResult) -> str:
    """All tables, for a terminal."""
    shown = [(table.title, *aligned([table.head, *table.rows])) for table in tables(found) if table.rows]
    return "\n".join("\n  ".join(lines) + "\n" for lines in shown)


def bound_text(bound: Bound) -> tuple[str, str, str]:
    """What was tolerated, what was not, and what theory gives."""
    scale, unit = (1e3, "ms") if bound.unit == "s" else (100.0, "%")
    lost = "more than was tried" if bound.lost is None else f"{bound.lost * scale:.4g} {unit}"
    theory = NOTHING if bound.theory is None else f"{bound.theory * scale:.1f} {unit}"
    return f"{bound.tolerated * scale:.4g} {unit}", lost, theory


def _drives(found: StudyResult, title: str, value: Callable[[Drive], float]) -> Table:
    def cell(drive: Drive) -> str:
        is_up = drive.outcome not in (RunOutcome.FELL, RunOutcome.NEVER_STOOD, RunOutcome.NEVER_ARMED)
        held = "" if drive.outcome is RunOutcome.DROVE_ON else f" {drive.outcome}"
        return f"{value(drive):.3f}{held}" if is_up else drive.outcome.value

    return _pivot(title, network_names(found), placements(found), {_key(d): cell(d) for d in found.drives})


def _pivot(
    title: str, networks: Sequence[str], shown: Sequence[Placement], cells: dict[tuple[Placement, str], str]
) -> Table:
    """A row for each placement, a column for each network."""
    rows = [[*placement, *(cells.get((placement, name), NOTHING) for name in networks)] for placement in shown]
    return Table(title, (*_WHICH, *networks), [_marked(row) for row in rows])


def _marked(row: Sequence[str]) -> Sequence[str]:
    """A row with a mark where set-points cross no network."""
    return [text or NOTHING for text in row]


def _key(row: Row) -> _Cell:
    return row.placement, row.network
