# SPDX-License-Identifier: MIT
"""What happened in a log, in words: from the texts that its cycles carry, and from its diagnostics."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import msgspec

from segway_ecc.deploy.station.playback.views import LogEventView
from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.errors import RecordingError, shortened
from segway_ecc.node.recording.cdr import read_diagnostic_array
from segway_ecc.node.safety.modes import Mode

MOST_EVENTS: Final = 4000
"""Of a log; what happens more often is counted."""
_MODE_LEVELS: Final[Mapping[str, str]] = {Mode.FAULT: "error", Mode.HOLD: "warning"}
_POSTURE_LEVELS: Final[Mapping[str, str]] = {"FALLEN": "error"}
_LOST: Final = "the link was lost"
_CALLS: Final[Mapping[str, str]] = {"arm": "arming was refused", "exchange": _LOST, "send": _LOST}


class _Text(NamedTuple):
    kind: str
    text: str
    name: str = ""
    level: str = "info"


class EventCollector:
    """Collects the events of a log, cycle by cycle.

    Attributes:
        events: Those that are kept, in the order in which they were found.
        left_off: How many more there were.
    """

    def __init__(self, set_names: Sequence[str] = ()) -> None:
        """Collect them; what anybody may set has these names, in the order of the wiring."""
        self._set_names = set_names
        self.events: list[LogEventView] = []
        self.left_off = 0
        self._lasting: dict[str, int] = {}
        self._values: dict[int, object] = {}
        self._unexplained: list[tuple[int, int]] = []

    def on_mode(self, time_s: float, cycle: int, mode: str, stamp_ns: int) -> None:
        """A mode was entered in a cycle with this stamp; diagnostics that come later say why."""
        if len(self.events) < MOST_EVENTS:
            self._unexplained.append((len(self.events), stamp_ns))
        self._add(time_s, cycle, _Text("mode", "", mode, _MODE_LEVELS.get(mode, "info")))

    def on_diagnostics(self, data: bytes) -> None:
        """Take the reason for a mode from the diagnostics that follow it; of all others nothing is read."""
        if not self._unexplained:
            return
        try:
            made_ns, statuses = read_diagnostic_array(data)
        except RecordingError:
            return
        values = next((values for name, values in statuses if name.endswith(MODE_SUFFIX)), None)
        before = [place for place, stamp_ns in self._unexplained if stamp_ns <= made_ns]
        if values is None or not before:
            return
        del self._unexplained[: len(before)]
        event = self.events[before[-1]]  # those before it lasted too short to be explained
        if event.name == values.get("mode"):
            self.events[before[-1]] = msgspec.structs.replace(event, text=shortened(values.get("reason", "")))

    def on_text(self, time_s: float, cycle: int, text: str) -> None:
        """A cycle carries this text, see `cycle_message`; what is none of those is left out."""
        try:
            piece = json.loads(text)
        except (ValueError, RecursionError):
            return
        if isinstance(piece, list) and piece and isinstance(piece[0], str):
            for found in self._described(piece):
                # Some are recorded in every cycle as long as they last: they happen once.
                key = f"{found.kind} {found.name} {found.text}"
                lasted = self._lasting.get(key)
                self._lasting[key] = cycle
                if lasted is None or cycle > lasted + 1 or found.kind == "request":
                    self._add(time_s, cycle, found)

    def _described(self, piece: list[object]) -> Iterator[_Text]:
        match piece:
            case ["posture", str(name), str(why)]:
                yield _Text("posture", why, name, _POSTURE_LEVELS.get(name, "info"))
            case ["fault", str(what)]:
                yield _Text("fault", what, level="error")
            case ["event", str(what)]:
                yield _Text("link", what, level="warning")
            case ["warning", str(what)]:
                yield _Text("warning", what or "nothing differs from the design any more", level="warning")
            case ["answer", str(call), [*reasons]] if call in _CALLS and reasons:
                kind = "request" if call == "arm" else "link"
                yield _Text(kind, f"{_CALLS[call]}: {'; '.join(map(str, reasons))}", level="error")
            case _:
                yield from self._arrived(piece)

    def _arrived(self, piece: list[object]) -> Iterator[_Text]:
        match piece:
            case ["requests", str(what)]:
                yield _Text("request", f"{what.replace('_', ' ')} was requested")
            case ["written", [str(name), value, str(refusal), *_]]:
                text = f"{name} = {value}"
                if refusal:
                    yield _Text("parameter", f"{text} was refused: {refusal}", level="warning")
                else:
                    yield _Text("parameter", text)
            case ["values", [int(place), value]] if self._values.get(place) != value:
                self._values[place] = value
                name = self._set_names[place] if 0 <= place < len(self._set_names) else f"value {place}"
                yield _Text("request", f"{name} = {value}")
            case ["introductions", str(name)]:
                yield _Text("station", f"station {name} watches over the robot")
            case ["trajectories", *_]:
                yield _Text("trajectory", "a trajectory was received")
            case _:
                pass

    def _add(self, time_s: float, cycle: int, found: _Text) -> None:
        if len(self.events) >= MOST_EVENTS:
            self.left_off += 1
            return
        text = shortened(found.text)
        self.events.append(
            LogEventView(
                time_s=round(time_s, 6), cycle=cycle, kind=found.kind, name=found.name, text=text, level=found.level
            )
        )
