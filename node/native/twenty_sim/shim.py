"""The C (or C++) that joins a 20-sim model to our interface: what differs from model to model, as one header.

`shim.c` is the same for all and includes the header written here. Three habits of the generated code are
dealt with: time is the model's own, which its integration method advances, so it is handed its own time; a C++ model
stops by itself at a time that is baked in, so that is lifted; and parameters are set to their defaults on the way into
the initial equations, so a call of ours is put at their head (in our copy of the file).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.description import Description, Flavour
from segway_ecc.node.native.twenty_sim.c_text import Function
from segway_ecc.node.native.twenty_sim.data_files import embedded
from segway_ecc.node.native.twenty_sim.files import SourceFile
from segway_ecc.node.native.twenty_sim.includes import TREE
from segway_ecc.node.native.twenty_sim.parts import Parts
from segway_ecc.node.native.twenty_sim.ports import Ports
from segway_ecc.node.native.twenty_sim.shim_partial import partial_shim
from segway_ecc.node.native.twenty_sim.shim_text import (
    BOTH,
    HOOK,
    UNUSED,
    arguments_of,
    declared_globals,
    define,
    has_hook,
    hook_declared,
    is_vector,
    prototype,
    variable,
)


@dataclass(frozen=True, slots=True)
class Shim:
    """What is compiled beside the model's own files.

    Attributes:
        header: The text of ecc_model.h.
        source: The text of the file that includes it.
        model: The model's file, with our call at the head of its initial equations.
    """

    header: str
    source: str
    model: bytes


def make_shim(parts: Parts, description: Description, ports: Ports, data: Mapping[str, bytes]) -> Shim:
    """Write the shim of a model.

    Args:
        parts: The parts of the code.
        description: What is known of it; decides the counts, the start values and, for partial copies, the method.
        ports: Its ports, for partial copies.
        data: The files that it reads, by name.

    Raises:
        ModelError: A partial copy lacks what cannot be supplied.
    """
    if parts.flavour is Flavour.CPP_CLASS:
        body = _class(parts)
    elif parts.flavour is Flavour.C_SUBMODEL:
        body = _submodel(parts)
    else:
        body = partial_shim(parts, description, ports)
    head = [*_head(parts, description), *embedded(data)]
    source = resources.files("segway_ecc.node.native.twenty_sim").joinpath("shim.c").read_text(encoding="utf-8")
    return Shim("\n".join([*head, *body, ""]), source, _hooked(parts))


def _head(parts: Parts, description: Description) -> list[str]:
    return [
        "/* Written by segway-ecc for one model. */",
        f"typedef {parts.real} ecc_real;",
        f"#define ECC_INPUTS {len(description.inputs)}",
        f"#define ECC_OUTPUTS {len(description.outputs)}",
        f"#define ECC_PARAMETERS {len(description.parameters)}",
        _starts("ecc_parameter_starts", [v.value for v in description.parameters]),
        _starts("ecc_state_starts", [v.value for v in description.states]),
    ]


def _starts(name: str, values: Sequence[float]) -> str:
    return f"static const double {name}[] = {{{', '.join([*map(repr, values), '0.0'])}}};"


def _hooked(parts: Parts) -> bytes:
    """The model's file with a call at the head of its initial equations; line numbers stay what they are."""
    model = parts.model
    initial = parts.functions.get("CalculateInitial")
    if not has_hook(parts) or initial is None:
        return model.content
    # C++ takes a linkage only outside of functions.
    declared = hook_declared(parts)
    before, inside = (f"{declared}\n#line 1\n", "") if parts.is_cpp else ("", declared)
    head, rest = model.text[: initial.start], model.text[initial.start :]
    return f"{before}{head} {{ {inside}{HOOK}(); }}{rest}".encode(model.encoding)


def _submodel(parts: Parts) -> list[str]:
    names = parts.functions
    lines = declared_globals(parts)
    for name, role, time in _ENTRIES:
        call = ""
        if role in names:
            lines.append(prototype(parts, names[role]))
            call = _call(parts, names[role], variable(parts, time))
        lines.append(define(name, [UNUSED, call], arguments=BOTH))
    return lines


_ENTRIES: Final = (
    ("ecc_start", "InitializeSubmodel", "start_time"),
    ("ecc_advance", "CalculateSubmodel", "time"),
    ("ecc_finish", "TerminateSubmodel", "time"),
)


def _call(parts: Parts, entry: Function, time: str) -> str:
    """A call with u, y and t where the prototype has them; a lone vector is u if its name does not say y."""
    given = []
    for argument in arguments_of(entry):
        name = argument.replace("*", " ").partition("[")[0].split()[-1]
        given.append(time if not is_vector(argument) else "y" if name.lower().startswith("y") else "u")
    if given.count("u") > 1 or given.count("y") > 1:
        raise ModelError(f"{parts.model.name}: cannot tell u from y among the arguments of {entry.name}")
    return f"{entry.name.rpartition('::')[2]}({', '.join(given)});"


def _class(parts: Parts) -> list[str]:
    owner, names, it = parts.owner, parts.functions, "ecc_it->"
    # Zero lifts the end of the experiment; releases without that call compare with it, so it is put out of reach.
    endless = "SetFinishTime(0.0)" if "SetFinishTime" in names else f"{parts.prefix}finish_time = 1e300"
    calls = {
        role: it + _call(parts, names[role], f"{it}{parts.prefix}{time}")
        for role, time in (("Initialize", "start_time"), ("Calculate", "time"), ("Terminate", "time"))
        if role in names
    }
    header = _class_header(parts)
    stopped = f"{it}state == {owner}::finished" if "finished" in header.code else f"{it}{parts.prefix}stop_run"
    return [
        f'#include "{TREE}/{header.name}"',
        f"static {owner} *ecc_it;",
        define("ecc_drop", ["delete ecc_it; ecc_it = 0;"]),
        define("ecc_statics", [f"{it}CalculateStatic();"]),
        define("ecc_rates", [f"{it}CalculateDynamic();"]),
        define("ecc_stopped", [f"return {stopped};"], result="int"),
        define("ecc_parameters", [f"return {it}{parts.prefix}P;"], result="ecc_real *"),
        define("ecc_states", [f"return {it}{parts.prefix}s;"], result="ecc_real *"),
        define(
            "ecc_start", [UNUSED, f"ecc_it = new {owner}();", calls["Initialize"], f"{it}{endless};"], arguments=BOTH
        ),
        define("ecc_advance", [UNUSED, calls["Calculate"]], arguments=BOTH),
        define("ecc_finish", [UNUSED, calls.get("Terminate", "")], arguments=BOTH),
    ]


def _class_header(parts: Parts) -> SourceFile:
    pattern = re.compile(rf"\bclass\s+{re.escape(parts.owner)}\b[^;{{]*\{{")
    for header in parts.folder.headers:
        if pattern.search(header.code):
            return header
    raise ModelError(f"{parts.folder.path} lacks the header that declares class {parts.owner}: add it")
