# SPDX-License-Identifier: MIT
"""All that later cycles depend on: taken between two cycles as plain data, put back into the same parts, and compared.

Captured are the attributes of an object and of all that it holds, compiled or not; what is of no kind known here is
refused by its name, never left out. In the data a list stands for itself, and `{kind: content}` for anything else that
is no plain value: the kind is one of those below, or a class as `module:Class`.
"""

import enum
import math
import operator
import struct
import sys
import types
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from collections.abc import Set as AbstractSet
from typing import Any, Final, TypeAlias

import msgspec

from segway_ecc.firmware_io.value import Section
from segway_ecc.node.errors import ModelError, RecordingError
from segway_ecc.node.model.attributes import CODE, attributes_of, is_value, path_of
from segway_ecc.node.model.model import Model, unwrapped

_Data: TypeAlias = Any
"""What msgspec reads and writes; and, of the attributes of parts and models, anything at all."""
MOST_BYTES: Final = 60_000
"""Of a snapshot: it passes through the ring in one message."""
_MOST_VALUES: Final = 5_000
_SHOWN: Final = 300
"""Characters of a reason or a value."""
_WORD: Final = 16
"""Bytes of a word of native memory, with its place; see shim.c."""
_PLAIN: Final = frozenset({type(None), bool, int, float, str, bytes})
_CONTAINERS: Final = frozenset({list, deque, dict, Counter})
_MAKE: Final = {"list": list, "deque": deque, "dict": dict}
_KINDS: Final = frozenset({"tuple", "deque", "dict", "same", "kept"})
_ABSENT: Final = "nothing"
_OUTSIDE: Final = frozenset(
    {"_clock", "_echoes", "_hardware", "_model", "_replies", "_reported", "_sent_events", "_stage", "_tally"}
    | {"_not_commissioned", "_time_base", "writer"}
    | {"_wiring", "answers", "arming_refusal", "checklist", "events", "hardware", "recorder", "time_base"}
)
"""Attributes of a cycle's parts that no later cycle depends on: they lie around the parts, are only reported, or are in
the log with each cycle."""
FAILURES: Final = ArithmeticError, AttributeError, LookupError, ModelError, OSError, RuntimeError, TypeError, ValueError
"""What is raised by a state that is not of this robot, and by what goes on from it; msgspec raises ValueErrors."""


class Snapshot(msgspec.Struct, frozen=True, array_like=True):
    """What a cycle and all later ones depend on.

    Attributes:
        stamp_ns: The stamp of that cycle, ns since the Unix epoch.
        cycle: Its number.
        parts: Of the cycle's own parts.
        model: Of the model.
        refusal: Why something of it is missing; empty where nothing is.
    """

    stamp_ns: int
    cycle: int
    parts: bytes = b""
    model: bytes = b""
    refusal: str = ""


def take_snapshot(parts: object, model: Model, cycle: int, stamp_ns: int) -> Snapshot:
    """What cycle number `cycle`, the next, depends on. It does not raise: a snapshot reports what it lacks."""
    state, own, refusal = b"", b"", ""
    try:
        refusal = "the state of the cycle cannot be recorded"
        state = capture(parts, _OUTSIDE)
        refusal, save = "the state of the model cannot be recorded", getattr(model, "save_state", None)
        own, refusal = capture(unwrapped(model)) if save is None else save(), ""
    except (Exception, SystemExit) as error:  # noqa: BLE001 - the model is the user's and may raise anything
        refusal = f"{refusal}: {error}"[:_SHOWN]
    if len(state) + len(own) > MOST_BYTES:
        state, own, refusal = b"", b"", f"the state takes more than {MOST_BYTES} bytes"
    return Snapshot(stamp_ns, cycle, state, own, refusal)


def restore_snapshot(parts: object, model: Model, snapshot: Snapshot) -> None:
    """Put a snapshot back into parts and a model that have been started.

    Raises:
        RecordingError: It is not whole, or not of this robot.
    """
    if snapshot.refusal:
        raise RecordingError(snapshot.refusal)
    load = getattr(model, "restore_state", None)
    try:
        restore(parts, snapshot.parts, _OUTSIDE)
        if load is None:
            restore(unwrapped(model), snapshot.model)
        else:
            load(snapshot.model)
    except FAILURES as error:
        raise RecordingError(f"the state before cycle {snapshot.cycle} does not fit this robot: {error}") from error


def compare_snapshots(recorded: Snapshot, computed: Snapshot) -> Iterator[tuple[str, str, str]]:
    """Where two snapshots differ: the part, and both values.

    Raises:
        RecordingError: What was recorded is no state.
    """
    for name, *states in ("cycle", recorded.parts, computed.parts), ("model", recorded.model, computed.model):
        if not all(states) or states[0] == states[1]:
            continue
        try:
            was, now = (dict(_leaves(f"state of the {name}", msgspec.msgpack.decode(state))) for state in states)
        except FAILURES as error:
            raise RecordingError(f"the state before cycle {recorded.cycle} cannot be compared: {error}") from error
        for path in was | now:
            old, new = was.get(path, _ABSENT), now.get(path, _ABSENT)
            if not _is_same(old, new):
                yield path, str(old)[:_SHOWN], str(new)[:_SHOWN]


def capture(root: object, outside: AbstractSet[str] = frozenset()) -> bytes:
    """The state of an object and of all that it holds, less the attributes `outside`.

    Raises:
        TypeError: It holds something that cannot be captured; the text names it.
        ValueError: It holds too much.
    """
    return msgspec.msgpack.encode(_Captured(outside).take(root))


def restore(root: object, data: bytes, outside: AbstractSet[str] = frozenset()) -> None:
    """Put a state back into an object of the same kind; raises any of `FAILURES` where it does not fit."""
    _Restored(outside).put(msgspec.msgpack.decode(data), root)


class _Captured:
    """An object that is captured, and what of it was met so far."""

    def __init__(self, outside: AbstractSet[str]) -> None:
        self._outside = outside
        self._met: dict[int, int] = {}
        self._count = 0

    def take(self, value: _Data) -> _Data:
        """A value as plain data."""
        kind = type(value)
        if kind in _PLAIN:
            return value
        if isinstance(value, tuple):  # where it has names, mypyc leaves too little of their types to convert by
            return {"tuple" if kind is tuple else path_of(kind): self._take_all(value)}
        if is_value(kind):
            return {path_of(kind): value.value if isinstance(value, enum.Enum) else value}
        if kind not in _CONTAINERS and self._is_kept(value):
            return {"kept": _name_of(value)}
        if id(value) in self._met:
            return {"same": self._met[id(value)]}
        self._met[id(value)] = len(self._met)
        return self._take_held(value, kind)

    def _take_held(self, value: _Data, kind: type) -> _Data:
        if kind is list:
            return self._take_all(value)
        if kind is deque:
            return {"deque": self._take_all(value)}
        if kind in _CONTAINERS:
            return {"dict": [self._take_all(value), self._take_all(value.values())]}
        taken = {}
        for name in attributes_of(value, self._outside):
            try:
                taken[name] = self.take(getattr(value, name))
            except TypeError as error:
                raise TypeError(f"{kind.__qualname__}.{name}: {error}") from error
        return {path_of(kind): taken}

    def _take_all(self, values: Iterable[_Data]) -> list[_Data]:
        found = list(values)
        self._count += len(found)
        if self._count > _MOST_VALUES:
            raise ValueError(f"there are more than {_MOST_VALUES} values")
        return found if _PLAIN.issuperset(map(type, found)) else [self.take(value) for value in found]

    def _is_kept(self, value: object) -> bool:
        """Whether it stays what it is: a setting, or code without anything of its own."""
        if isinstance(value, CODE):
            owner = getattr(value, "__self__", None)
            is_alone = owner is None or isinstance(owner, types.ModuleType) or id(owner) in self._met
            return is_alone and getattr(value, "__closure__", None) is None
        return isinstance(value, (Section, operator.itemgetter)) or "__mypyc_lambda" in type(value).__name__


class _Restored:
    """An object whose state is put back, and what of it was met so far."""

    def __init__(self, outside: AbstractSet[str]) -> None:
        self._outside = outside
        self._met: list[_Data] = []

    def put(self, taken: _Data, now: _Data) -> _Data:
        """What was captured, made of what is in its place `now` where that is an object."""
        if not isinstance(taken, (list, dict)):
            return taken
        pairs: Iterable[tuple[str, _Data]] = taken.items() if isinstance(taken, dict) else [("list", taken)]
        ((kind, content),) = pairs
        if kind == "tuple":
            return tuple(self._put_all(content, now))
        if kind == "same":
            return self._met[content]
        if kind in {"list", "deque", "dict"}:
            return self._put_container(kind, content, now)
        if kind == "kept":
            if _name_of(now) != content:
                raise TypeError(f"{content} was there, and now it is {_name_of(now)}")
            return now
        return self._put_typed(kind, content, now)

    def _put_container(self, kind: str, content: _Data, now: _Data) -> _Data:
        made = now if kind != "list" and isinstance(now, _MAKE[kind]) else _MAKE[kind]()
        self._met.append(made)
        items = self._put_all(content if kind != "dict" else content[0], now)
        if kind == "dict":
            items = list(zip(items, self._put_all(content[1], [made.get(key) for key in items]), strict=True))
        made.clear()
        dict.update(made, items) if kind == "dict" else made.extend(items)
        return made

    def _put_typed(self, path: str, content: _Data, now: _Data) -> _Data:
        kind = type(now)
        if path_of(kind) != path or is_value(kind):
            module, _, name = path.partition(":")
            kind = operator.attrgetter(name)(sys.modules[module])
            if not (isinstance(kind, type) and is_value(kind)):
                raise TypeError(f"{path} was there, and now it is {path_of(type(now))}")
            return kind(*self._put_all(content, now)) if issubclass(kind, tuple) else msgspec.convert(content, kind)
        self._met.append(now)
        others = set(attributes_of(now, self._outside)) ^ content.keys()
        if others:
            raise TypeError(f"{path} has or had {', '.join(sorted(others))}")
        for name, value in content.items():
            setattr(now, name, self.put(value, getattr(now, name)))
        return now

    def _put_all(self, taken: list[_Data], now: _Data) -> list[_Data]:
        there = list(now) if isinstance(now, (list, tuple, deque)) and len(now) == len(taken) else [None] * len(taken)
        return [self.put(value, at) for value, at in zip(taken, there, strict=True)]


def _leaves(path: str, taken: _Data) -> Iterator[tuple[str, object]]:
    """Every value in captured data with its path; of what holds others, its kind or how many they are."""
    if isinstance(taken, dict):
        for name, each in taken.items():
            if ":" in name or name in _KINDS:
                yield path, name
                yield from _leaves(path, each)
            else:
                yield from _leaves(f"{path}.{name}", each)
    elif isinstance(taken, (list, bytes)):
        if isinstance(taken, bytes):
            taken = [taken[at : at + _WORD].hex() for at in range(0, len(taken), _WORD)]
        yield path, f"{len(taken)} values"
        for place, each in enumerate(taken):
            yield from _leaves(f"{path}[{place}]", each)
    else:
        yield path, taken


def _is_same(a: object, b: object) -> bool:
    if isinstance(a, (int, float)) and isinstance(b, (int, float)) and float in {type(a), type(b)}:
        return (math.isnan(a) and math.isnan(b)) or struct.pack("d", a) == struct.pack("d", b)
    return type(a) is type(b) and a == b


def _name_of(value: object) -> str:
    """Of what is kept; a lambda has another one where it is compiled."""
    name: str = getattr(value, "__name__", type(value).__name__)
    return "lambda" if "lambda" in name else name
