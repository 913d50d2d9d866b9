# SPDX-License-Identifier: MIT
r"""The ports of a 20-sim model, and the names and units of all its variables: from its code, and the XML beside it.

Formats: a comment `PID1\kp {V}` behind the line that sets an array's element; `<token name="PARAMETER_NAMES3">` in
`tokens.xml` or `<Submodel>_tokens.xml`, one name a line, with `PARAMETER_UNITS` in step; and `ModelConfiguration.xml`,
where each variable has a name, a unit, and a storage of name and index. The code decides: the XML may be older.

Generated code copies ports itself (`xx_V[7] = u[0]; /* in */`). A partial copy lacks those lines; `tokens.xml` repeats
them (`INPUT_TO_VARIABLE_EQUATIONS`). Without both, an input is a variable that is used and never set, and an output one
that is set and whose name has no `\`, which only ports of the submodel lack; 20-sim numbers both in that order.
"""

import itertools
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.twenty_sim.files import SourceFile, code_of, comment_at
from segway_ecc.node.native.twenty_sim.parts import Parts

_LABEL: Final = re.compile(r"(.*?)\s*(?:\{([^{}]*)\})?\s*$")
_QUOTED: Final = re.compile(r'"((?:\\.|[^"\\])*)"')
TOKEN_KINDS: Final = {"input": "INPUT", "output": "OUTPUT", "parameter": "PARAMETER", "state": "STATE"}


class Label(NamedTuple):
    """A name and its unit; either may be empty where it is not known."""

    name: str = ""
    unit: str = ""


class Table(NamedTuple):
    """The content of the XML files, of which `file` is named in messages: tokens by name, and labels by kind."""

    file: str
    tokens: Mapping[str, str]
    labels: Mapping[str, Sequence[Label]]
    warnings: tuple[str, ...] = ()


def label_of(comment: str) -> Label:
    """Return the name and unit in a comment of the code."""
    match = _LABEL.match(comment)
    return Label(match[1].strip(), (match[2] or "").strip()) if match else Label()


def read_tables(files: Sequence[SourceFile]) -> Table:
    """Read the XML files of the folder; what is not 20-sim's is passed over."""
    file, tokens, labels, warnings = "", dict[str, str](), dict[str, Sequence[Label]](), list[str]()
    for source in files:
        try:
            root = ET.fromstring(source.content)  # noqa: S314 - the user's own file, beside code that is about to run
        except ET.ParseError as error:
            warnings.append(f"{source.name} cannot be read ({error}): names come from the code's comments")
            continue
        found = {token.get("name", ""): token.text or "" for token in root.iter("token")}
        stored = _stored(root)
        if found or stored:
            file = file or source.name
        tokens |= found
        for kind, token in TOKEN_KINDS.items():
            plain = [line.strip() for line in found.get(f"{token}_NAMES3", "").split("\n") if line.strip()]
            quoted = _QUOTED.findall(found.get(f"{token}_NAMES", ""))
            if names := plain or [name.replace("\\\\", "\\").replace('\\"', '"') for name in quoted]:
                units = [line.strip() for line in found.get(f"{token}_UNITS", "").split("\n")]
                labels[kind] = list(map(Label, names, [*units, *[""] * (len(names) - len(units))]))
        labels |= stored
    return Table(file, tokens, labels, tuple(warnings))


def choose(kind: str, coded: Sequence[Label], table: Table, warnings: list[str]) -> list[Label]:
    """Return the labels of one kind, the code's completed by the XML's where the two agree.

    Args:
        kind: "input", "output", "parameter" or "state".
        coded: The comments in the code; as many as there are elements.
        table: The XML.
        warnings: Gains a line where the XML is not of this code.
    """
    listed = table.labels.get(kind, ())
    if not listed:
        return list(coded)
    if len(listed) != len(coded):
        warnings.append(f"{table.file} lists {len(listed)} {kind}s and the code has {len(coded)}: the code is followed")
        return list(coded)
    differ = [(a.name, b.name) for a, b in zip(coded, listed, strict=True) if a.name and b.name and a.name != b.name]
    if differ:
        ours, theirs = differ[0]
        warnings.append(f"{table.file} calls {kind} '{ours}' of the code '{theirs}': the code is followed")
        return list(coded)
    return [Label(a.name or b.name, a.unit or b.unit) for a, b in zip(coded, listed, strict=True)]


def unique(names: Mapping[str, Sequence[Label]], warnings: list[str]) -> dict[str, list[str]]:
    """Return a name for each element that no other element of the model has.

    Args:
        names: Labels per kind; kinds earlier in the order keep their names.
        warnings: Gains a line per name that had to be made.
    """
    taken: set[str] = set()
    result: dict[str, list[str]] = {}
    for kind, labels in names.items():
        result[kind] = []
        for index, label in enumerate(labels):
            plain = f"{kind}[{index}]"
            given = [label.name, f"{label.name} ({kind})"] if label.name else []
            numbered = (f"{plain} ({number})" for number in itertools.count(2))
            name = next(name for name in itertools.chain(given, [plain], numbered) if name not in taken)
            if name != label.name:
                trouble = f"the name '{label.name}' of another variable" if label.name else "no name in the code"
                warnings.append(f"{kind} {index} has {trouble}: it is called '{name}' here")
            taken.add(name)
            result[kind].append(name)
    return result


def _stored(root: ET.Element) -> dict[str, list[Label]]:
    """Labels from a model configuration, for the arrays whose place it gives."""
    found: dict[str, dict[int, Label]] = {}
    for element in root.iter():
        storage, name = _child(element, "storage"), _child(element, "name")
        if storage is None or name is None:
            continue
        array, index = _text(_child(storage, "name")), _text(_child(storage, "index"))
        kind = {"P": "parameter", "s": "state"}.get(array[-1:])
        if kind and index.isdigit():
            unit = _child(element, "unit")
            symbol = None if unit is None else _child(unit, "symbol")
            found.setdefault(kind, {}).setdefault(int(index), Label(_text(name), _text(symbol) or _text(unit)))
    return {kind: [labels.get(i, Label()) for i in range(max(labels) + 1)] for kind, labels in found.items()}


def _child(element: ET.Element, name: str) -> ET.Element | None:
    return next((child for child in element if child.tag.rpartition("}")[2].lower() == name), None)


def _text(element: ET.Element | None) -> str:
    return "" if element is None else (element.text or "").strip()


_INPUT: Final = re.compile(r"(?P<place>[^;{}=]+)=\s*u\s*\[\s*(?P<index>\d+)\s*\]\s*;")
_OUTPUT: Final = re.compile(r"(?<!\w)y\s*\[\s*(?P<index>\d+)\s*\]\s*=(?!=)(?P<place>[^;]*);")
_COPYING: Final = ("CopyInputsToVariables", "CopyVariablesToOutputs", "InitializeSubmodel", "CalculateSubmodel")
_EQUATION: Final = re.compile(r"/\*\s*([^=*;]+?)\s*=(?:(?!\*/).)*\*/\s*(\w+)\s*\[\s*(\d+)\s*\]\s*=")
_COPY: Final = re.compile(
    r"/\*\s*[^=*;]+?\s*=\s*([^=*;()+\-/]+?)\s*;\s*\*/\s*\w+\s*\[\s*\d+\s*\]\s*=\s*(\w+)\[(\d+)\]\s*;"
)


class Port(NamedTuple):
    """One port: the variable of the code that it is copied to or from, and its label."""

    place: str
    label: Label


class Ports(NamedTuple):
    """The ports, and what a user should know of how they were found."""

    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    warnings: tuple[str, ...] = ()


def find_ports(parts: Parts, table: Table) -> Ports:
    """Find the ports.

    Raises:
        ModelError: They are copied in an order that has gaps.
    """
    copying = [parts.functions[role].text for role in _COPYING if role in parts.functions]
    if copying:
        return _copied(copying)
    listed = [table.tokens.get(name, "") for name in ("INPUT_TO_VARIABLE_EQUATIONS", "VARIABLE_TO_OUTPUT_EQUATIONS")]
    if any(listed):
        return _copied(listed)
    array = f"{parts.prefix}V"
    code = "\n".join(parts.sections().values())
    every = {int(index) for index in re.findall(rf"(?<!\w){array}\s*\[\s*(\d+)\s*\]", code)}
    assigned = {int(index) for index in re.findall(rf"(?<!\w){array}\s*\[\s*(\d+)\s*\]\s*=(?!=)", code)}
    # Names of variables: from the table that the code keeps in a comment, else from above the equations.
    text = parts.model.text
    tables = re.findall(r"variable_names\s*\[\s*\]\s*=\s*\{(.*?)\}", text, re.DOTALL)
    listing = next(filter(None, (re.findall(r'"((?:\\.|[^"\\])*)"', each) for each in tables)), [])
    found = (match for pattern in (_COPY, _EQUATION) for match in pattern.finditer(text))
    names = {index: name.replace("\\\\", "\\") for index, name in enumerate(listing)} or {
        int(match[3]): match[1] for match in found if match[2] == array
    }
    inputs = sorted(every - assigned)
    outputs = [index for index in sorted(assigned) if (name := names.get(index, "")) and "\\" not in name]
    warning = (
        f"{parts.model.name} does not name its ports (xxsubmod and tokens.xml are missing): "
        f"inputs are taken to be {_listed(names, inputs)} and outputs {_listed(names, outputs)}"
    )
    return Ports(
        tuple(Port(f"{array}[{index}]", Label(names.get(index, ""))) for index in inputs),
        tuple(Port(f"{array}[{index}]", Label(names.get(index, ""))) for index in outputs),
        (warning,),
    )


def _copied(texts: list[str]) -> Ports:
    found: dict[str, dict[int, Port]] = {"u": {}, "y": {}}
    for text in texts:
        code = code_of(text)
        for array, pattern in (("u", _INPUT), ("y", _OUTPUT)):
            for match in pattern.finditer(code):
                port = Port(match["place"].strip(), label_of(comment_at(text, match.end())))
                found[array].setdefault(int(match["index"]), port)
    for array, ports in found.items():
        gap = next((index for index in range(len(ports)) if index not in ports), None)
        if gap is not None:
            raise ModelError(f"the code copies {len(ports)} elements of {array} and leaves out {array}[{gap}]")
    inputs, outputs = (tuple(ports[index] for index in sorted(ports)) for ports in found.values())
    return Ports(inputs, outputs)


def _listed(names: dict[int, str], indices: list[int]) -> str:
    return ", ".join(f"'{names.get(index) or index}'" for index in indices) or "none"
