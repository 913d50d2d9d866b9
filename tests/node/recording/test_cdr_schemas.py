# SPDX-License-Identifier: MIT
import importlib
import re
from typing import Any

import pytest
from mcap.records import Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap_ros2.decoder import DecoderFactory

from segway_ecc.node.recording.cdr import SCHEMAS

IDL_NAMES = {"float64": "double", "byte": "octet"}


def definitions(name: str) -> dict[str, list[str]]:
    """Each type in the text of `name` with its lines."""
    root, *others = SCHEMAS[name].split("=" * 80 + "\n")
    parts = {name.replace("/msg/", "/"): root.splitlines()}
    for other in others:
        first, *lines = other.splitlines()
        parts[first.removeprefix("MSG: ")] = lines
    return parts


def fields(lines: list[str]) -> list[tuple[str, str]]:
    """Name and type, as ROS spells it in Python, of each field; constants are none."""
    found = []
    for line in lines:
        kind, name = line.split()[:2]
        if "=" in name:
            continue
        base, length = re.fullmatch(r"([^\[]+)(\[\d*\])?", kind).groups()  # type: ignore[union-attr]  # fails the test
        base = IDL_NAMES.get(base, base)
        found.append((name, f"sequence<{base}>" if length == "[]" else base + (length or "")))
    return found


def ros_class(name: str) -> Any:
    package, _, short = name.rpartition("/")
    return getattr(importlib.import_module(f"{package.removesuffix('/msg')}.msg"), short)


@pytest.mark.ros
@pytest.mark.parametrize("name", SCHEMAS)
def test_every_field_is_that_of_the_installed_message_and_in_its_place(name: str) -> None:
    for part, lines in definitions(name).items():
        assert fields(lines) == list(ros_class(part).get_fields_and_field_types().items()), part


@pytest.mark.ros
@pytest.mark.parametrize("name", SCHEMAS)
def test_constants_and_defaults_are_those_of_the_installed_message(name: str) -> None:
    for part, lines in definitions(name).items():
        message = ros_class(part)
        for line in lines:
            if "=" in line:
                constant, value = line.split()[1].split("=")
                assert getattr(message, constant) == bytes([int(value)])
            elif len(line.split()) == 3:
                _, field, value = line.split()
                assert getattr(message(), field) == float(value)


@pytest.mark.parametrize("name", SCHEMAS)
def test_a_schema_holds_each_type_it_needs_once_and_no_other(name: str) -> None:
    texts = SCHEMAS[name].split("MSG: ")
    parts = definitions(name)
    used = {
        re.sub(r"sequence<(.+)>|\[\d+\]", r"\1", kind)
        for lines in parts.values()
        for _, kind in fields(lines)
        if "/" in kind
    }
    assert used | {name.replace("/msg/", "/")} == set(parts)
    assert len(texts) == len(parts)


@pytest.mark.parametrize("name", SCHEMAS)
def test_mcap_ros2_support_reads_the_same_fields(name: str) -> None:
    schema = Schema(id=1, data=SCHEMAS[name].encode(), encoding=SchemaEncoding.ROS2, name=name)
    decode = DecoderFactory().decoder_for(MessageEncoding.CDR, schema)
    assert decode is not None
    # An all-zero body of sufficient length is an empty message of any of these types.
    decoded = decode(b"\x00\x01\x00\x00" + bytes(1024))
    expected = [field for field, _ in fields(definitions(name)[name.replace("/msg/", "/")])]
    assert list(decoded.__slots__) == expected
