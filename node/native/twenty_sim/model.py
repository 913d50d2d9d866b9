# SPDX-License-Identifier: MIT
"""The description of a 20-sim model, put together from its code, its comments and its XML.

When a write takes effect is read from the equations themselves. 20-sim sorts them: initial and static ones run once,
input, dynamic and output ones at every step. A parameter acts where it is read, and nowhere else: what 20-sim folded
into a literal number has no place left to be written to.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.native.library import Description, Flavour
from segway_ecc.node.native.twenty_sim.names import Label, Ports, Table, choose, label_of, unique
from segway_ecc.node.native.twenty_sim.parts import METHODS, SECTIONS, Parts, find_method, number, setting

_RUNNING: Final = ("Input", "Dynamic", "Output", "Final")


def describe_model(
    parts: Parts, table: Table, ports: Ports, method: str | None = None, step_size: float | None = None
) -> Description:
    """Describe a model.

    Args:
        parts: The parts of its code.
        table: The XML beside it.
        ports: Its ports.
        method: The integration method, where the files do not name it.
        step_size: The step in s, where the files do not give it.

    Raises:
        ModelError: The method or the step cannot be known; the text names what to pass.
    """
    warnings = [*table.warnings, *ports.warnings]
    never = (Write.NEVER, "")
    elements = {"parameter": parts.elements("P"), "state": parts.elements("s")}
    effects = {
        "parameter": parameter_effects(parts, len(elements["parameter"])),
        "state": state_effects(parts, len(elements["state"])),
    }
    coded: dict[str, list[tuple[Label, str, Effect]]] = {
        "input": [(port.label, "", never) for port in ports.inputs],
        "output": [(port.label, "", never) for port in ports.outputs],
    }
    for kind, found in elements.items():
        pairs = zip(found, effects[kind], strict=True)
        coded[kind] = [(label_of(element.comment), element.value, effect) for element, effect in pairs]
    labels = {kind: choose(kind, [label for label, *_ in rows], table, warnings) for kind, rows in coded.items()}
    names = unique(labels, warnings)
    initial = {
        f"{parts.prefix}I[{index}]": value
        for index, element in enumerate(parts.elements("I"))
        if (value := number(element.value)) is not None
    }
    variables = {
        kind: tuple(
            Variable(name, label.unit or "1", number(value, initial) or 0.0, *effect)
            for name, label, (_, value, effect) in zip(names[kind], labels[kind], rows, strict=True)
        )
        for kind, rows in coded.items()
    }
    chosen = _method(parts, method)
    step = _step_size(parts, table, step_size, warnings)
    if parts.real == "float":
        warnings.append("it computes in single precision: XXDouble is float in its types")
    return Description(
        parts.name,
        parts.flavour,
        parts.build,
        chosen,
        step,
        setting(parts, "finish_time") or None,
        variables["input"],
        variables["output"],
        variables["parameter"],
        variables["state"],
        tuple(warnings),
    )


def _method(parts: Parts, given: str | None) -> str:
    found = find_method(parts)
    if given and given not in METHODS:
        raise ModelError(f"there is no method '{given}'; there is {', '.join(METHODS)}")
    if given and found and given != found:
        raise ModelError(f"the code in {parts.folder.path} integrates with {found}; it cannot be made to use {given}")
    if given or found or parts.flavour is not Flavour.C_PARTIAL:
        return given or found
    if not parts.elements("s"):
        # Without states there is nothing to integrate.
        return ""
    raise ModelError(
        f"{parts.folder.path} names no integration method (xxinteg and xxsubmod are missing): "
        f"pass method=, one of {', '.join(METHODS)} to load_model"
    )


def _step_size(parts: Parts, table: Table, given: float | None, warnings: list[str]) -> float:
    found = setting(parts, "step_size")
    if found is not None and given is not None and found != given:
        raise ModelError(
            f"the code in {parts.folder.path} has a step of {found:g} s; it cannot be made to use {given:g} s"
        )
    step = given if found is None else found
    if step is None:
        raise ModelError(f"{parts.folder.path} gives no step size: pass step_size= in s to load_model")
    if step <= 0.0:
        raise ModelError(f"{parts.folder.path} has a step of {step:g} s, and a step must be longer than zero")
    listed = re.fullmatch(r"\s*([-+.\deE]+)\s*", table.tokens.get("TIME_STEP_SIZE", ""))
    if listed and (other := number(listed[1])) is not None and other != step:
        warnings.append(f"{table.file} gives a step of {other:g} s and the code has {step:g} s: the code is followed")
    return step


Effect = tuple[Write, str]
"""When a write takes effect, and what decides that."""


class _Uses(NamedTuple):
    """The sections in which an element is read, and those in which it is set."""

    read: list[str]
    set: list[str]


def parameter_effects(parts: Parts, count: int) -> list[Effect]:
    """Return the effect of a write for each parameter, in order."""
    is_text = re.compile(r"\w*String2Double\b|\"")
    texts = {index for index, element in enumerate(parts.elements("P")) if is_text.match(element.value)}
    uses = _uses(parts, "P", count)
    return [(Write.NEVER, "it is a text") if i in texts else _parameter(uses[i]) for i in range(count)]


def state_effects(parts: Parts, count: int) -> list[Effect]:
    """Return the effect of a write for each state, in order."""
    pattern = re.compile(rf"(?<![\w.]){re.escape(parts.prefix)}R\s*\[\s*(\d+)\s*\]\s*=(?!=)([^;]*);")
    rates: dict[int, set[str]] = {}
    for body in parts.sections().values():
        for match in pattern.finditer(body):
            rates.setdefault(int(match[1]), set()).add(match[2].strip())
    effects = []
    for index, uses in enumerate(_uses(parts, "s", count)):
        if computed := [section for section in uses.set if section in _RUNNING]:
            effects.append((Write.NEVER, f"the {_and(computed)} equations set it themselves"))
        elif index in rates and rates[index] <= {"0.0", "0"}:
            effects.append((Write.NOW, "its rate is zero, so it keeps what is written"))
        else:
            effects.append((Write.NOW, "a state; the model moves on from what is written"))
    return effects


def _parameter(uses: _Uses) -> Effect:
    if uses.set:
        return (Write.NEVER, f"the {_and(uses.set)} equations compute it")
    if "Static" in uses.read:
        others = [section for section in uses.read if section != "Static"]
        more = f" and {_and(others)}" if others else ""
        return (Write.STATIC, f"read by the static{more} equations; a write runs the static ones again")
    if running := [section for section in uses.read if section in _RUNNING]:
        more = "; by the initial ones at reset" if "Initial" in uses.read else ""
        return (Write.NOW, f"read by the {_and(running)} equations{more}")
    if uses.read:
        return (Write.RESET, "read by the initial equations only")
    return (Write.NEVER, "no equation reads it: it has no effect, or its value is compiled in as a number")


def _uses(parts: Parts, letter: str, count: int) -> list[_Uses]:
    uses = [_Uses([], []) for _ in range(count)]
    matrices = _matrices(parts, letter, count)
    for section, body in parts.sections().items():
        for index, is_set in _references(parts, letter, body, matrices, count):
            places = uses[index].set if is_set else uses[index].read
            if section not in places:
                places.append(section)
    return uses


def _references(
    parts: Parts, letter: str, body: str, matrices: Mapping[int, range], count: int
) -> Iterator[tuple[int, bool]]:
    """Yield each element that a section touches, and whether it is set there."""
    array = re.escape(parts.prefix + letter)
    for match in re.finditer(rf"(?<![\w.]){array}(?!\w)(?:\s*\[\s*(\d+)\s*\])?(\s*=(?!=))?", body):
        if match[1] is None or body.endswith("&", 0, match.start()):
            # A computed index, or the array handed on: any element from there on may be meant.
            yield from ((index, False) for index in range(int(match[1] or 0), count))
        elif int(match[1]) < count:
            yield int(match[1]), match[2] is not None
    for match in re.finditer(rf"(?<![\w.]){re.escape(parts.prefix)}M\s*\[\s*(\d+)\s*\]", body):
        yield from ((index, False) for index in matrices.get(int(match[1]), ()))


def _matrices(parts: Parts, letter: str, count: int) -> dict[int, range]:
    """The elements behind each matrix that lies over the array: `xx_M[0].mat = &xx_P[2]`, with rows and columns."""
    code = parts.model.code
    matrix = rf"{re.escape(parts.prefix)}M\s*\[\s*(\d+)\s*\]\s*\.\s*"
    pattern = re.compile(rf"{matrix}mat\s*=\s*&?\s*{re.escape(parts.prefix + letter)}(?:\s*\[\s*(\d+)\s*\])?\s*[;+]")
    rows, columns = (
        {int(index): int(size) for index, size in re.findall(rf"{matrix}{side}\s*=\s*(\d+)\s*;", code)}
        for side in ("rows", "columns")
    )
    found: dict[int, range] = {}
    for match in pattern.finditer(code):
        index, first = int(match[1]), int(match[2] or 0)
        found[index] = range(first, min(count, first + rows.get(index, count) * columns.get(index, 1)))
    return found


def _and(sections: list[str]) -> str:
    *first, last = (section.lower() for section in sorted(sections, key=SECTIONS.index))
    return f"{', '.join(first)} and {last}" if first else last
