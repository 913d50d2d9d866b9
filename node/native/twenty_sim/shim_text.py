"""The C that both kinds of shim for 20-sim's C code share: declarations of its globals, and what is done with them."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.node.native.twenty_sim.c_text import Function
from segway_ecc.node.native.twenty_sim.parts import Parts

HOOK: Final = "ecc_before_initial"
"""Our function at the head of the initial equations; it sets the parameters that were written."""
BOTH: Final = "ecc_real *u, ecc_real *y"
UNUSED: Final = "(void) u; (void) y;"
_WANTED: Final = ("P", "s", "R", "V", "M", "time", "steps", "major", "initialize", "stop_simulation")
_TIMES: Final = ("start_time", "step_size")


def define(name: str, lines: Sequence[str], *, arguments: str = "void", result: str = "void") -> str:
    """Return a function of the shim, on one line."""
    return f"static {result} {name}({arguments}) {{ {' '.join(line for line in lines if line)} }}"


def has_hook(parts: Parts) -> bool:
    """Return whether the model's file has initial equations at whose head our call can stand."""
    initial = parts.functions.get("CalculateInitial")
    return initial is not None and initial.name in parts.model.functions


def hook_declared(parts: Parts) -> str:
    """Return the declaration of our call."""
    linkage = 'extern "C"' if parts.is_cpp else "extern"
    return f"{linkage} void {HOOK}(void); "


def declared_globals(parts: Parts) -> list[str]:
    """Return declarations of the model's globals, and the functions over them that both C shapes have."""
    stop = variable(parts, "stop_simulation", "0")
    return [
        *(_declare(parts, name) for name in (*_WANTED, *_TIMES) if name in parts.symbols),
        *(prototype(parts, parts.functions[role]) for role in _ONCE if role in parts.functions),
        define("ecc_drop", []),
        define("ecc_statics", run(parts, "CalculateStatic")),
        define("ecc_rates", _rates(parts)),
        define("ecc_stopped", [f"return {stop} != 0;"], result="int"),
        define("ecc_parameters", [f"return {variable(parts, 'P', '0')};"], result="ecc_real *"),
        define("ecc_states", [f"return {variable(parts, 's', '0')};"], result="ecc_real *"),
    ]


_ONCE: Final = ("CalculateStatic", "CalculateDynamic")


def _rates(parts: Parts) -> list[str]:
    """The dynamic equations once more; the count of evaluations is the model's own business and is left as it was."""
    dynamic = run(parts, "CalculateDynamic")
    if "steps" not in parts.symbols:
        return dynamic
    steps = f"{parts.prefix}steps"
    return [f"{_type(parts, 'steps')} kept = {steps};", *dynamic, f"{steps} = kept;"]


def run(parts: Parts, *roles: str) -> list[str]:
    """Return calls of those of the model's functions that it has."""
    return [f"{parts.functions[role].name}();" for role in roles if role in parts.functions]


def assign(parts: Parts, name: str, value: str) -> list[str]:
    """Return an assignment to a global of the model, if it has that one."""
    return [f"{parts.prefix}{name} = {value};"] if name in parts.symbols else []


def variable(parts: Parts, name: str, otherwise: str = "0.0") -> str:
    """Return the full name of a global of the model, or something else where it has none."""
    return f"{parts.prefix}{name}" if name in parts.symbols else otherwise


def arguments_of(function: Function) -> list[str]:
    """Return the arguments of a function, as they are written."""
    return [] if function.arguments in ("", "void") else [part.strip() for part in function.arguments.split(",")]


def is_vector(argument: str) -> bool:
    """Return whether an argument is an array."""
    return "*" in argument or "[" in argument


def prototype(parts: Parts, function: Function) -> str:
    """Return the declaration of one of the model's functions."""
    arguments = ["ecc_real *" if is_vector(argument) else "ecc_real" for argument in arguments_of(function)]
    result = "ecc_real" if function.result.endswith("Double") else parts.types.get(function.result, function.result)
    return f"extern {result} {function.name}({', '.join(arguments) or 'void'});"


def _type(parts: Parts, name: str) -> str:
    kind = parts.symbols[name].kind
    return "ecc_real" if kind.endswith("Double") else parts.types.get(kind, kind)


def _declare(parts: Parts, name: str) -> str:
    symbol = parts.symbols[name]
    kind, before = _type(parts, name), ""
    if symbol.kind.endswith("Matrix"):
        # Its type is a struct of the model's headers, which only a port within a matrix needs.
        integer = parts.types.get(f"{symbol.kind.removesuffix('Matrix')}Integer", "int")
        kind, before = "ecc_matrix", f"typedef struct {{ ecc_real *mat; {integer} rows, columns; }} ecc_matrix; "
    star, brackets = "*" if symbol.is_pointer else "", "[]" if symbol.is_array else ""
    return f"{before}extern {kind} {star}{parts.prefix}{name}{brackets};"
