# SPDX-License-Identifier: MIT
"""The description of a 20-sim model, put together from its code, its comments and its XML."""

import re
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.variables import Variable, Write
from segway_ecc.node.native.description import Description, Flavour
from segway_ecc.node.native.twenty_sim.names import Table, choose, label_of, unique
from segway_ecc.node.native.twenty_sim.parts import METHODS, Parts, find_method, number, setting
from segway_ecc.node.native.twenty_sim.ports import Ports
from segway_ecc.node.native.twenty_sim.writes import Effect, parameter_effects, state_effects

_ASK: Final = "pass {} to load_model"


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
    elements = {"parameter": parts.elements("P"), "state": parts.elements("s")}
    labels = {
        "input": choose("input", [port.label for port in ports.inputs], table, warnings),
        "output": choose("output", [port.label for port in ports.outputs], table, warnings),
        **{
            kind: choose(kind, [label_of(element.comment) for element in found], table, warnings)
            for kind, found in elements.items()
        },
    }
    names = unique(labels, warnings)
    initial = {
        f"{parts.prefix}I[{index}]": value
        for index, element in enumerate(parts.elements("I"))
        if (value := number(element.value)) is not None
    }
    starts = {kind: [number(each.value, initial) or 0.0 for each in found] for kind, found in elements.items()}
    effects = {
        "parameter": parameter_effects(parts, len(elements["parameter"])),
        "state": state_effects(parts, len(elements["state"])),
    }
    variables = {
        kind: tuple(
            Variable(name, label.unit or "1", value, *effect)
            for name, label, value, effect in zip(
                names[kind],
                found,
                starts.get(kind) or [0.0] * len(found),
                effects.get(kind) or [Effect(Write.NEVER, "")] * len(found),
                strict=True,
            )
        )
        for kind, found in labels.items()
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
        + _ASK.format(f"method=, one of {', '.join(METHODS)}")
    )


def _step_size(parts: Parts, table: Table, given: float | None, warnings: list[str]) -> float:
    found = setting(parts, "step_size")
    if found is not None and given is not None and found != given:
        raise ModelError(
            f"the code in {parts.folder.path} has a step of {found:g} s; it cannot be made to use {given:g} s"
        )
    step = given if found is None else found
    if step is None:
        raise ModelError(f"{parts.folder.path} gives no step size: " + _ASK.format("step_size= in s"))
    if step <= 0.0:
        raise ModelError(f"{parts.folder.path} has a step of {step:g} s, and a step must be longer than zero")
    listed = re.fullmatch(r"\s*([-+.\deE]+)\s*", table.tokens.get("TIME_STEP_SIZE", ""))
    if listed and (other := number(listed[1])) is not None and other != step:
        warnings.append(f"{table.file} gives a step of {other:g} s and the code has {step:g} s: the code is followed")
    return step
