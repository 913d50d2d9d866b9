# SPDX-License-Identifier: MIT
"""The messages of a cycle: on `/cycle` everything that is a number, in one message of one size; else `/cycle_events`.

The definition of `/cycle` is made from the robot's layout, in the `ros2msg` form of the MCAP format registry; the bytes
are plain CDR as in `segway_ecc.node.recording.cdr`. What is eight bytes wide comes first, so that only the header needs
padding.

The events are what arrived, what the hardware answered, faults and what happened to the links. Each piece is one JSON
array whose first word is its kind. Numbers are written as Python does: all digits, and NaN and Infinity by name, so
that they come back bit for bit.

    ["fault", TEXT]                     a fault that the drives report
    ["event", TEXT]                     what happened to the links
    ["answer", CALL, [TEXT, ...]]       what the hardware answered: to arm, obstacles, exchange or send; unseen signals
    ["initial", {...}]                  the snapshot that the model started from
    ["posture", POSTURE, REASON]        the posture that was entered, of a robot that has one
    ["warning", TEXT]                   what the residual monitor began or ceased to warn of
    ["setpoints", [[V, W], NS]]         what arrived, by its place in the inbox; one piece for each
"""

import json
import operator
import struct
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Final, get_args, get_type_hints

import msgspec
from msgspec.structs import asdict, astuple, replace

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import PHASES, CycleRecord, HardwareAnswer, Inbox, PostureChange, Request
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import RecordingError, shortened
from segway_ecc.node.recording.cdr import definition
from segway_ecc.node.recording.layout import CycleLayout, field_names
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.node.safety.posture import Posture

CYCLE_TOPIC: Final = "/cycle"
CYCLE_TYPE: Final = "segway_ecc/msg/Cycle"

_MODES: Final = tuple(Mode)
_HEAD: Final = struct.Struct("<4siI")
_PREFIX: Final = b"\x00\x01\x00\x00"
# The empty frame_id of the header: its length with the closing NUL, that, and padding up to 16 bytes.
_NO_FRAME: Final = b"\x01\x00\x00\x00\x00\x00\x00\x00"
_NUMBER: Final = struct.Struct(f"<{_HEAD.size + len(_NO_FRAME)}xQ")
_NS_PER_S: Final = 1_000_000_000
# The last phase is the recording itself, which is not over when it is written.
_PHASES: Final = PHASES[:-1]
_HINTS: Final = get_type_hints(Inbox)
_FIELDS: Final = Inbox.__struct_fields__
_arrived_in: Final = operator.attrgetter(*_FIELDS)
_KINDS: Final = {name: get_args(_HINTS[name])[0] for name in _FIELDS}
"""What each list of the inbox holds."""
_encode: Final = json.JSONEncoder(separators=(",", ":")).encode

Piece = Sequence[object]


class CycleMessage:
    """The message of one robot, with its definition as `schema`."""

    def __init__(self, layout: CycleLayout) -> None:
        groups = (layout.sensors, layout.sensors, layout.inputs, layout.outputs, layout.commands, layout.published)
        self._counts = (2, *map(len, groups))
        self._sensors = len(layout.sensors)
        head = f"<4siI8sQqq{len(_PHASES)}q"
        self._struct = struct.Struct(f"{head}{sum(self._counts)}dIB??{self._sensors}?")
        numbers = struct.calcsize(head)
        self._setpoint = struct.Struct(f"<{numbers}x2d")
        self._published = struct.Struct(f"<{numbers + 8 * sum(self._counts[:-1])}x{self._counts[-1]}d")
        self._pack = self._struct.pack
        self.schema = _schema(layout)

    def pack(self, record: CycleRecord, events: int) -> bytes:
        """A cycle as a message; so many pieces of text belong to it."""
        cycle, stamp_ns, mode, lateness_ns, sensors, setpoint, u, y, commands, published, durations_ns, start_ns, *_ = (
            astuple(record)
        )
        return self._pack(
            _PREFIX,
            stamp_ns // _NS_PER_S,
            stamp_ns % _NS_PER_S,
            _NO_FRAME,
            cycle,
            start_ns,
            lateness_ns,
            *durations_ns,
            *setpoint,
            *sensors.values,
            *sensors.ages,
            *u,
            *y,
            *commands,
            *published,
            events,
            _MODES.index(mode),  # a StrEnum hashes in Python
            sensors.ready,
            sensors.off,
            *sensors.valid,
        )

    def setpoint(self, data: bytes) -> Sequence[float]:
        """The set-point in a message: m/s and rad/s."""
        return self._setpoint.unpack_from(data)

    def published(self, data: bytes) -> Sequence[float]:
        """The published signals in a message, in the order of the layout."""
        return self._published.unpack_from(data)

    def unpack(self, data: bytes) -> tuple[CycleRecord, int]:
        """A message as a cycle without its texts, and how many pieces of text belong to it.

        Raises:
            struct.error: It is of another robot.
        """
        _, seconds, rest_ns, _, cycle, start_ns, lateness_ns, *rest = self._struct.unpack(data)
        numbers = iter(rest)
        durations_ns = tuple(islice(numbers, len(_PHASES)))
        setpoint, values, ages, u, y, commands, published = (tuple(islice(numbers, n)) for n in self._counts)
        events, mode, ready, off, *valid = numbers
        record = CycleRecord(
            cycle,
            seconds * _NS_PER_S + rest_ns,
            _MODES[mode],
            lateness_ns,
            Sensors(values, ages, tuple(valid), ready=ready, off=off),
            Setpoint(*setpoint),
            u,
            y,
            commands,
            published,
            durations_ns,
            start_ns,
        )
        return record, events


def stamp_of(data: bytes) -> int:
    """The stamp of a message that begins with a header, ns since the Unix epoch."""
    _, seconds, rest_ns = _HEAD.unpack_from(data)
    return int(seconds * _NS_PER_S + rest_ns)


def cycle_of(data: bytes) -> int:
    """The number of the cycle in a message."""
    return int(_NUMBER.unpack_from(data)[0])


def _schema(layout: CycleLayout) -> str:
    """The definition: a field for each group that has members, and a type for each such field."""
    groups: dict[str, tuple[str, str, Sequence[str]]] = {
        "duration_ns": ("Durations", "int64", _PHASES),
        "setpoint": ("Setpoint", "float64", Setpoint._fields),
        "sensor": ("Sensors", "float64", layout.sensors),
        "age_s": ("Ages", "float64", layout.sensors),
        "model_input": ("Inputs", "float64", layout.inputs),
        "model_output": ("Outputs", "float64", layout.outputs),
        "command": ("Commands", "float64", layout.commands),
        "published": ("Published", "float64", layout.published),
        "valid": ("Valid", "bool", layout.sensors),
    }
    there = {field: group for field, group in groups.items() if group[2]}
    parts = {
        f"segway_ecc/{kind}": [f"{member} {name}" for name in field_names(names)]
        for kind, member, names in there.values()
    }
    fields = {field: f"segway_ecc/{kind} {field}" for field, (kind, _, _) in there.items()}
    valid = fields.pop("valid", None)
    lines = [
        *(f"uint8 {mode}={index}" for index, mode in enumerate(_MODES)),
        "std_msgs/Header header",
        "uint64 cycle",
        "int64 start_ns",
        "int64 lateness_ns",
        *fields.values(),
        "uint32 events",
        "uint8 mode",
        "bool ready",
        "bool off",
        *([valid] if valid else []),
    ]
    return definition(lines, parts)


def events_of(record: CycleRecord) -> Sequence[Piece]:
    """What happened in a cycle; almost always nothing."""
    sensors, inbox = record.sensors, record.inbox
    # No call but of C: in a loop that sleeps between its cycles, a function of Python takes microseconds each time.
    if (
        (inbox is None or not any(_arrived_in(inbox)))
        and not record.answers
        and not sensors.faults
        and not sensors.events
        and record.initial is None
        and record.posture is None
        and record.warning is None
    ):
        return ()
    pieces: list[Piece] = [] if record.initial is None else [["initial", asdict(record.initial)]]
    for name in _FIELDS if inbox is not None else ():
        arrived = getattr(inbox, name)
        pieces += [[name, each.action if isinstance(each, Request) else each] for each in arrived]
    pieces += [["answer", answer.call, answer.reasons] for answer in record.answers]
    pieces += [["fault", fault] for fault in sensors.faults]
    pieces += [["event", event] for event in sensors.events]
    pieces += [["posture", *record.posture]] if record.posture is not None else []
    pieces += [["warning", record.warning]] if record.warning is not None else []
    return pieces


def encode_events(pieces: Iterable[Piece]) -> list[str]:
    """Pieces as the log holds them."""
    return [_encode(piece) for piece in pieces]


def restore_events(record: CycleRecord, held: Iterable[str]) -> CycleRecord:
    """The cycle with what happened in it put back; what was asked in it is answered to nobody.

    Raises:
        RecordingError: A text is none of those that `encode_events` returns.
    """
    inbox, answers, faults, events, initial, posture = Inbox(), [], [], [], None, None
    warning: str | None = None
    try:
        for text in held:
            match json.loads(text):
                case ["fault", what]:
                    faults.append(what)
                case ["event", what]:
                    events.append(what)
                case ["answer", call, reasons]:
                    answers.append(HardwareAnswer(call, tuple(reasons)))
                case ["initial", snapshot]:
                    initial = msgspec.convert(snapshot, Sensors)
                case ["posture", entered, why]:
                    posture = PostureChange(Posture(entered), str(why))
                case ["warning", what]:
                    warning = str(what)
                case other:  # raises unless it is a name and a value
                    name, value = other
                    request = Request(Action(str(value)), discard_answer) if _KINDS[name] is Request else None
                    getattr(inbox, name).append(request or msgspec.convert(value, _KINDS[name]))
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError, msgspec.ValidationError) as error:
        problem = shortened(str(error))
        raise RecordingError(f"the events of cycle {record.cycle} in the log are not understood: {problem}") from error
    sensors = replace(record.sensors, faults=tuple(faults), events=tuple(events))
    return replace(
        record, sensors=sensors, inbox=inbox, answers=answers, initial=initial, posture=posture, warning=warning
    )


def discard_answer(_answer: Answer) -> None:
    """Whoever asked is long gone."""
