# SPDX-License-Identifier: MIT
"""What happened in a cycle beyond its numbers: what arrived, what the hardware answered, faults and events.

Each piece is one JSON array whose first word is its kind. Numbers are written as Python does: all digits, and NaN
and Infinity by name, so that they come back bit for bit.

    ["fault", TEXT]                     a fault that the drives report
    ["event", TEXT]                     what happened to the links
    ["answer", CALL, [TEXT, ...]]       what the hardware answered: to arm, obstacles, exchange or send
    ["initial", {...}]                  the snapshot that the model started from
    ["setpoints", [[V, W], NS]]         what arrived, by its place in the inbox; one piece for each
"""

import json
import operator
import typing
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord, HardwareAnswer, Inbox, Request
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.safety.modes import Action, Answer

_HINTS: Final = typing.get_type_hints(Inbox)
_FIELDS: Final = Inbox.__struct_fields__
_arrived_in: Final = operator.attrgetter(*_FIELDS)
_KINDS: Final = {name: typing.get_args(_HINTS[name])[0] for name in _FIELDS}
"""What each list of the inbox holds."""

_encode: Final = json.JSONEncoder(separators=(",", ":")).encode


Piece = Sequence[object]


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
    ):
        return ()
    pieces: list[Piece] = [] if record.initial is None else [["initial", msgspec.structs.asdict(record.initial)]]
    for name in _FIELDS if inbox is not None else ():
        arrived = getattr(inbox, name)
        pieces += [[name, each.action if isinstance(each, Request) else each] for each in arrived]
    pieces += [["answer", answer.call, answer.reasons] for answer in record.answers]
    pieces += [["fault", fault] for fault in sensors.faults]
    pieces += [["event", event] for event in sensors.events]
    return pieces


def encode_events(pieces: Iterable[Piece]) -> list[str]:
    """Pieces as the log holds them."""
    return [_encode(piece) for piece in pieces]


def restore_events(record: CycleRecord, held: Iterable[str]) -> CycleRecord:
    """The cycle with what happened in it put back; what was asked in it is answered to nobody.

    Raises:
        RecordingError: A text is none of those that `texts` returns.
    """
    inbox, answers, faults, events, initial = Inbox(), [], [], [], None
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
                case other:  # raises unless it is a name and a value
                    name, value = other
                    request = Request(Action(str(value)), discard_answer) if _KINDS[name] is Request else None
                    getattr(inbox, name).append(request or msgspec.convert(value, _KINDS[name]))
    except (ValueError, KeyError, AttributeError, TypeError, msgspec.ValidationError) as error:
        raise RecordingError(f"the events of cycle {record.cycle} in the log are not understood: {error}") from error
    sensors = msgspec.structs.replace(record.sensors, faults=tuple(faults), events=tuple(events))
    return replace(record, sensors=sensors, inbox=inbox, answers=answers, initial=initial)


def discard_answer(_answer: Answer) -> None:
    """Whoever asked is long gone."""
