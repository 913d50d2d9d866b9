"""What the placement study found, as tables of text."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.placement.judging import RunOutcome
from segway_ecc.hil.placement.results import Bound, Drive, Row, StudyResult
from segway_ecc.hil.placement.verdict import Choice, choice_of, choices, network_names, overall, recommended

NOTHING: Final = "-"


class Table(NamedTuple):
    """A table.

    Attributes:
        title: What it shows.
        head: The head of each column.
        rows: Its rows; the first columns identify them.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


_WHICH: Final = ("sequence", "balance", "supervision", "set-points on")


def tables(found: StudyResult) -> list[Table]:
    """Everything, as tables."""
    return [
        _drives(found, "Largest distance from the robot with all control on board, m", lambda d: d.max_position_m),
        _drives(found, "Its root mean square, m", lambda d: d.rms_position_m),
        _drives(found, "Largest difference of the velocity ahead, m/s", lambda d: d.max_velocity_m_s),
        _drives(found, "Its root mean square, m/s", lambda d: d.rms_velocity_m_s),
        _drives(found, "Largest tilt, rad", lambda d: d.max_tilt_rad),
        _stops(found),
        _cuts(found),
        _bounds(found.bounds),
        _recommended(found),
    ]


def text(found: StudyResult) -> str:
    """All tables, for a terminal."""
    return "\n".join(_laid_out(table) for table in tables(found) if table.rows)


def bound_text(bound: Bound) -> tuple[str, str, str]:
    """What was tolerated, what was not, and what theory gives."""
    scale, unit = (1e3, "ms") if bound.unit == "s" else (100.0, "%")
    lost = "more than was tried" if bound.lost is None else f"{bound.lost * scale:.4g} {unit}"
    theory = NOTHING if bound.theory is None else f"{bound.theory * scale:.1f} {unit}"
    return f"{bound.borne * scale:.4g} {unit}", lost, theory


def _drives(found: StudyResult, title: str, value: Callable[[Drive], float]) -> Table:
    def cell(drive: Drive) -> str:
        is_up = drive.outcome not in (RunOutcome.FELL, RunOutcome.NEVER_STOOD, RunOutcome.NEVER_ARMED)
        held = "" if drive.outcome is RunOutcome.DROVE_ON else f" {drive.outcome}"
        return f"{value(drive):.3f}{held}" if is_up else drive.outcome.value

    return _pivot(title, network_names(found), choices(found), {_key(d): cell(d) for d in found.drives})


def _stops(found: StudyResult) -> Table:
    title = "From pressing stop to zero torque, the longest of all presses, ms"
    cells = {_key(s): NOTHING if s.worst_s is None else f"{s.worst_s * 1e3:.0f}" for s in found.stops}
    shown = list(dict.fromkeys(choice_of(row) for row in found.stops))
    return _pivot(title, network_names(found), shown, cells)


def _cuts(found: StudyResult) -> Table:
    rows = [
        (*choice_of(c), f"{c.partition_s:g}", c.outcome.value, f"{c.max_position_m:.2f}", c.did)
        for c in sorted(found.cuts, key=lambda c: (c.partition_s,))
    ]
    head = (*_WHICH, "s", "outcome", "off, m", "what the robot did by itself")
    return Table("Partitions while it drives", head, [_which(row) for row in rows])


def _bounds(bounds: Sequence[Bound]) -> Table:
    rows = [(b.robot, b.what, *bound_text(b), b.lost_by) for b in bounds]
    head = ("robot", "of what", "borne", "lost", "theory", "lost by")
    return Table("What balance control on the station bears", head, rows)


def _recommended(found: StudyResult) -> Table:
    rows = [(name, str(recommended(found, name) or "none is fit")) for name in network_names(found)]
    best = overall(found)
    return Table("Recommended placement", ("network", "placement"), [*rows, ("all", str(best or "none is fit"))])


def _pivot(title: str, networks: Sequence[str], shown: Sequence[Choice], cells: dict[tuple[Choice, str], str]) -> Table:
    """A row for each choice, a column for each network."""
    rows = [[*choice, *(cells.get((choice, name), NOTHING) for name in networks)] for choice in shown]
    return Table(title, (*_WHICH, *networks), [_which(row) for row in rows])


def _which(row: Sequence[str]) -> Sequence[str]:
    """A row with a mark where set-points cross no network."""
    return [text or NOTHING for text in row]


def _key(row: Row) -> tuple[Choice, str]:
    return choice_of(row), row.network


def _laid_out(table: Table) -> str:
    widths = [max(map(len, column)) for column in zip(table.head, *table.rows, strict=True)]
    lines = [
        "  ".join(f"{t:<{w}}" for t, w in zip(row, widths, strict=True)).rstrip() for row in (table.head, *table.rows)
    ]
    return f"{table.title}\n" + "".join(f"  {line}\n" for line in lines)
