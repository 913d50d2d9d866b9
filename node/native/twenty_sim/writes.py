# SPDX-License-Identifier: MIT
"""When a write to a parameter or a state of a 20-sim model takes effect, read from the equations themselves.

20-sim sorts its equations: initial and static ones run once, input, dynamic and output ones at every step. A parameter
acts where it is read, and nowhere else: what 20-sim folded into a literal number has no place left to be written to.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from segway_ecc.node.model.variables import Write
from segway_ecc.node.native.twenty_sim.parts import SECTIONS, Parts

_RUNNING: Final = ("Input", "Dynamic", "Output", "Final")


class Effect(NamedTuple):
    """When a write takes effect, and what decides that."""

    write: Write
    why: str


class _Uses(NamedTuple):
    """The sections in which an element is read, and those in which it is set."""

    read: tuple[str, ...]
    set: tuple[str, ...]


def parameter_effects(parts: Parts, count: int) -> list[Effect]:
    """Return the effect of a write for each parameter, in order."""
    texts = {
        index
        for index, element in enumerate(parts.elements("P"))
        if re.match(r"\w*String2Double\b", element.value) or element.value.startswith('"')
    }
    uses = _uses(parts, "P", count)
    return [Effect(Write.NEVER, "it is a text") if i in texts else _parameter(uses[i]) for i in range(count)]


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
            effects.append(Effect(Write.NEVER, f"the {_and(computed)} equations set it themselves"))
        elif index in rates and rates[index] <= {"0.0", "0"}:
            effects.append(Effect(Write.NOW, "its rate is zero, so it keeps what is written"))
        else:
            effects.append(Effect(Write.NOW, "a state; the model moves on from what is written"))
    return effects


def _parameter(uses: _Uses) -> Effect:
    if uses.set:
        return Effect(Write.NEVER, f"the {_and(uses.set)} equations compute it")
    if "Static" in uses.read:
        others = [section for section in uses.read if section != "Static"]
        more = f" and {_and(others)}" if others else ""
        return Effect(Write.STATIC, f"read by the static{more} equations; a write runs the static ones again")
    if running := [section for section in uses.read if section in _RUNNING]:
        more = "; by the initial ones at reset" if "Initial" in uses.read else ""
        return Effect(Write.NOW, f"read by the {_and(running)} equations{more}")
    if uses.read:
        return Effect(Write.RESET, "read by the initial equations only")
    return Effect(Write.NEVER, "no equation reads it: it has no effect, or its value is compiled in as a number")


def _uses(parts: Parts, letter: str, count: int) -> list[_Uses]:
    read: list[list[str]] = [[] for _ in range(count)]
    assigned: list[list[str]] = [[] for _ in range(count)]
    matrices = _matrices(parts, letter, count)
    for section, body in parts.sections().items():
        for index, is_set in _references(parts, letter, body, matrices, count):
            places = assigned if is_set else read
            if section not in places[index]:
                places[index].append(section)
    return [_Uses(tuple(r), tuple(a)) for r, a in zip(read, assigned, strict=True)]


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


def _and(sections: tuple[str, ...] | list[str]) -> str:
    *first, last = (section.lower() for section in sorted(sections, key=SECTIONS.index))
    return f"{', '.join(first)} and {last}" if first else last
