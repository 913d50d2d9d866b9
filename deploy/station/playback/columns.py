# SPDX-License-Identifier: MIT
"""What is shown of cycles, as columns of numbers: picked from a table of cycles, broken where something is missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS, SUPPLY_SIGNAL
from segway_ecc.node.recording.cycle_table import CycleTable
from segway_ecc.node.recording.layout import CycleLayout

Numbers: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = slice | NDArray[np.bool_]
Places: TypeAlias = NDArray[np.intp]
"""Numbers of rows."""
S = TypeVar("S", bound=np.generic)

PITCH_TOPIC: Final = "topic.pitch"
"""What the wiring of a robot names the tilt that the station shows."""
_MEASURED: Final = ("x", "y", "heading", "linear_velocity", "angular_velocity")
VALUES: Final = (*_MEASURED, "linear_setpoint", "angular_setpoint", "pitch", "supply_v")
"""The columns of values, in the order of `Columns.values`: m, m, rad, m/s, rad/s, m/s, rad/s, rad, V."""
_NS: Final = 1e-9
_FIRST: Final = slice(1)
_LAST: Final = slice(-1, None)
_STALL_S: Final = 0.25
_STALL_PERIODS: Final = 5.0


@dataclass(frozen=True, slots=True)
class Columns:
    """Cycles in their order.

    Attributes:
        time_s: When each started, s since the log's first.
        cycle: Its number.
        mode: By its place in the modes.
        is_off: Whether every drive reported that it is off.
        values: A row each of `VALUES`; NaN for what is not known.
    """

    time_s: Numbers
    cycle: NDArray[np.int64]
    mode: NDArray[np.uint8]
    is_off: NDArray[np.bool_]
    values: Numbers

    def __len__(self) -> int:
        return len(self.time_s)

    def pick(self, rows: Rows) -> "Columns":
        """Some of the rows."""
        return Columns(self.time_s[rows], self.cycle[rows], self.mode[rows], self.is_off[rows], self.values[rows])


class ColumnReader:
    """Picks the columns of one robot's cycles."""

    def __init__(self, layout: CycleLayout, wiring: Mapping[str, object]) -> None:
        """Pick them by the names of the layout; what is published as tilt is named in the robot file's wiring."""
        published = {signal: place for place, signal in enumerate(layout.published)}
        self._published = [published.get(signal) for signal in (*ODOMETRY_SIGNALS, SUPPLY_SIGNAL)]
        outputs = {name: place for place, name in enumerate(layout.outputs)}
        self._pitch = next((outputs[name] for name in outputs if wiring.get(name) == PITCH_TOPIC), None)

    def columns(self, table: CycleTable, begin_ns: int) -> Columns:
        """The columns of some cycles, in a log whose first cycle started then, monotonic, ns."""
        unknown = np.full(len(table), np.nan)
        *odometry, supply = [unknown if place is None else table["published"][:, place] for place in self._published]
        pitch = unknown if self._pitch is None else table["model_output"][:, self._pitch]
        values = np.column_stack([*odometry, table["setpoint"][:, 0], table["setpoint"][:, 1], pitch, supply])
        values[~np.isfinite(values)] = np.nan
        return Columns(
            (table["start_ns"] - begin_ns) * _NS,
            table["cycle"].astype(np.int64),
            table["mode"],
            table["off"],
            values,
        )


def joined(pieces: Sequence[Columns]) -> Columns:
    """Columns one behind the other."""
    return Columns(
        np.concatenate([piece.time_s for piece in pieces]),
        np.concatenate([piece.cycle for piece in pieces]),
        np.concatenate([piece.mode for piece in pieces]),
        np.concatenate([piece.is_off for piece in pieces]),
        np.concatenate([piece.values for piece in pieces]),
    )


def breaks(columns: Columns, period_s: float) -> Places:
    """The rows before which something is missing: cycles, or a time in which none ran."""
    stall_s = max(_STALL_S, _STALL_PERIODS * period_s)
    is_broken = (np.diff(columns.cycle) != 1) | (np.diff(columns.time_s) > stall_s)
    return np.flatnonzero(is_broken) + 1


def breaks_between(pieces: Sequence[Columns], period_s: float) -> list[bool]:
    """Of pieces that follow one another, whether something is missing before each; never before the first."""
    edges = joined([piece.pick(rows) for piece in pieces for rows in (_FIRST, _LAST)])
    broken = set(breaks(edges, period_s).tolist())
    return [place in broken for place in range(0, len(edges), 2)]


def extremes(columns: Columns, per: int, broken: Places) -> tuple[Columns, Places]:
    """For so many cycles each two rows, of their smallest and largest values; and the rows before which it is broken.

    No two rows stand for cycles before and behind a break. A value that is known in none of the cycles is NaN.
    """
    first = np.union1d(np.arange(0, len(columns), per), broken).astype(np.intp)
    last = np.append(first[1:], len(columns)) - 1
    low, high = (edge.reduceat(columns.values, first, axis=0) for edge in (np.fmin, np.fmax))
    found = Columns(
        _alternating(columns.time_s[first], columns.time_s[last]),
        _alternating(columns.cycle[first], columns.cycle[last]),
        _alternating(columns.mode[first], columns.mode[last]),
        _alternating(columns.is_off[first], columns.is_off[last]),
        np.stack([low, high], axis=1).reshape(-1, columns.values.shape[1]),
    )
    return found, 2 * np.searchsorted(first, broken)


def _alternating(one: NDArray[S], other: NDArray[S]) -> NDArray[S]:
    return np.stack([one, other], axis=1).reshape(-1)
