# SPDX-License-Identifier: MIT
"""Models written in Python as the six sections of a 20-sim model, and the fixed-step methods that integrate them.

Sources: the 20-sim reference manual, "Integration Methods"; Hairer, Norsett, Wanner, "Solving Ordinary Differential
Equations I" (2nd ed.), table II.1.2 for the classical Runge-Kutta method and II.1.1 for the midpoint rule.
"""

import enum
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from mypy_extensions import mypyc_attr

from segway_ecc.node.errors import ModelError, UnknownNameError
from segway_ecc.node.model.model import Variable, Write, refusal_of

Dynamic = Callable[[float, Sequence[float]], Sequence[float]]
"""The dynamic section: (time in s, states) -> rates per second, or the next states for `Method.DISCRETE`."""

Advance = Callable[[Dynamic, float, Sequence[float], float], list[float]]
"""(dynamic, time in s, states, step in s) -> the states one step later."""


@enum.unique
class Method(enum.StrEnum):
    """The fixed-step methods."""

    DISCRETE = "Discrete"
    EULER = "Euler"
    RUNGE_KUTTA_2 = "RungeKutta2"
    RUNGE_KUTTA_4 = "RungeKutta4"


def _runge_kutta_2(dynamic: Dynamic, t: float, s: Sequence[float], h: float) -> list[float]:
    half = 0.5 * h
    middle = [x + half * r for x, r in zip(s, dynamic(t, s), strict=True)]
    return [x + h * r for x, r in zip(s, dynamic(t + half, middle), strict=True)]


def _runge_kutta_4(dynamic: Dynamic, t: float, s: Sequence[float], h: float) -> list[float]:
    half = 0.5 * h
    r1 = dynamic(t, s)
    r2 = dynamic(t + half, [x + half * r for x, r in zip(s, r1, strict=True)])
    r3 = dynamic(t + half, [x + half * r for x, r in zip(s, r2, strict=True)])
    r4 = dynamic(t + h, [x + h * r for x, r in zip(s, r3, strict=True)])
    sixth = h / 6.0
    return [x + sixth * (a + 2.0 * b + 2.0 * c + d) for x, a, b, c, d in zip(s, r1, r2, r3, r4, strict=True)]


ADVANCE: dict[Method, Advance] = {
    Method.DISCRETE: lambda dynamic, t, s, _h: list(dynamic(t, s)),
    Method.EULER: lambda dynamic, t, s, h: [x + h * r for x, r in zip(s, dynamic(t, s), strict=True)],
    Method.RUNGE_KUTTA_2: _runge_kutta_2,
    Method.RUNGE_KUTTA_4: _runge_kutta_4,
}


@mypyc_attr(allow_interpreted_subclasses=True)  # where this is compiled, models in plain Python still build on it
class SectionedModel:
    """A model as initial, static, input, dynamic, output and final equations.

    A subclass declares its variables and overrides the sections it needs. The order is 20-sim's: `initialize` runs
    initial, static, input, output; each `step` runs input, dynamic (as often as the method asks) and output;
    `terminate` runs final. An artificial state is one whose rate is always zero: it keeps what is written to it.

    Attributes:
        time: Model time, s: the number of steps times the step size, free of summation error.
        s: The states, in the order of `states`; valid in every section.
        p: The parameters by name.
        stopped: Whether the model has asked to stop; a section may set it.
    """

    name: ClassVar[str]
    step_size: ClassVar[float]
    method: ClassVar[Method] = Method.RUNGE_KUTTA_4
    inputs: ClassVar[Sequence[Variable]] = ()
    outputs: ClassVar[Sequence[Variable]] = ()
    parameters: ClassVar[Sequence[Variable]] = ()
    states: ClassVar[Sequence[Variable]] = ()

    def __init__(self, parameters: Mapping[str, float] | None = None) -> None:
        """Create the model with some parameters other than their defaults."""
        self._advance = ADVANCE[self.method]
        self._steps = 0
        self._u: list[float] = [v.value for v in self.inputs]
        self._y: list[float] = [v.value for v in self.outputs]
        self._starts: dict[str, float] = {}
        self.time = 0.0
        self.stopped = False
        self.s: list[float] = [v.value for v in self.states]
        self.p: dict[str, float] = {v.name: v.value for v in self.parameters}
        # Of equal names the first counts: looked for once, since the cycle reads and writes by name.
        self._state_at = {v.name: place for place, v in reversed([*enumerate(self.states)])}
        self._now_at = {name: at for name, at in self._state_at.items() if self.states[at].write is Write.NOW}
        self._parameter_at = {v.name: v for v in reversed(self.parameters)}
        for name, value in (parameters or {}).items():
            if name not in self.p:
                raise UnknownNameError(f"parameter of model '{self.name}'", name, self.p)
            self.p[name] = _in_range(self._parameter_at[name], value)
        self._input_at = {v.name: place for place, v in reversed([*enumerate(self.inputs)])}
        self._output_at = {v.name: place for place, v in reversed([*enumerate(self.outputs)])}

    # The sections. `u` is valid for one step; `output` returns the outputs in order.

    def initial(self) -> None:
        """Equations that hold at the start only; may set `self.s`."""

    def static(self) -> None:
        """Equations that depend on parameters only."""

    def input(self, u: Sequence[float]) -> None:
        """Equations that depend on inputs only."""

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - a model without states has none
        """Return the rates of the states `s` at time `t` (for `Method.DISCRETE`: the next states)."""
        return ()

    def output(self) -> Sequence[float]:
        """Return the outputs at the present time and states."""
        return ()

    def final(self) -> None:
        """Equations that hold after the last step."""

    # What the cycle calls; see `Model`.

    def initialize(self, u: Sequence[float]) -> list[float]:
        """Start at time zero; see `Model.initialize`."""
        self._steps = 0
        self.time = 0.0
        self.stopped = False
        self.s = [self._starts.get(v.name, v.value) for v in self.states]
        self.initial()
        self.static()
        self._take_inputs(u)
        self._y = list(self.output())
        return self._y

    def step(self, u: Sequence[float]) -> list[float]:
        """Advance one step; see `Model.step`."""
        self._take_inputs(u)
        self.s = self._advance(self.dynamic, self.time, self.s, self.step_size)
        self._steps += 1
        self.time = self._steps * self.step_size
        self._y = list(self.output())
        return self._y

    def terminate(self) -> None:
        """Run the final section."""
        self.final()

    def read(self, name: str) -> float:
        """Return a present value; see `Model.read`."""
        if name in self.p:
            return self.p[name]
        if name in self._state_at:
            return self.s[self._state_at[name]]
        if name in self._input_at:
            return float(self._u[self._input_at[name]])
        if name in self._output_at:
            return float(self._y[self._output_at[name]])
        known = [*self.p, *(v.name for v in (*self.states, *self.inputs, *self.outputs))]
        raise UnknownNameError(f"variable of model '{self.name}'", name, known)

    def write(self, name: str, value: float) -> None:
        """Write a parameter or state; see `Model.write`."""
        now_at = self._now_at.get(name)
        if now_at is not None:  # what a cycle writes: its set-points
            self.s[now_at] = _in_range(self.states[now_at], value)
            return
        place = self._state_at.get(name)
        variable = self._parameter_at.get(name) if place is None else self.states[place]
        if variable is None:
            known = [*self.p, *(v.name for v in self.states)]
            raise UnknownNameError(f"writable variable of model '{self.name}'", name, known)
        if variable.write is Write.NEVER:
            raise ModelError(f"'{name}' of model '{self.name}' cannot be written while it runs")
        if place is not None and variable.write is Write.RESET:
            self._starts[name] = _in_range(variable, value)
            return
        before = self.p[name] if place is None else self.s[place]
        self._put(place, name, _in_range(variable, value))
        if variable.write is Write.STATIC:
            try:
                self.static()
            except Exception:  # refused whole
                self._put(place, name, before)
                self.static()
                raise

    def _put(self, place: int | None, name: str, value: float) -> None:
        if place is None:
            self.p[name] = value
        else:
            self.s[place] = value

    def _take_inputs(self, u: Sequence[float]) -> None:
        if len(u) != len(self._u):
            raise ModelError(f"model '{self.name}' has {len(self.inputs)} inputs and was given {len(u)}")
        self._u = list(u)
        self.input(u)


def _in_range(variable: Variable, value: float) -> float:
    if not variable.minimum <= value <= variable.maximum:
        raise ModelError(refusal_of(variable, value))
    return float(value)
