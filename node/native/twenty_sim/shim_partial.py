"""Entry points for a partial copy of 20-sim's C code: what its owner left behind is supplied from our side."""

from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.description import Description
from segway_ecc.node.native.twenty_sim.parts import METHODS, Parts
from segway_ecc.node.native.twenty_sim.ports import Ports
from segway_ecc.node.native.twenty_sim.shim_text import (
    BOTH,
    HOOK,
    UNUSED,
    assign,
    declared_globals,
    define,
    has_hook,
    hook_declared,
    prototype,
    run,
    variable,
)

_AT_START: Final = tuple(f"Calculate{name}" for name in ("Initial", "Static", "Input", "Dynamic", "Output"))


def partial_shim(parts: Parts, description: Description, ports: Ports) -> list[str]:
    """Return the lines of the shim, which run the sections in the order in which 20-sim's own entry points do.

    Raises:
        ModelError: The method is neither among the files nor one that can be supplied.
    """
    method = description.method or METHODS[0]
    has_method = f"{method}Step" in parts.functions
    take = [f"{port.place} = u[{index}];" for index, port in enumerate(ports.inputs)]
    give = [f"y[{index}] = {port.place};" for index, port in enumerate(ports.outputs)]
    start = [
        *assign(parts, "initialize", "1"),
        *run(parts, "ModelInitialize", f"{method}Initialize"),
        *assign(parts, "major", "1"),
        f"{parts.prefix}time = {variable(parts, 'start_time')};",
        *take,
        "" if has_hook(parts) else f"{HOOK}();",
        *run(parts, *_AT_START),
        *give,
        *assign(parts, "initialize", "0"),
    ]
    step = run(parts, f"{method}Step") or ["ecc_integrate();"]
    advance = [*take, *run(parts, "CalculateInput"), *step, *run(parts, "CalculateOutput"), *give]
    finish = [*take, *run(parts, "CalculateFinal"), *give, *run(parts, "ModelTerminate")]
    return [
        *_supplied(parts, description),
        *declared_globals(parts),
        hook_declared(parts),
        *(prototype(parts, function) for role, function in parts.functions.items() if not role.startswith("Copy")),
        *([] if has_method else [_integrator(parts, method, len(description.states))]),
        define("ecc_start", [UNUSED, *start], arguments=BOTH),
        define("ecc_advance", [UNUSED, *advance], arguments=BOTH),
        define("ecc_finish", [UNUSED, *finish], arguments=BOTH),
    ]


def _supplied(parts: Parts, description: Description) -> list[str]:
    """The simulation variables that the copy lacks; `extern` in its headers agrees with them."""
    values = {"time": "0.0", "step_size": repr(description.step_size)}
    return [f"ecc_real {parts.prefix}{name} = {value};" for name, value in values.items() if name not in parts.symbols]


def _integrator(parts: Parts, method: str, states: int) -> str:
    """One step of a method, in the order of operations of 20-sim's own, so that the last bit is the same.

    The formulas are those of node/model/methods.py; each begins with the rates at the end of the step before.
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
        "rates": "".join(run(parts, "CalculateDynamic")),
        "minor": "".join(assign(parts, "major", "0")),
        "major": "".join(assign(parts, "major", "1")),
    }
    formula = _FORMULAS[method] if states else "{time} += {h};"
    # Braces of C are doubled in the formulas.
    return define("ecc_integrate", ["int i; (void) i;", f"{formula} {{major}} {{rates}}".format(**names)])


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
