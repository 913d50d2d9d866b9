# SPDX-License-Identifier: MIT
"""Where the three parts of control run, what the study finds for each such choice, and which one is recommended.

And all of that as tables of text.
"""

import enum
import itertools
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import msgspec

from segway_ecc.hil.placement.judging import UPRIGHT, RunOutcome
from segway_ecc.hil.text_table import aligned

POSITION_M: Final = 0.1
"""Farther than that from where it is with everything on the robot, a placement does not follow its set-points."""
STOP_S: Final = 0.5
"""A stop that takes longer to zero torque is none."""
NOTHING: Final = "-"
BOUNDS: Final = "Limits of balance control on the station"
UNSTAMPED: Final = "cmd_vel"
STAMPED: Final = "cmd_vel_stamped"


@enum.unique
class Site(enum.StrEnum):
    """One end of the network."""

    ROBOT = "robot"
    STATION = "station"


class Placement(NamedTuple):
    """Where each part runs. Drives, their watchdogs, sensors and the guard are on the robot.

    Attributes:
        sequence: Sequence control: who sends set-points.
        balance: Balance control: the model node.
        supervision: Supervision: heartbeats, and the stop button.
        setpoints: On which topic set-points travel; empty where they do not cross the network.
    """

    sequence: Site
    balance: Site
    supervision: Site
    setpoints: str = ""

    @property
    def sequence_crosses(self) -> bool:
        """Whether set-points cross the network to the model node."""
        return self.sequence is not self.balance

    @property
    def balance_crosses(self) -> bool:
        """Whether what is measured, and the commands, cross the network."""
        return self.balance is Site.STATION

    @property
    def supervision_crosses(self) -> bool:
        """Whether heartbeats and the stop cross the network to the model node."""
        return self.supervision is not self.balance

    @property
    def at_station(self) -> int:
        """How many of the three are on the base station."""
        return self[:3].count(Site.STATION)

    @property
    def stamped(self) -> bool:
        """Whether set-points are sent ahead, with their time."""
        return self.setpoints != UNSTAMPED

    @property
    def rank(self) -> tuple[int, bool, bool]:
        """The highest that is fit is recommended: most on the station, then supervision there, where people are."""
        return self.at_station, self.supervision is Site.STATION, self.setpoints == STAMPED

    def __str__(self) -> str:
        """Who is where, in words."""
        away = [name for name, site in zip(self._fields, self[:3], strict=False) if site is Site.STATION]
        where = f"{' and '.join(away)} on the station" if away else "all on the robot"
        return f"{where}, {self.setpoints}" if self.setpoints else where


PLACEMENTS: Final = tuple(itertools.starmap(Placement, itertools.product(Site, repeat=3)))
"""All there are; the first has everything on the robot."""
ON_THE_ROBOT: Final = PLACEMENTS[0]


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Which cell of the grid: a placement, see `Placement`, on a network."""

    sequence: Site
    balance: Site
    supervision: Site
    network: str
    setpoints: str = ""

    @property
    def placement(self) -> Placement:
        """The placement, with the way its set-points travel."""
        return Placement(self.sequence, self.balance, self.supervision, self.setpoints)


class Drive(Row, frozen=True, kw_only=True):
    """A manoeuvre, against the same with everything on the robot.

    Attributes:
        reason: The first reason that was given for anything but driving on.
        max_velocity_m_s: Largest difference of the velocity ahead, m/s.
        rms_velocity_m_s: Its root mean square, m/s.
        digest: Over everything that the drives gave and all truth: equal digests are equal bits.
    """

    outcome: RunOutcome
    reason: str
    max_position_m: float
    rms_position_m: float
    max_velocity_m_s: float
    rms_velocity_m_s: float
    max_tilt_rad: float
    digest: str


class Stop(Row, frozen=True, kw_only=True):
    """A stop that was pressed while it drove; the outcome is the worst that had come of the robot before a press.

    `zero_s` is from each press to the last torque, s; None where the robot lay before, or the torque went on.
    """

    zero_s: tuple[float | None, ...]
    outcome: RunOutcome

    @property
    def worst_s(self) -> float | None:
        """The longest; None where one press did nothing."""
        times = [time_s for time_s in self.zero_s if time_s is not None]
        return max(times) if len(times) == len(self.zero_s) else None


class Cut(Row, frozen=True, kw_only=True):
    """A partition while it drove; `did` is what the robot did by itself, with how long after the partition began.

    `max_position_m` is the largest distance from the robot without a network, m.
    """

    partition_s: float
    outcome: RunOutcome
    did: str
    max_position_m: float
    max_tilt_rad: float


class Bound(msgspec.Struct, frozen=True, kw_only=True):
    """A limit of balance control on the station, by search.

    Attributes:
        tolerated: The largest that was tolerated with every seed.
        lost: The smallest that was not; None where the largest tried was tolerated.
        lost_by: What the robot gave as reason then.
        theory: What theory gives for it; None where it gives nothing.
    """

    robot: str
    what: str
    unit: str
    tolerated: float
    lost: float | None
    lost_by: str
    theory: float | None = None


class StudyResult(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that the study found."""

    drives: tuple[Drive, ...]
    stops: tuple[Stop, ...]
    cuts: tuple[Cut, ...]
    bounds: tuple[Bound, ...]


def placements(found: StudyResult) -> list[Placement]:
    """All that were studied, in their order."""
    return list(dict.fromkeys(row.placement for row in found.drives))


def network_names(found: StudyResult) -> list[str]:
    """The networks on which was driven, in their order."""
    return list(dict.fromkeys(row.network for row in found.drives))


def unfit(found: StudyResult, placement: Placement, network: str) -> list[str]:
    """What speaks against a placement on a network; empty where it is fit."""
    reasons = []
    for drive in (row for row in found.drives if row.placement == placement and row.network == network):
        if drive.outcome is not RunOutcome.DROVE_ON:
            reasons.append(drive.outcome.value)
        elif drive.max_position_m > POSITION_M:
            reasons.append(f"{drive.max_position_m:.2f} m off")
    # On the stop, the kind of set-points has no influence.
    stop = next((row for row in found.stops if row.placement[:3] == placement[:3] and row.network == network), None)
    if stop is not None and (stop.worst_s is None or stop.worst_s > STOP_S) and stop.outcome in UPRIGHT:
        reasons.append("no stop" if stop.worst_s is None else f"stops after {stop.worst_s:.2f} s")
    cuts = (cut for cut in found.cuts if cut.placement == placement and cut.outcome not in UPRIGHT)
    reasons += [f"falls in a partition of {cut.partition_s:g} s" for cut in itertools.islice(cuts, 1)]
    return reasons


def recommended(found: StudyResult, network: str) -> Placement | None:
    """Of the placements that are fit on a network, the one of the highest rank; None where none is fit."""
    fit = [each for each in placements(found) if not unfit(found, each, network)]
    return max(fit, key=lambda each: each.rank, default=None)


def overall(found: StudyResult) -> Placement | None:
    """The placement that is fit on the most networks, and of several the one of the highest rank."""
    networks = network_names(found)
    fit_on = {p: sum(not unfit(found, p, network) for network in networks) for p in placements(found)}
    best = max(fit_on, key=lambda each: (fit_on[each], each.rank), default=None)
    return best if best is not None and fit_on[best] else None


class Table(NamedTuple):
    """A table whose first columns identify its rows."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


_WHICH: Final = ("sequence", "balance", "supervision", "set-points on")


def tables(found: StudyResult) -> list[Table]:
    """Everything, as tables."""
    stops = {(s.placement, s.network): NOTHING if s.worst_s is None else f"{s.worst_s * 1e3:.0f}" for s in found.stops}
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
        _pivot(found, "From pressing stop to zero torque, the longest of all presses, ms", stops),
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

    return _pivot(found, title, {(d.placement, d.network): cell(d) for d in found.drives})


def _pivot(found: StudyResult, title: str, cells: dict[tuple[Placement, str], str]) -> Table:
    """A row for each placement, a column for each network; `cells` are by placement and name of the network."""
    networks, shown = network_names(found), list(dict.fromkeys(placement for placement, _ in cells))
    rows = [[*placement, *(cells.get((placement, name), NOTHING) for name in networks)] for placement in shown]
    return Table(title, (*_WHICH, *networks), [_marked(row) for row in rows])


def _marked(row: Sequence[str]) -> Sequence[str]:
    """A row with a mark where set-points cross no network."""
    return [text or NOTHING for text in row]
