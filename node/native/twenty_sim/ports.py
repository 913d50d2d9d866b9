# SPDX-License-Identifier: MIT
r"""The input and output ports of a 20-sim model: where u and y go, and what they are called.

Generated code copies them itself (`xx_V[7] = u[0]; /* in */`). A partial copy lacks those lines; `tokens.xml` repeats
them (`INPUT_TO_VARIABLE_EQUATIONS`). Without both, an input is a variable that is used and never set, and an output one
that is set and whose name has no `\`, which only ports of the submodel lack; 20-sim numbers both in that order.
"""

import re
from dataclasses import dataclass
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.twenty_sim.c_text import code_of, comment_at
from segway_ecc.node.native.twenty_sim.names import Label, Table, label_of
from segway_ecc.node.native.twenty_sim.parts import Parts

_INPUT: Final = re.compile(r"(?P<place>[^;{}=]+)=\s*u\s*\[\s*(?P<index>\d+)\s*\]\s*;")
_OUTPUT: Final = re.compile(r"(?<!\w)y\s*\[\s*(?P<index>\d+)\s*\]\s*=(?!=)(?P<place>[^;]*);")
_COPYING: Final = ("CopyInputsToVariables", "CopyVariablesToOutputs", "InitializeSubmodel", "CalculateSubmodel")
_EQUATION: Final = re.compile(r"/\*\s*([^=*;]+?)\s*=(?:(?!\*/).)*\*/\s*(\w+)\s*\[\s*(\d+)\s*\]\s*=")
_COPY: Final = re.compile(
    r"/\*\s*[^=*;]+?\s*=\s*([^=*;()+\-/]+?)\s*;\s*\*/\s*\w+\s*\[\s*\d+\s*\]\s*=\s*(\w+)\[(\d+)\]\s*;"
)


@dataclass(frozen=True, slots=True)
class Port:
    """One port: the variable of the code that it is copied to or from, and its label."""

    place: str
    label: Label


@dataclass(frozen=True, slots=True)
class Ports:
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
