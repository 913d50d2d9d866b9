# SPDX-License-Identifier: MIT
"""The growth study: sizes on four axes, each measured; for each axis where it stops being linear; and both as text."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from segway_ecc.hil.growth import lock_step, real
from segway_ecc.hil.growth.cost import Axis, LinearFit, Measured, Point, line, together
from segway_ecc.hil.progress import OnProgress
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.ros.runtime import missing_packages

Measure = Callable[[int], Point]
SIZES: Final[Mapping[Axis, Sequence[int]]] = {
    Axis.PORTS: (2, 16, 64, 128, 256, 512, 1024, 2048, 8192),
    Axis.DRIVES: (2, 4, 6, 8, 10, 12, 14, 16, 18),
    Axis.SUBSCRIBERS: (0, 2, 4, 8, 16),
    Axis.ROBOTS: (1, 2, 4, 8),
}
QUICK: Final[Mapping[Axis, Sequence[int]]] = {Axis.PORTS: (2, 64, 256, 1024), Axis.DRIVES: (2, 4, 8, 16)}
"""What takes some seconds, and needs no ROS."""
MEASURES: Final[Mapping[Axis, Measure]] = {
    Axis.PORTS: lock_step.measure_ports,
    Axis.DRIVES: lock_step.measure_drives,
    Axis.SUBSCRIBERS: real.subscribers,
    Axis.ROBOTS: real.robots,
}
_WITH_ROS: Final = (Axis.SUBSCRIBERS, Axis.ROBOTS)
_HEAD: Final = ("p50, us", "p99, us", "spread, us", "line, us")
_ROUNDS: Final = dict.fromkeys(_WITH_ROS, 2)
"""In real time a machine's other work comes and goes: every size is run again after all of them were run."""


class AxisResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one axis.

    Attributes:
        line: The line through the small sizes; None where fewer than three could be run.
    """

    axis: Axis
    points: tuple[Point, ...]
    line: LinearFit | None

    @property
    def refused(self) -> Point | None:
        """The first size that does not run."""
        return next((point for point in self.points if point.cost is None), None)


def conduct(
    sizes: Mapping[Axis, Sequence[int]], on_progress: OnProgress, measures: Mapping[Axis, Measure] = MEASURES
) -> list[AxisResult]:
    """Measure every size; those axes that need ROS are left out where it is not there.

    Raises:
        RigError: A process failed.
    """
    axes = [axis for axis in sizes if axis not in _WITH_ROS or not missing_packages()]
    todo = [(axis, size) for axis in axes for size in list(sizes[axis]) * _ROUNDS.get(axis, 1)]
    points: dict[tuple[Axis, int], list[Point]] = {}
    for done, (axis, size) in enumerate(todo, 1):
        points.setdefault((axis, size), []).append(measures[axis](size))
        on_progress(done, len(todo))
    whole = {}
    for key, rounds in points.items():  # a size that does not run in one round never does
        costs = [point.cost for point in rounds if point.cost is not None]
        whole[key] = msgspec.structs.replace(rounds[-1], cost=together(costs)) if costs else rounds[-1]
    return [grown(axis, [whole[axis, size] for size in sizes[axis]]) for axis in axes]


def grown(axis: Axis, points: Sequence[Point]) -> AxisResult:
    """Lay the line through what was measured on an axis."""
    measured = [Measured(p.size, p.cost.p50_us, p.cost.spread_us) for p in points if p.cost is not None]
    return AxisResult(axis=axis, points=tuple(points), line=line(measured) if len(measured) >= 3 else None)  # noqa: PLR2004 - a line's least


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
    made = [[str(grown.axis), *_HEAD, *notes]]
    for point in grown.points:
        cost = point.cost
        if cost is None:
            made.append([str(point.size), *["-"] * (len(_HEAD) + len(notes))])
            continue
        at = "-" if grown.line is None else f"{grown.line(point.size):.1f}"
        figures = [f"{cost.p50_us:.1f}", f"{cost.p99_us:.1f}", f"{cost.spread_us:.1f}", at]
        made.append([str(point.size), *figures, *(cost.notes.get(name, "-") for name in notes)])
    return made
