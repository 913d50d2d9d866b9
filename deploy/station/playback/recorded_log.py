# SPDX-License-Identifier: MIT
"""A log that is played: looked through once, then given in pieces, so that nobody holds all of it."""

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from segway_ecc.deploy.station.playback.columns import (
    VALUES,
    ColumnReader,
    Columns,
    Places,
    breaks,
    breaks_between,
    extremes,
    joined,
)
from segway_ecc.deploy.station.playback.log_events import EventCollector
from segway_ecc.deploy.station.playback.views import LogRowsView, LogView
from segway_ecc.node.cycle.signals import SET
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cdr import read_cycle_events
from segway_ecc.node.recording.cycle_log import EVENTS_TOPIC, LAYOUT_FILE
from segway_ecc.node.recording.cycle_message import CYCLE_TOPIC, stamp_of
from segway_ecc.node.recording.cycle_table import CycleTableReader
from segway_ecc.node.recording.layout import END_FILE, PART_FILE, ROBOT_FILE, CycleLayout, LogPart
from segway_ecc.node.recording.salvage import Salvage
from segway_ecc.node.safety.modes import Mode

T = TypeVar("T")

MOST_ROWS: Final = 4000
"""Of an answer."""
_DIAGNOSTICS: Final = "/diagnostics"
_TOPICS: Final = (CYCLE_TOPIC, EVENTS_TOPIC, _DIAGNOSTICS)
_MOST_UNPACKED: Final = 60_000
"""Cycles that are unpacked for one answer; more are shown by what was noted of their chunks."""
_MOST_KEPT: Final = 64
"""Chunks that stay unpacked, of half a second each."""
_MOST_GAPS: Final = 1000
_LONGEST_PIECE_S: Final = 10.0
_DECIMALS: Final = 5
_SLIGHTLY_S: Final = 1e-6
"""Times are sent with six decimals: who asks for the one of a cycle is to get it."""
_MODES: Final = tuple(Mode)


@dataclass(frozen=True, slots=True)
class _Noted:
    """Of a chunk that has cycles: its number, how many it has, and their extremes as two rows each."""

    chunk: int
    count: int
    edges: Columns
    broken: Places


class RecordedLog:
    """One file of a run."""

    def __init__(self, source: Salvage) -> None:
        """Look through all of it.

        Raises:
            RecordingError: It is no log of a run, or has no cycle.
        """
        self._source = source
        self._layout = _decoded(source, LAYOUT_FILE, CycleLayout)
        self._robot = msgspec.json.decode(source.attachments.get(ROBOT_FILE, b"{}"), type=dict[str, object])
        wiring = _section(self._robot, "wiring")
        self._reader = CycleTableReader(self._layout)
        self._columns = ColumnReader(self._layout, wiring)
        signals = [signal for signal in wiring.values() if isinstance(signal, str)]
        self._events = EventCollector([name.removeprefix(SET) for name in signals if name.startswith(SET)])
        self._kept: OrderedDict[int, Columns] = OrderedDict()
        self._noted: list[_Noted] = []
        self._begin_ns = 0  # the stamp of the first cycle
        self._started_ns = 0  # by the clock that does not jump
        self._look_through()
        if not self._noted:
            raise RecordingError(f"{source.path.name} has no cycle")
        self._first_s = np.array([noted.edges.time_s[0] for noted in self._noted])
        self._last_s = np.array([noted.edges.time_s[-1] for noted in self._noted])

    @property
    def period_s(self) -> float:
        """Of the loop, s; 0 where the log does not say."""
        return self._layout.period_ns * 1e-9

    def view(self) -> LogView:
        """The log as a whole."""
        safety = _section(self._robot, "safety")
        posture = _section(safety, "posture")
        part = _decoded(self._source, PART_FILE, LogPart).number if PART_FILE in self._source.attachments else 1
        period_s = self.period_s or 1e-3
        return LogView(
            robot=self._layout.robot,
            begin_ns=self._begin_ns,
            duration_s=float(self._last_s[-1]),
            period_s=self.period_s,
            cycles=sum(noted.count for noted in self._noted),
            part=part,
            has_end=END_FILE in self._source.attachments,
            is_cut=self._source.is_cut,
            damage=self._source.damage,
            gaps=self._gaps(),
            events=sorted(self._events.events, key=lambda event: event.time_s),
            events_left_off=self._events.left_off,
            piece_s=min(_LONGEST_PIECE_S, 0.5 * MOST_ROWS * period_s),
            modes=[str(mode) for mode in _MODES],
            is_balancing=bool(posture),
            tilt_limit_rad=_number(safety.get("tilt_limit_rad")),
            down_rad=_number(posture.get("down_rad")),
        )

    def rows(self, from_s: float, to_s: float, most: int) -> LogRowsView:
        """What was recorded from then to then, s, in at most so many rows, up to `MOST_ROWS`, and some for gaps."""
        from_s, to_s = from_s - _SLIGHTLY_S, to_s + _SLIGHTLY_S
        inside = np.flatnonzero((self._last_s >= from_s) & (self._first_s <= to_s))
        noted = [self._noted[place] for place in inside]
        if not noted:
            return self._rows_view(1, _NOTHING, np.array([], dtype=np.intp))
        most = min(most, MOST_ROWS)
        count = sum(each.count for each in noted)
        if count > _MOST_UNPACKED:
            columns = joined([each.edges for each in noted])
            per = 2 * max(1, -(-2 * len(noted) // most))
            found, broken = extremes(columns, per, _breaks_of(noted, self.period_s))
            return self._rows_view(-(-count * per // len(columns)), found, broken)
        columns = joined([self._unpacked(each) for each in noted])
        columns = columns.pick((columns.time_s >= from_s) & (columns.time_s <= to_s))
        broken = breaks(columns, self.period_s)
        if len(columns) <= most:
            return self._rows_view(1, columns, broken)
        per = -(-2 * len(columns) // most)
        return self._rows_view(per, *extremes(columns, per, broken))

    def _look_through(self) -> None:
        texts: list[tuple[int, str]] = []
        last_mode = -1
        for chunk in range(self._source.chunk_count):
            found: dict[str, list[bytes]] = {topic: [] for topic in _TOPICS}
            for topic, data in self._source.payloads(chunk, _TOPICS):
                found[topic].append(data)
            for data in found[EVENTS_TOPIC]:
                number, held = read_cycle_events(data)
                texts += [(number, text) for text in held]
            columns, stamps = self._read(found[CYCLE_TOPIC])
            if len(columns):
                texts = self._note_texts(columns, texts)
                last_mode = self._note_modes(columns, stamps, last_mode)
                edges, broken = extremes(columns, len(columns), breaks(columns, self.period_s))
                self._noted.append(_Noted(chunk, len(columns), edges, broken))
            for data in found[_DIAGNOSTICS]:
                self._events.on_diagnostics(data)

    def _read(self, cycles: list[bytes]) -> tuple[Columns, NDArray[np.int64]]:
        """The columns of a chunk and the stamps of its cycles, ns; what comes twice or out of order is left out."""
        table = self._reader.table(cycles)
        if cycles and not self._noted:
            self._begin_ns, self._started_ns = stamp_of(cycles[0]), int(table["start_ns"][0])
        columns = self._columns.columns(table, self._started_ns)
        stamps = table["stamp_s"].astype(np.int64) * 1_000_000_000 + table["stamp_ns"]
        first = int(self._noted[-1].edges.cycle[-1]) + 1 if self._noted else 0
        is_next = _is_next(columns, first)
        return columns.pick(is_next), stamps[is_next]

    def _note_texts(self, columns: Columns, texts: list[tuple[int, str]]) -> list[tuple[int, str]]:
        """Note what happened in these cycles; what belongs to later ones is left."""
        later = []
        for number, text in texts:
            if number > columns.cycle[-1]:
                later.append((number, text))
                continue
            place = int(np.searchsorted(columns.cycle, number))
            self._events.on_text(float(columns.time_s[place]), number, text)
        return later

    def _note_modes(self, columns: Columns, stamps: NDArray[np.int64], last: int) -> int:
        modes = columns.mode.astype(np.int64)
        for place in np.flatnonzero(np.diff(modes, prepend=last)):
            mode = int(modes[place])
            name = str(_MODES[mode]) if mode < len(_MODES) else "unknown"
            self._events.on_mode(float(columns.time_s[place]), int(columns.cycle[place]), name, int(stamps[place]))
        return int(modes[-1])

    def _gaps(self) -> list[tuple[float, float]]:
        edges = joined([noted.edges for noted in self._noted])
        places = _breaks_of(self._noted, self.period_s)[:_MOST_GAPS]
        return [(round(float(edges.time_s[at - 1]), 6), round(float(edges.time_s[at]), 6)) for at in places]

    def _unpacked(self, noted: _Noted) -> Columns:
        kept = self._kept.pop(noted.chunk, None)
        if kept is None:
            table = self._reader.table([data for _, data in self._source.payloads(noted.chunk, (CYCLE_TOPIC,))])
            kept = self._columns.columns(table, self._started_ns)
            kept = kept.pick(_is_next(kept, int(noted.edges.cycle[0])))
        self._kept[noted.chunk] = kept
        while len(self._kept) > _MOST_KEPT:
            self._kept.popitem(last=False)
        return kept

    def _rows_view(self, per: int, columns: Columns, broken: Places) -> LogRowsView:
        """The answer, with a row of None before each break, which stands in the middle of what is missing."""
        time_s = columns.time_s
        middle = 0.5 * (time_s[broken - 1] + time_s[broken]) if len(broken) else np.array([])
        values = np.insert(np.round(columns.values, _DECIMALS), broken, np.nan, axis=0)
        known = values.astype(object)
        known[np.isnan(values)] = None
        cycle = np.insert(columns.cycle, broken, -1).tolist()
        is_gap = [number < 0 for number in cycle]
        return LogRowsView(
            begin_ns=self._begin_ns,
            per=per,
            time_s=np.round(np.insert(time_s, broken, middle), 6).tolist(),
            cycle=[None if gap or per > 1 else number for number, gap in zip(cycle, is_gap, strict=True)],
            mode=_known(np.insert(columns.mode, broken, 0).tolist(), is_gap),
            is_off=_known(np.insert(columns.is_off, broken, values=False).tolist(), is_gap),
            **{name: known[:, place].tolist() for place, name in enumerate(VALUES)},
        )


_NOTHING: Final = Columns(
    np.array([]),
    np.array([], dtype=np.int64),
    np.array([], dtype=np.uint8),
    np.array([], dtype=np.bool_),
    np.empty((0, len(VALUES))),
)


def _is_next(columns: Columns, first: int) -> NDArray[np.bool_]:
    """The cycles from a first one on, each after those before it: a cycle that comes twice, or late, is left out."""
    newest: NDArray[np.int64] = np.maximum.accumulate(np.append(first - 1, columns.cycle))[:-1]
    return columns.cycle > newest


def _breaks_of(noted: Sequence[_Noted], period_s: float) -> Places:
    """Of the extremes of chunks, one behind the other, the rows before which something is missing."""
    found, at = [np.array([], dtype=np.intp)], 0
    between = breaks_between([each.edges for each in noted], period_s)
    for each, is_broken in zip(noted, between, strict=True):
        if is_broken:
            found.append(np.array([at], dtype=np.intp))
        found.append(each.broken + at)
        at += len(each.edges)
    return np.concatenate(found)


def _known(column: Sequence[T], is_gap: Sequence[bool]) -> list[T | None]:
    return [None if gap else value for value, gap in zip(column, is_gap, strict=True)]


def _decoded(source: Salvage, name: str, kind: type[T]) -> T:
    if name not in source.attachments:
        raise RecordingError(f"{source.path.name} is no log of a run (there is no {name} in it)")
    try:
        return msgspec.json.decode(source.attachments[name], type=kind)
    except msgspec.MsgspecError as error:
        raise RecordingError(f"{source.path.name} is of another version of segway-ecc: its {name}: {error}") from None


def _section(values: Mapping[str, object], name: str) -> Mapping[str, object]:
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) else None
