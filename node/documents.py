# SPDX-License-Identifier: MIT
"""YAML documents decoded into typed structures in one go; errors name the place, what was found and what is allowed."""

import functools
import operator
import re
import types
import typing
from collections.abc import Hashable
from typing import Any, Final, TypeVar

import msgspec
import yaml
from msgspec import structs

from segway_ecc.node.errors import ConfigurationError

T = TypeVar("T")
_STEP: Final = re.compile(r"\.([^.\[]+)|\[(\d*|\.\.\.)\]")
"""One step of msgspec's paths: `.key`, `[3]`, or `[...]` for some key of a mapping."""


def decode_yaml(text: str, kind: type[T], where: str) -> T:
    """Decode a YAML document into `kind`; messages call it `where`.

    Raises:
        ConfigurationError: It is not that; the text has the place in the document.
    """
    try:
        data = yaml.load(text, _UniqueKeyLoader)  # noqa: S506 - a safe loader, made stricter
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigurationError(f"{where} is not YAML: {' '.join(str(error).split())}") from error
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{where}: {_explain(str(error), data, kind)}") from error


class _UniqueKeyLoader(yaml.SafeLoader):
    """Refuses a key that stands twice, of which YAML would silently take the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:  # noqa: FBT001, FBT002 - the library's signature
        keys = [key.value for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"the key '{key}' stands twice", node.start_mark)
        return super().construct_mapping(node, deep=deep)


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
    return f"{problem}{at}; found {found!r}{allowed}"


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
