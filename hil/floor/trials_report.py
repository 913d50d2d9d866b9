# SPDX-License-Identifier: MIT
"""What came of trials on a floor: for each the share of its seeds that stood, as a table and as a figure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from segway_ecc.hil.figure import png
from segway_ecc.hil.floor.run import Ending, FloorResult
from segway_ecc.hil.text_table import aligned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS: Final = {Ending.STANDS: "#2e6f9e", Ending.SAFE: "#c9c9c9", Ending.BROKEN: "#b3261e"}
_REASON: Final = 60
"""Of a reason's letters in the table."""
Before = Mapping[tuple[str, str], float]
"""Of an earlier run: by robot and trial the share that stood, percent."""


class TrialRow(NamedTuple):
    """A trial of a robot, or a group of them: how many runs, how they ended, and the reasons, most frequent first."""

    robot: str
    name: str
    kind: str
    endings: Mapping[Ending, int]
    reasons: tuple[str, ...]

    @property
    def runs(self) -> int:
        """How many there are."""
        return sum(self.endings.values())

    def percent(self, ending: Ending) -> float:
        """How many of them ended so, percent."""
        return 100.0 * self.endings.get(ending, 0) / self.runs


def rows_of(results: Sequence[FloorResult]) -> list[TrialRow]:
    """A row for each trial of each robot, in the order of the results."""
    grouped: dict[tuple[str, str], list[FloorResult]] = {}
    for result in results:
        grouped.setdefault((result.robot, result.trial), []).append(result)
    return [_row(robot, name, found[0].kind, found) for (robot, name), found in grouped.items()]


def totals_of(results: Sequence[FloorResult]) -> list[TrialRow]:
    """A row for each kind of trial of each robot, and one for all of the robot."""
    grouped: dict[tuple[str, str], list[FloorResult]] = {}
    for result in results:
        grouped.setdefault((result.robot, result.kind), []).append(result)
    for result in results:
        grouped.setdefault((result.robot, "all"), []).append(result)
    return [_row(robot, kind, kind, found) for (robot, kind), found in sorted(grouped.items(), key=lambda g: g[0][0])]


def before_of(document: Mapping[str, Any]) -> Before:
    """What stood in an earlier run, from its JSON."""
    return {(row["robot"], row["trial"]): float(row["stands_percent"]) for row in document["trials"]}


def as_document(results: Sequence[FloorResult], before: Before) -> dict[str, Any]:
    """Everything, for JSON."""
    return {
        "trials": [_as_json(row, before) for row in rows_of(results)],
        "totals": [_as_json(row, _before_totals(results, before)) for row in totals_of(results)],
        "runs": list(results),
    }


def as_text(results: Sequence[FloorResult], before: Before) -> str:
    """Both tables; with the share before, where there is an earlier run."""
    text = [*_lines("trial", rows_of(results), before), ""]
    text += _lines("all trials of a kind", totals_of(results), _before_totals(results, before))
    return "".join(f"{line}\n" for line in text)


def draw(results: Sequence[FloorResult], title: str) -> Mapping[str, bytes]:
    """The figure: a bar for each trial, by the name of its file."""
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra that all but figures does without

    rows = rows_of(results)
    half = -(-len(rows) // 2)

    def drawn(figure: "Figure") -> None:
        figure.suptitle(title)
        axes = figure.subplots(1, 2)
        for axis, shown in zip(axes, (rows[:half], rows[half:]), strict=True):
            if shown:
                _draw_bars(axis, shown)
            axis.set_visible(bool(shown))
        handles = [Patch(color=colour, label=ending.value) for ending, colour in _COLOURS.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))

    return {"floor.png": png((13.0, 1.5 + 0.24 * half), drawn, font_size=8.5)}


def _row(robot: str, name: str, kind: str, results: Sequence[FloorResult]) -> TrialRow:
    reasons = Counter(result.reason for result in results if result.reason)
    return TrialRow(
        robot, name, kind, Counter(r.ending for r in results), tuple(text for text, _ in reasons.most_common())
    )


def _as_json(row: TrialRow, before: Before) -> dict[str, Any]:
    return {
        "robot": row.robot,
        "trial": row.name,
        "kind": row.kind,
        "runs": row.runs,
        "stands_percent": row.percent(Ending.STANDS),
        "ends_safe_percent": row.percent(Ending.SAFE),
        "broken": row.endings.get(Ending.BROKEN, 0),
        "before_percent": before.get((row.robot, row.name)),
        "reasons": list(row.reasons),
    }


def _before_totals(results: Sequence[FloorResult], before: Before) -> Before:
    """The mean of the trials of each kind, where all of them were there before."""
    totals: dict[tuple[str, str], list[float | None]] = {}
    for row in rows_of(results):
        for name in (row.kind, "all"):
            totals.setdefault((row.robot, name), []).append(before.get((row.robot, row.name)))
    complete = {key: [share for share in shares if share is not None] for key, shares in totals.items()}
    return {key: sum(shares) / len(shares) for key, shares in complete.items() if len(shares) == len(totals[key])}


def _lines(what: str, rows: Sequence[TrialRow], before: Before) -> list[str]:
    earlier = ("before, %",) if before else ()
    head = (what, "robot", "runs", *earlier, "stands, %", "ends safe, %", "BROKEN", "most frequent reason")
    return aligned([head, *(_cells(row, before) for row in rows)])


def _cells(row: TrialRow, before: Before) -> tuple[str, ...]:
    share = before.get((row.robot, row.name))
    earlier = ("-" if share is None else f"{share:.0f}",) if before else ()
    reason = row.reasons[0] if row.reasons and row.name not in {row.kind, "all"} else ""
    return (
        *(row.name, row.robot, str(row.runs), *earlier),
        *(f"{row.percent(ending):.0f}" for ending in (Ending.STANDS, Ending.SAFE)),
        str(row.endings.get(Ending.BROKEN, 0)),
        reason if len(reason) <= _REASON else f"{reason[: _REASON - 3]}...",
    )


def _draw_bars(axis: "Axes", rows: Sequence[TrialRow]) -> None:
    places, robots = range(len(rows)), {row.robot for row in rows}
    left = [0.0] * len(rows)
    for ending, colour in _COLOURS.items():
        shares = [row.percent(ending) for row in rows]
        axis.barh(places, shares, left=left, color=colour, height=0.8)
        left = [sum(both) for both in zip(left, shares, strict=True)]
    axis.set_yticks(places, [row.name if len(robots) == 1 else f"{row.robot}: {row.name}" for row in rows])
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.set_xlim(0.0, 100.0)
    axis.set_xlabel("of the seeds, %")
