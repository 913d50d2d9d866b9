# SPDX-License-Identifier: MIT
"""What the case study is, what a run of it yields, and its table as plain text."""

import enum
import importlib.resources
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from segway_ecc.hil.text_table import aligned

NOT_RUN = "not run"
"""What stands where a seat has no position for a cell."""

_THESIS_DECIMALS = 2
# A millimetre keeps four seats within about 100 characters; the difference keeps a tenth of it.
_SEAT_DECIMALS = 3


@enum.unique
class Seat(enum.StrEnum):
    """Where the model runs."""

    OFFLINE = "offline"
    """In this process, as fast as it goes."""
    SUBMODEL = "submodel"
    """The same, with the cart as a C submodel in the shape that 20-sim writes, compiled and loaded."""
    ROS = "ros"
    """Behind ROS 2: set-points and odometry cross real DDS between real processes."""
    CAN = "can"
    """In the loop: the controller at one end of a CAN bus, the plant at the other; in lock step, or in real time."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of the thesis' tables: set-points held for the duration, and where the cart ends.

    Attributes:
        linear: Linear set-point, m/s.
        angular: Angular set-point, rad/s.
        thesis_offline: Position the thesis' 20-sim simulation printed, m.
        thesis_ros: Position the thesis' standalone ROS node printed, m.
        positions: Position reached in each seat that ran, m.
    """

    linear: float
    angular: float
    thesis_offline: tuple[float, float]
    thesis_ros: tuple[float, float]
    positions: Mapping[Seat, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A run over time; all sequences have the same length.

    Attributes:
        seat: Where it ran.
        time: Model time since the first set-point, s.
        x: Position along the starting direction, m.
        y: Position to the left of the starting direction, m.
        linear_velocity: m/s.
        angular_velocity: rad/s, counter-clockwise positive.
    """

    seat: Seat
    time: Sequence[float]
    x: Sequence[float]
    y: Sequence[float]
    linear_velocity: Sequence[float]
    angular_velocity: Sequence[float]


@dataclass(frozen=True, slots=True)
class Edge:
    """One topic between two nodes of the ROS graph; an end with nobody there is empty."""

    publisher: str
    topic: str
    type_name: str
    subscriber: str


class LoopTiming(NamedTuple):
    """How a controller met its deadlines in real time, and how long its machine stalled meanwhile (0: it did not)."""

    lateness_p99_s: float
    lateness_worst_s: float
    skipped: int
    stall_s: float

    @property
    def text(self) -> str:
        """In one line, ms."""
        late = f"lateness p99 {self.lateness_p99_s * 1e3:.2f} ms, worst {self.lateness_worst_s * 1e3:.2f} ms"
        stalled = f"; the machine stalled for up to {self.stall_s * 1e3:.0f} ms meanwhile" if self.stall_s else ""
        return f"{late}; {self.skipped} deadlines skipped{stalled}"


@dataclass(frozen=True, slots=True)
class RealTimeRun:
    """The CAN seat in real time: one run beside the same manoeuvre in lock step, or all of its table.

    Attributes:
        manoeuvre: What was played, as text.
        timing: Of the controller; None where it failed.
        deviation_m: Largest distance from the cart in lock step at the same time, m; None where it was not compared.
        failure: Why it failed although it was repeated; empty where it did not.
        is_spoiled: Whether the failure is the machine's: it stalled in each try, and each failed as it does then.
    """

    manoeuvre: str
    timing: LoopTiming | None = None
    deviation_m: float | None = None
    failure: str = ""
    is_spoiled: bool = False

    @property
    def text(self) -> str:
        """In one line."""
        what = f"The can seat in real time ({self.manoeuvre}): "
        if self.timing is None:
            return f"{what}no result. {self.failure}"
        compared = "" if self.deviation_m is None else f"at most {self.deviation_m:.4f} m from lock step; "
        return what + compared + self.timing.text


@dataclass(frozen=True, slots=True)
class Study:
    """Everything a run of the case study found.

    Attributes:
        velocities: 1 m/s and 0.5 rad/s held for 10 s, one trajectory per seat that ran it.
        turn: The same, then -0.5 rad/s from 10 s to 20 s.
        graph: The nodes and topics as ROS reported them while the ROS seat ran; empty without it.
        facts: What the report prints about the run (version, machine, bus, time), in order.
        repeated: A line for each run that failed and was repeated, with the reason.
        real_time: The CAN seat in real time; None where nothing ran so.
    """

    cells: Sequence[Cell]
    seats: Sequence[Seat]
    velocities: Sequence[Trajectory]
    turn: Sequence[Trajectory]
    graph: Sequence[Edge]
    facts: Mapping[str, str]
    repeated: Sequence[str] = ()
    real_time: RealTimeRun | None = None


def difference(a: tuple[float, float], b: tuple[float, float]) -> float:
    """The largest difference of two positions in one coordinate, m."""
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]))


def worst_difference(cells: Sequence[Cell], seat: Seat) -> float:
    """The largest difference between a seat and the thesis' offline table, m (NaN where the seat did not run)."""
    return max(
        (difference(c.positions[seat], c.thesis_offline) for c in cells if seat in c.positions), default=math.nan
    )


def worst_thesis_difference(cells: Sequence[Cell]) -> float:
    """The largest difference between the thesis' own ROS run and its simulation, m."""
    return max(difference(c.thesis_ros, c.thesis_offline) for c in cells)


def thesis_cells() -> tuple[Cell, ...]:
    """The twelve cells of the thesis' tables 4.1 and 4.2, not yet run in any seat."""
    text = importlib.resources.files(__package__).joinpath("thesis.json").read_text(encoding="utf-8")
    return tuple(
        Cell(
            linear=float(cell["linear"]),
            angular=float(cell["angular"]),
            thesis_offline=(cell["offline_20sim"][0], cell["offline_20sim"][1]),
            thesis_ros=(cell["standalone_ros_2019"][0], cell["standalone_ros_2019"][1]),
            positions={},
        )
        for cell in json.loads(text)["cells"]
    )


def table(cells: Sequence[Cell], seats: Sequence[Seat]) -> str:
    """Lay out the cells as aligned text, one row each, with the seats to show in their order.

    Returns:
        Lines of text: the set-points (m/s, rad/s), the positions (m) the thesis printed and each seat that ran
        reached, the worst difference (m) of these from the thesis' offline table, then one line per seat with its own.
    """
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


def _pairs(positions: Sequence[tuple[float, float] | None], decimals: int) -> list[str]:
    """Positions with their x below each other and their y below each other."""
    # "z": a position of -0.0 is printed as 0.
    texts = [p and (f"{p[0]:z.{decimals}f}", f"{p[1]:z.{decimals}f}") for p in positions]
    x_width = max((len(text[0]) for text in texts if text), default=0)
    y_width = max((len(text[1]) for text in texts if text), default=0)
    return [f"{text[0]:>{x_width}} {text[1]:>{y_width}}" if text else NOT_RUN for text in texts]
