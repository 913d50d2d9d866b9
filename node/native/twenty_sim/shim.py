# SPDX-License-Identifier: MIT
"""The C (or C++) that joins a 20-sim model to our interface: what differs from model to model, as one header.

`shim.c` is the same for all and includes the header written here. Three habits of the generated code are
dealt with: time is the model's own, which its integration method advances, so it is handed its own time; a C++ model
stops by itself at a time that is baked in, so that is lifted; and parameters are set to their defaults on the way into
the initial equations, so a call of ours is put at their head (in our copy of the file). For a partial copy of 20-sim's
C code, what its owner left behind is supplied from our side.

Generated code names data files as 20-sim did, often with a path of the Windows machine that generated it, and opens
them below whatever folder the process happens to run in. So their content goes into the shared object, where the
shim's `fopen` finds it by the last part of the name.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.library import Description, Flavour
from segway_ecc.node.native.twenty_sim.files import TREE, Function, code_of
from segway_ecc.node.native.twenty_sim.names import Ports
from segway_ecc.node.native.twenty_sim.parts import METHODS, SECTIONS, Parts

_HOOK: Final = "ecc_before_initial"
"""Our function at the head of the initial equations; it sets the parameters that were written."""
_BOTH: Final = "ecc_real *u, ecc_real *y"
_UNUSED: Final = "(void) u; (void) y;"
_GLOBALS: Final = (
    *("P", "s", "R", "V", "M", "time", "steps", "major", "initialize", "stop_simulation"),
    *("start_time", "step_size"),
)
_ENTRIES: Final = (
    ("ecc_start", "InitializeSubmodel", "start_time"),
    ("ecc_advance", "CalculateSubmodel", "time"),
    ("ecc_finish", "TerminateSubmodel", "time"),
)
_FORMULAS: Final = {
    "Discrete": "{each} {s} = {r}; {time} += {h};",
    "Euler": "{each} {s} = {s} + {r} * {h}; {time} += {h};",
    "RungeKutta2": (
        "ecc_real q[{n}], t = {time};"
        " {each} {{ q[i] = {s}; {s} = q[i] + {r} * 0.5 * {h}; }}"
        " {time} = t + 0.5 * {h}; {minor} {rates}"
        " {each} {s} = q[i] + {r} * {h};"
        " {time} = t + {h};"
    ),
    "RungeKutta4": (
        "static const ecc_real sixth = 1.0 / 6.0;"
        " ecc_real q[{n}], a[{n}], b[{n}], c[{n}], d, t = {time};"
        " {each} {{ q[i] = {s}; a[i] = {r} * {h}; {s} = q[i] + a[i] / 2; }}"
        " {time} = t + {h} / 2; {minor} {rates}"
        " {each} {{ b[i] = {r} * {h}; {s} = q[i] + b[i] / 2; }} {rates}"
        " {each} {{ c[i] = {r} * {h}; {s} = q[i] + c[i]; }} {time} = t + {h}; {rates}"
        " {each} {{ d = {r} * {h}; {s} = q[i] + (a[i] + b[i] + b[i] + c[i] + c[i] + d) * sixth; }}"
    ),
}


def make_shim(parts: Parts, description: Description, ports: Ports) -> tuple[str, bytes]:
    """Write the shim of a model.

    Args:
        parts: The parts of the code.
        description: What is known of it; decides the counts, the start values and, for partial copies, the method.
        ports: Its ports, for partial copies.

    Returns:
        The text of ecc_model.h, and the model's file with our call at the head of its initial equations.

    Raises:
        ModelError: A partial copy lacks what cannot be supplied, or a file that the code reads is not in the folder.
    """
    if parts.flavour is Flavour.CPP_CLASS:
        body = _class(parts)
    elif parts.flavour is Flavour.C_SUBMODEL:
        body = _declared_globals(parts)
        for name, role, time in _ENTRIES:
            call = ""
            if entry := parts.functions.get(role):
                body.append(_prototype(parts, entry))
                call = _call(parts, entry, _variable(parts, time))
            body.append(_define(name, [_UNUSED, call], arguments=_BOTH))
    else:
        body = _partial(parts, description, ports)
    starts = {"ecc_parameter_starts": description.parameters, "ecc_state_starts": description.states}
    head = [
        "/* Written by segway-ecc for one model. */",
        f"typedef {parts.real} ecc_real;",
        f"#define ECC_INPUTS {len(description.inputs)}",
        f"#define ECC_OUTPUTS {len(description.outputs)}",
        f"#define ECC_PARAMETERS {len(description.parameters)}",
        f"#define ECC_STEP {description.step_size!r}",
        *(
            f"static const double {name}[] = {{{', '.join([*(repr(v.value) for v in variables), '0.0'])}}};"
            for name, variables in starts.items()
        ),
        *_embedded(_read_data(parts)),
    ]
    return "\n".join([*head, *body, ""]), _hooked(parts)


def _read_data(parts: Parts) -> dict[str, bytes]:
    """The content of each data file that the code names in a call, by its name without folders."""
    found: dict[str, bytes] = {}
    prefix = next((name.removesuffix("Double") for name in parts.types if name.endswith("Double")), "")
    call = re.compile(rf"\b(?:{re.escape(prefix)}(?:Data|Table\w*)|fopen)\s*\(\s*\"((?:\\.|[^\"\\\n])+)\"(?!\s*\"?w)")
    for source in parts.folder.sources:
        for written in call.findall(code_of(source.text, keep_strings=True)):
            name = re.split(r"[\\/]+", written)[-1]
            place = parts.folder.data.get(name.lower())
            if place is None:
                where = f"{source.name} in {parts.folder.path}"
                raise ModelError(f"{where} reads {name}, which is not in the folder: add it")
            try:
                found[name] = place.read_bytes()
            except OSError as error:
                raise ModelError(f"cannot read {place}, which {source.name} reads: {error}") from error
    return found


def _has_hook(parts: Parts) -> bool:
    initial = parts.functions.get("CalculateInitial")
    return initial is not None and initial.name in parts.model.functions


def _hook_declared(parts: Parts) -> str:
    linkage = 'extern "C"' if parts.is_cpp else "extern"
    return f"{linkage} void {_HOOK}(void); "


def _hooked(parts: Parts) -> bytes:
    """The model's file with a call at the head of its initial equations; line numbers stay what they are."""
    model = parts.model
    if not _has_hook(parts):
        return model.content
    start = parts.functions["CalculateInitial"].start
    # C++ takes a linkage only outside of functions.
    declared = _hook_declared(parts)
    before, inside = (f"{declared}\n#line 1\n", "") if parts.is_cpp else ("", declared)
    return f"{before}{model.text[:start]} {{ {inside}{_HOOK}(); }}{model.text[start:]}".encode(model.encoding)


def _call(parts: Parts, entry: Function, time: str) -> str:
    """A call with u, y and t where the prototype has them; a lone vector is u unless its name begins with y."""
    given = []
    for argument in _arguments_of(entry):
        name = argument.replace("*", " ").partition("[")[0].split()[-1]
        given.append(time if not _is_vector(argument) else "y" if name.lower().startswith("y") else "u")
    if given.count("u") > 1 or given.count("y") > 1:
        raise ModelError(f"{parts.model.name}: cannot distinguish u from y among the arguments of {entry.name}")
    return f"{entry.name.rpartition('::')[2]}({', '.join(given)});"


def _class(parts: Parts) -> list[str]:
    owner, names, it = parts.owner, parts.functions, "ecc_it->"
    declaration = re.compile(rf"\bclass\s+{re.escape(owner)}\b[^;{{]*\{{")
    header = next((header for header in parts.folder.headers if declaration.search(header.code)), None)
    if header is None:
        raise ModelError(f"{parts.folder.path} lacks the header that declares class {owner}: add it")
    # Zero lifts the end of the experiment; releases without that call compare with it, so it is put out of reach.
    endless = "SetFinishTime(0.0)" if "SetFinishTime" in names else f"{parts.prefix}finish_time = 1e300"
    calls = {
        role: it + _call(parts, names[role], f"{it}{parts.prefix}{time}")
        for role, time in (("Initialize", "start_time"), ("Calculate", "time"), ("Terminate", "time"))
        if role in names
    }
    stopped = f"{it}state == {owner}::finished" if "finished" in header.code else f"{it}{parts.prefix}stop_run"
    start = [_UNUSED, f"ecc_it = new {owner}();", calls["Initialize"], f"{it}{endless};"]
    return [
        f'#include "{TREE}/{header.name}"',
        f"static {owner} *ecc_it;",
        _define("ecc_drop", ["delete ecc_it; ecc_it = 0;"]),
        _define("ecc_statics", [f"{it}CalculateStatic();"]),
        _define("ecc_rates", [f"{it}CalculateDynamic();"]),
        _define("ecc_stopped", [f"return {stopped};"], result="int"),
        _define("ecc_parameters", [f"return {it}{parts.prefix}P;"], result="ecc_real *"),
        _define("ecc_states", [f"return {it}{parts.prefix}s;"], result="ecc_real *"),
        _define("ecc_start", start, arguments=_BOTH),
        _define("ecc_advance", [_UNUSED, calls["Calculate"]], arguments=_BOTH),
        _define("ecc_finish", [_UNUSED, calls.get("Terminate", "")], arguments=_BOTH),
    ]


def _partial(parts: Parts, description: Description, ports: Ports) -> list[str]:
    """The shim of a partial copy, which runs the sections in the order in which 20-sim's own entry points do."""
    method = description.method or METHODS[0]
    has_method = f"{method}Step" in parts.functions
    take = [f"{port.place} = u[{index}];" for index, port in enumerate(ports.inputs)]
    give = [f"y[{index}] = {port.place};" for index, port in enumerate(ports.outputs)]
    start = [
        *_assign(parts, "initialize", "1"),
        *_run(parts, "ModelInitialize", f"{method}Initialize"),
        *_assign(parts, "major", "1"),
        f"{parts.prefix}time = {_variable(parts, 'start_time')};",
        *take,
        "" if _has_hook(parts) else f"{_HOOK}();",
        *_run(parts, *(f"Calculate{name}" for name in SECTIONS if name != "Final")),
        *give,
        *_assign(parts, "initialize", "0"),
    ]
    step = _run(parts, f"{method}Step") or ["ecc_integrate();"]
    advance = [*take, *_run(parts, "CalculateInput"), *step, *_run(parts, "CalculateOutput"), *give]
    finish = [*take, *_run(parts, "CalculateFinal"), *give, *_run(parts, "ModelTerminate")]
    # The simulation variables that the copy lacks; `extern` in its headers agrees with them.
    values = {"time": "0.0", "step_size": repr(description.step_size)}
    return [
        *(f"ecc_real {parts.prefix}{name} = {value};" for name, value in values.items() if name not in parts.symbols),
        *_declared_globals(parts),
        _hook_declared(parts),
        *(_prototype(parts, function) for role, function in parts.functions.items() if not role.startswith("Copy")),
        *([] if has_method else [_integrator(parts, method, len(description.states))]),
        _define("ecc_start", [_UNUSED, *start], arguments=_BOTH),
        _define("ecc_advance", [_UNUSED, *advance], arguments=_BOTH),
        _define("ecc_finish", [_UNUSED, *finish], arguments=_BOTH),
    ]


def _integrator(parts: Parts, method: str, states: int) -> str:
    """One step of a method, in the order of operations of 20-sim's own, so that the last bit is the same.

    The formulas are those of node/model/sectioned.py; each begins with the rates at the end of the step before.
    """
    if method not in METHODS:
        raise ModelError(f"the method {method} is not among the files and not ours to supply: copy xxinteg.c too")
    p = parts.prefix
    names = {
        "each": f"for (i = 0; i < {states}; i++)",
        "n": str(states),
        "s": f"{p}s[i]",
        "r": f"{p}R[i]",
        "h": f"{p}step_size",
        "time": f"{p}time",
        "rates": "".join(_run(parts, "CalculateDynamic")),
        "minor": "".join(_assign(parts, "major", "0")),
        "major": "".join(_assign(parts, "major", "1")),
    }
    formula = _FORMULAS[method] if states else "{time} += {h};"
    # Braces of C are doubled in the formulas.
    return _define("ecc_integrate", ["int i; (void) i;", f"{formula} {{major}} {{rates}}".format(**names)])


def _define(name: str, lines: Sequence[str], *, arguments: str = "void", result: str = "void") -> str:
    return f"static {result} {name}({arguments}) {{ {' '.join(line for line in lines if line)} }}"


def _declared_globals(parts: Parts) -> list[str]:
    """Return declarations of the model's globals, and the functions over them that both C shapes have."""
    stop, dynamic = _variable(parts, "stop_simulation", "0"), _run(parts, "CalculateDynamic")
    if "steps" in parts.symbols:
        # The count of evaluations is the model's own business and is left as it was.
        steps = f"{parts.prefix}steps"
        dynamic = [f"{_c_type(parts, parts.symbols['steps'].kind)} kept = {steps};", *dynamic, f"{steps} = kept;"]
    declared = []
    for name, symbol in ((name, parts.symbols[name]) for name in _GLOBALS if name in parts.symbols):
        kind, before = _c_type(parts, symbol.kind), ""
        if symbol.kind.endswith("Matrix"):
            # Its type is a struct of the model's headers, which only a port within a matrix needs.
            integer = parts.types.get(f"{symbol.kind.removesuffix('Matrix')}Integer", "int")
            kind, before = "ecc_matrix", f"typedef struct {{ ecc_real *mat; {integer} rows, columns; }} ecc_matrix; "
        star, brackets = "*" if symbol.is_pointer else "", "[]" if symbol.is_array else ""
        declared.append(f"{before}extern {kind} {star}{parts.prefix}{name}{brackets};")
    once = ("CalculateStatic", "CalculateDynamic")
    return [
        *declared,
        *(_prototype(parts, parts.functions[role]) for role in once if role in parts.functions),
        _define("ecc_drop", []),
        _define("ecc_statics", _run(parts, "CalculateStatic")),
        _define("ecc_rates", dynamic),
        _define("ecc_stopped", [f"return {stop} != 0;"], result="int"),
        _define("ecc_parameters", [f"return {_variable(parts, 'P', '0')};"], result="ecc_real *"),
        _define("ecc_states", [f"return {_variable(parts, 's', '0')};"], result="ecc_real *"),
    ]


def _run(parts: Parts, *roles: str) -> list[str]:
    return [f"{parts.functions[role].name}();" for role in roles if role in parts.functions]


def _assign(parts: Parts, name: str, value: str) -> list[str]:
    return [f"{parts.prefix}{name} = {value};"] if name in parts.symbols else []


def _variable(parts: Parts, name: str, otherwise: str = "0.0") -> str:
    return f"{parts.prefix}{name}" if name in parts.symbols else otherwise


def _arguments_of(function: Function) -> list[str]:
    return [] if function.arguments in ("", "void") else [part.strip() for part in function.arguments.split(",")]


def _is_vector(argument: str) -> bool:
    return "*" in argument or "[" in argument


def _prototype(parts: Parts, function: Function) -> str:
    arguments = ["ecc_real *" if _is_vector(argument) else "ecc_real" for argument in _arguments_of(function)]
    return f"extern {_c_type(parts, function.result)} {function.name}({', '.join(arguments) or 'void'});"


def _c_type(parts: Parts, kind: str) -> str:
    return "ecc_real" if kind.endswith("Double") else parts.types.get(kind, kind)


def _embedded(data: Mapping[str, bytes]) -> list[str]:
    if not data:
        return []
    rows = ", ".join(f'{{"{name}", ecc_file_{index}, {len(data[name])}}}' for index, name in enumerate(data))
    table = "static const struct { const char *name; const unsigned char *content; unsigned long size; } ecc_files[]"
    contents = [
        f"static const unsigned char ecc_file_{index}[] = {{{', '.join(map(str, [*content, 0]))}}};"
        for index, content in enumerate(data.values())
    ]
    return [*contents, f"#define ECC_FILES {len(data)}", f"{table} = {{{rows}}};"]
