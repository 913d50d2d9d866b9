# SPDX-License-Identifier: MIT
"""YAML documents decoded into typed structures in one go; errors name the place, what was found and what is allowed."""

import errno
import functools
import operator
import re
import reprlib
import types
import typing
from collections.abc import Hashable
from importlib.resources.abc import Traversable
from typing import Any, Final, TypeVar

import msgspec
import yaml
from msgspec import structs

from segway_ecc.node.errors import ConfigurationError, shortened

T = TypeVar("T")
_STEP: Final = re.compile(r"\.([^.\[]+)|\[(\d*|\.\.\.)\]")
"""One step of msgspec's paths: `.key`, `[3]`, or `[...]` for some key of a mapping."""
_MOST_CHARACTERS: Final = 1 << 20
"""Of a document: the library reads some 60,000 characters in a second."""
_DEEPEST: Final = 32
_LONGEST_NUMBER: Final = 64
"""In characters: Python refuses to print an integer of more than 4,300 digits, and takes long to read one."""
_PLAIN_NUMBERS: Final = frozenset(f"tag:yaml.org,2002:{kind}" for kind in ("int", "float"))
_NUMBERS: Final = _PLAIN_NUMBERS | {"tag:yaml.org,2002:timestamp"}
_UNUSUAL: Final = re.compile(r"[^:]*:|.*_|[-+]?0\d")
"""Of numbers: what YAML 1.1 reads as base 60, with signs of grouping, or in base 8."""
_found: Final = reprlib.Repr()
_found.maxlevel = 2
_found.maxstring = _found.maxother = _found.maxlong = 80


def read_document(path: Traversable) -> str:
    """The text of a file that holds a document; of one that is too long, which `read_yaml` refuses, what shows that.

    Raises:
        OSError: It cannot be read, or is not UTF-8 text; `strerror` is why, for a message.
    """
    try:
        with path.open("r", encoding="utf-8") as file:
            return file.read(_MOST_CHARACTERS + 1)
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, "not UTF-8 text") from error


def decode_yaml(text: str, kind: type[T], where: str) -> T:
    """Decode a YAML document into `kind`; messages call it `where`.

    Decoding takes time and memory in proportion to the text, and a message has one line of bounded length, whatever the
    document holds.

    Raises:
        ConfigurationError: It is not that; the text has the place in the document.
    """
    return decode_data(read_yaml(text, where), kind, where)


def read_yaml(text: str, where: str) -> object:
    """The mappings, lists, texts and numbers of a YAML document; see `decode_yaml`.

    Raises:
        ConfigurationError: It is too long or not YAML.
    """
    if len(text) > _MOST_CHARACTERS:
        raise ConfigurationError(f"{where} is too long: at most {_MOST_CHARACTERS} characters are read")
    try:
        return yaml.load(text, _BoundedLoader)  # noqa: S506 - a safe loader, made stricter
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        problem = shortened(" ".join(str(error).split()))
        raise ConfigurationError(f"{where} is not YAML: {problem}") from error


def decode_data(data: object, kind: type[T], where: str) -> T:
    """Convert what `read_yaml` returned into `kind`; see `decode_yaml`.

    Raises:
        ConfigurationError: It is not that; the text has the place in the document.
    """
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        problem = shortened(_explain(str(error), data, kind))
        raise ConfigurationError(f"{where}: {problem}") from error


class _BoundedLoader(yaml.SafeLoader):
    """Refuses what makes a short document large or slow, and a key of which YAML would silently take the last.

    An alias repeats what its anchor names: ten of ten of ten make 330 characters five gigabytes. A tag asks for a type
    that no document here has, and most of the library's own fail at a wrong value with errors of their own.
    """

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:  # noqa: ANN401 - the library's signature
        event = self.peek_event()  # type: ignore[no-untyped-call]  # as all of the library's
        if isinstance(event, yaml.AliasEvent):
            raise _refusal("an alias (*) is not taken: write the value out", event.start_mark)
        if event.tag is not None:
            raise _refusal("a tag (!) is not taken: write the value without it", event.start_mark)
        self._depth += 1
        if self._depth > _DEEPEST:
            raise _refusal(f"nested too deeply: at most {_DEEPEST} levels are read", event.start_mark)
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(node, yaml.ScalarNode):
            node.value.encode()  # half of a surrogate pair, which only an escape can be, is no text
            if "\0" in node.value:  # nor is what no path, name or address can hold
                raise _refusal("a NUL is no text", event.start_mark)
            if node.tag in _NUMBERS and len(node.value) > _LONGEST_NUMBER:
                raise _refusal(f"a number has at most {_LONGEST_NUMBER} characters", event.start_mark)
            if node.tag in _PLAIN_NUMBERS and _UNUSUAL.match(node.value):
                raise _refusal(f"{node.value} is no plain number: write one such as 90 or 0x1f", event.start_mark)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:  # noqa: FBT001, FBT002 - the library's signature
        seen = set()
        for key in (key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key in seen:
                raise _refusal(f"the key '{key}' stands twice", node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep=deep)


def _refusal(problem: str, mark: Any) -> yaml.MarkedYAMLError:  # noqa: ANN401 - of one type or another by the library's build
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


# YAML 1.1, which the library reads, wants a point and a sign: 1e-9 and 1e3 are text there, and numbers in YAML 1.2.
_BoundedLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$", re.ASCII), list("-+.0123456789")
)


def _explain(message: str, data: object, kind: type) -> str:
    """Name the place, what was found there and what is allowed, in one line."""
    problem, _, path = message.partition(" - at `")
    steps = [step.group(1) or step.group(2) for step in _STEP.finditer(path.rstrip("`"))]
    place, found, kinds = _descend(data, [kind], steps)
    at = f" at {'.'.join(place)}" if place else ""
    if "unknown field" in problem:
        fitting = _fitting(kinds, found)
        keys = {field.encode_name for struct in _structs(fitting) for field in structs.fields(struct)}
        keys |= {"type"} if _tags(fitting) else set()
        return f"{problem}{at}; the keys there are {', '.join(sorted(keys))}"
    if "missing required field" in problem:
        return f"{problem}{at}"
    choices = (typing.get_args(kind) for kind in kinds if typing.get_origin(kind) is typing.Literal)
    allowed = ", ".join(sorted(str(choice) for literal in choices for choice in literal))
    allowed = f"; allowed is {allowed}" if allowed else ""
    return f"{problem}{at}; found {_found.repr(found)}{allowed}"


def _descend(data: object, kinds: list[object], steps: list[str]) -> tuple[list[str], object, list[object]]:
    """Follow a path: the keys along it, the value at its end, and the types that may stand there."""
    place: list[str] = []
    for step in steps:
        key, below = _step(data, _flat(kinds), step)
        place.append(str(key))
        if isinstance(data, dict):
            data = data.get(key) if key == "type" else data[key]
        elif isinstance(data, list) and key != "type":
            data = data[key]
        kinds = below
    return place, data, _flat(kinds)


def _step(data: object, kinds: list[object], step: str) -> tuple[Any, list[object]]:
    """The key or index that a step means in `data`, and the types below it."""
    if step == "...":
        values = [kind for container in kinds for kind in typing.get_args(container)[1:]]
        return _bad_key(data, values), values
    if step.isdigit() and isinstance(data, list):
        return int(step), [typing.get_args(container)[0] for container in kinds if typing.get_args(container)]
    fields = [field for struct in _structs(_fitting(kinds, data)) for field in structs.fields(struct)]
    below = [field.type for field in fields if field.encode_name == step]
    return step, below or [typing.Literal[tuple(_tags(kinds))]]


def _bad_key(data: object, kinds: list[object]) -> object:
    """The first key of a mapping whose value fits none of the types; msgspec does not name it."""
    for key, value in data.items() if isinstance(data, dict) else ():
        try:
            msgspec.convert(value, functools.reduce(operator.or_, kinds))
        except msgspec.ValidationError:
            return key
    return "..."


def _flat(kinds: list[object]) -> list[object]:
    """The types themselves, alternatives and annotations taken apart."""
    flat: list[object] = []
    for kind in kinds:
        origin, arguments = typing.get_origin(kind), list(typing.get_args(kind))
        if origin in (types.UnionType, typing.Union):
            flat += _flat(arguments)
        else:
            flat += _flat(arguments[:1]) if origin is typing.Annotated else [kind]
    return flat


def _structs(kinds: list[object]) -> list[type[msgspec.Struct]]:
    return [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, msgspec.Struct)]


def _fitting(kinds: list[object], data: object) -> list[object]:
    """Of several tagged structures, the one that the data's tag names; else all."""
    tag = data.get("type") if isinstance(data, dict) else None
    named = [struct for struct in _structs(kinds) if struct.__struct_config__.tag is not None]
    return [struct for struct in named if struct.__struct_config__.tag == tag] or kinds


def _tags(kinds: list[object]) -> list[str]:
    tags = (struct.__struct_config__.tag for struct in _structs(kinds))
    return sorted(str(tag) for tag in tags if tag is not None)
