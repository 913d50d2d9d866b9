# SPDX-License-Identifier: MIT
"""The variables of a model as a robot declares them: in which range, and whether tunable while it is armed."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import TypeAlias

from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import Model, Variable, Write, refusal_of

Range: TypeAlias = tuple[float | None, float | None]
"""The least and the largest value of a variable, in its unit; None for what the model allows."""


def declared_variables(
    model: Model, ranges: Mapping[str, Range] | None = None, tunable: Collection[str] = ()
) -> dict[str, Variable]:
    """The inputs, states and parameters by name; of equal names the state, then the parameter counts.

    Args:
        model: The model, not yet initialized: what it reads as is what it starts from.
        ranges: Narrower than those of the model.
        tunable: Names of those that may be written while the robot is armed, beside those that the model declares.

    Raises:
        UnknownNameError: The model has no such variable.
        ConfigurationError: A range is empty, or wider than the model's; or a parameter's value is not in it.
    """
    found = {v.name: v for v in (*reversed(model.inputs), *reversed(model.parameters), *reversed(model.states))}
    for where, names in (("model.ranges", ranges or {}), ("model.tunable_while_armed", tunable)):
        for name in names:
            if name not in found:
                raise UnknownNameError(f"input, state or parameter of model '{model.name}' ({where})", name, found)
    for name, (low, high) in (ranges or {}).items():
        found[name] = _narrowed(found[name], low, high)
    for name in tunable:
        if found[name].write is Write.NEVER:
            why = found[name].why or "the model never takes it while it runs"
            raise ConfigurationError(f"model.tunable_while_armed: '{name}' cannot be written: {why}")
        found[name] = replace(found[name], tunable=True)
    for variable in model.parameters:
        declared = found[variable.name]
        refusal = "" if declared.write is Write.NEVER else refusal_of(declared, model.read(variable.name))
        if refusal:
            raise ConfigurationError(f"model.parameters: {refusal}")
    return found


def _narrowed(variable: Variable, low: float | None, high: float | None) -> Variable:
    minimum = variable.minimum if low is None else low
    maximum = variable.maximum if high is None else high
    narrowed = replace(variable, minimum=minimum, maximum=maximum)
    if not variable.minimum <= minimum <= maximum <= variable.maximum:
        allowed = variable.range_text or "any finite number"
        text = f"is no range of '{variable.name}', which the model allows to be {allowed}: the least comes first"
        raise ConfigurationError(f"model.ranges: [{minimum:g}, {maximum:g}] {text}")
    return narrowed
