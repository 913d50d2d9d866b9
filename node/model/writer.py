# SPDX-License-Identifier: MIT
"""Writes of a model's parameters and states from outside: tried, then applied whole between two steps, or refused."""

from collections.abc import Mapping, Sequence
from functools import partial
from math import isfinite
from typing import Final

from segway_ecc.node.errors import ModelError, UnknownNameError, exception_text
from segway_ecc.node.model.model import Model, Variable, Write, refusal_of
from segway_ecc.node.model.undo import keep_state

_LONGEST: Final = 300
"""Of a refusal, in characters: it is recorded."""

Values = Sequence[tuple[str, float]]
"""Variables by name, each with the value that it is to have, in its unit."""


class VariableWriter:
    """Writes variables of a model, all that are asked for together or none of them.

    A write is checked: each name, its range, and while the robot is armed that it is declared tunable then. It is
    tried on the model, whose state is kept: written through the static equations, and one step with the inputs of now,
    whose outputs must be finite. Then the state is put back to what it was after the write, or before it.

    Where the state cannot be kept, no step is tried; a write that fails is written back, and the model initialized anew
    if it runs. Since that is nothing to do to a robot that balances, such a model takes no write while it is armed.

    Attributes:
        written: How many writes were applied.
        refused: How many were refused.
    """

    def __init__(self, model: Model, variables: Mapping[str, Variable]) -> None:
        """Write to a model what is among `variables`, its inputs left out; see `declared_variables`."""
        ports = {v.name for v in model.inputs} - {v.name for v in (*model.states, *model.parameters)}
        self.written = 0
        self.refused = 0
        self._model = model
        self._variables = {name: variable for name, variable in variables.items() if name not in ports}

    def write(
        self, values: Values, u: Sequence[float] | None = None, *, is_armed: bool = False, is_sound: bool = True
    ) -> str:
        """Write; the reason where it is refused, else empty.

        Args:
            values: What is to be written, in this order.
            u: The inputs of now; None where the model is not initialized yet.
            is_armed: Whether the robot is, or is on its way there.
            is_sound: Whether the model's outputs are finite as it is: no step is tried of one that is to be mended.

        Raises:
            Exception: The state could not be put back: the model is not what it was. A model may raise anything.
        """
        refusal = next((text for name, value in values if (text := self._refusal(name, value, is_armed=is_armed))), "")
        refusal = refusal or self._try(values, u, is_armed=is_armed, is_sound=is_sound)
        refusal = refusal if len(refusal) <= _LONGEST else f"{refusal[:_LONGEST]}..."
        self.refused += bool(refusal)
        self.written += not refusal
        return refusal

    def _refusal(self, name: str, value: float, *, is_armed: bool) -> str:
        variable = self._variables.get(name)
        if variable is None:
            return str(UnknownNameError(f"writable variable of model '{self._model.name}'", name, self._variables))
        if variable.write is Write.NEVER:
            why = variable.why or "not while it runs"
            return f"'{name}' of model '{self._model.name}' cannot be written: {why}"
        refusal = refusal_of(variable, value)
        if not refusal and is_armed and not variable.tunable:
            return f"'{name}' is not tunable while the robot is armed: disarm it first"
        return refusal

    def _try(self, values: Values, u: Sequence[float] | None, *, is_armed: bool, is_sound: bool) -> str:
        model, can_keep = self._model, True
        try:
            put_back = keep_state(model)
        except Exception as error:  # noqa: BLE001 - the model is the user's and may raise anything
            if is_armed:
                return (
                    f"a write that failed could not be taken back, so disarm the robot first: {exception_text(error)}"
                )
            can_keep = False
            put_back = partial(self._write_back, [(name, model.read(name)) for name, _ in values], u)
        tried = ""
        try:
            for name, value in values:
                tried = f"'{name}' cannot be {value}"
                model.write(name, value)
            if can_keep and is_sound and u is not None:
                tried = f"the model cannot take a step with {', '.join(f'{name} = {value}' for name, value in values)}"
                after = keep_state(model)
                self._step(u)
                after()
        except (Exception, SystemExit) as error:  # noqa: BLE001 - as above
            put_back()
            return str(error) if type(error) is ModelError else f"{tried}: {exception_text(error)}"
        return ""

    def _step(self, u: Sequence[float]) -> None:
        y = self._model.step(u)
        for variable, value in zip(self._model.outputs, y, strict=True):
            if not isfinite(value):
                raise ArithmeticError(f"its output '{variable.name}' would be {value}")

    def _write_back(self, values: Values, u: Sequence[float] | None) -> None:
        for name, value in reversed(values):
            self._model.write(name, value)
        if u is not None:
            self._model.initialize(u)
