# SPDX-License-Identifier: MIT
"""The growth study: sizes on four axes, each measured, and for each axis where it stops being linear."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from segway_ecc.hil.growth import drives, ports, real
from segway_ecc.hil.growth.cost import Axis, Point, together
from segway_ecc.hil.growth.linear import LinearFit, Measured, line
from segway_ecc.hil.progress import OnProgress
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
    Axis.PORTS: ports.measure,
    Axis.DRIVES: drives.measure,
    Axis.SUBSCRIBERS: real.subscribers,
    Axis.ROBOTS: real.robots,
}
_WITH_ROS: Final = (Axis.SUBSCRIBERS, Axis.ROBOTS)
_ROUNDS: Final = dict.fromkeys(_WITH_ROS, 2)
"""In real time a machine's other work comes and goes: every size is run again after all of them were run."""


class AxisResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one axis.

    Attributes:
        axis: What grew.
        points: Each size.
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
