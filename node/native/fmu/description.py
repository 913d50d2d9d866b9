# SPDX-License-Identifier: MIT
"""From an FMU's own description to the one that the runtime shows and the places that the shim uses."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import LARGEST, Variable, Write
from segway_ecc.node.native.fmu.facts import Causality, Facts, FmuVariable
from segway_ecc.node.native.fmu.twenty_sim import TwentySim
from segway_ecc.node.native.library import Description, Flavour

_ROUNDING: Final = 1e-9
"""How far two steps may differ by how they are printed."""
_STATE_WRITES: Final = (
    (Write.NEVER, "the FMU calculates it"),
    (Write.RESET, "the FMU takes its start value when it initializes"),
)
"""For a state whose start value the FMU does not take, and for one whose it does."""
_TWENTY_SIM_STATE_WRITES: Final = ((Write.NOW, "20-sim's FMUs take a state at any time"),) * 2


@dataclass(frozen=True, slots=True)
class FmuLayout:
    """A description, and where its variables are in the FMU.

    Attributes:
        description: What the runtime shows.
        references: The valueReferences of the description's variables, by `Kind` and in its order.
        followers: For each parameter the place of the state that starts from it, or -1 where the FMU sees to it.
    """

    description: Description
    references: tuple[tuple[int, ...], ...]
    followers: tuple[int, ...]


def describe(facts: Facts, twenty_sim: TwentySim | None, step_size: float | None, path: Path) -> FmuLayout:
    """Describe an FMU.

    Args:
        facts: Its own description.
        twenty_sim: What is known of it beyond that, where 20-sim made it.
        step_size: Step to take, s; None for the one that the FMU asks for.
        path: The FMU itself, for messages.

    Raises:
        ModelError: An input or output is not a real number, or no step size is known.
    """
    wrong = [
        f"{variable.causality} '{variable.name}' ({'array of ' if variable.array else ''}{variable.type})"
        for variable in facts.variables
        if variable.causality in (Causality.INPUT, Causality.OUTPUT) and not variable.is_real
    ]
    if wrong:
        raise ModelError(
            f"FMU {path} has ports that are not real numbers: {', '.join(wrong)}; make them real in the model and "
            "export it again"
        )
    reals = [variable for variable in facts.variables if variable.is_real]
    of = {causality: [v for v in reals if v.causality is causality] for causality in Causality}
    inputs, outputs = of[Causality.INPUT], of[Causality.OUTPUT]
    parameters = of[Causality.PARAMETER] + of[Causality.CALCULATED_PARAMETER]
    states = _states(facts, twenty_sim)
    # 20-sim's FMUs set states before they take parameters, and name the initial value of a state so.
    can_restart = twenty_sim is not None and (not twenty_sim.globals or bool(twenty_sim.restart_symbols))
    initial = {f"{state.name}_initial": place for place, state in enumerate(states)} if can_restart else {}
    followers = tuple(initial.get(variable.name, -1) for variable in parameters)
    step = _step(facts, twenty_sim, step_size, path)
    state_writes = _STATE_WRITES if twenty_sim is None else _TWENTY_SIM_STATE_WRITES
    description = Description(
        name=facts.name,
        flavour=Flavour.FMI2 if facts.version == 2 else Flavour.FMI3,  # noqa: PLR2004 - the standard's number
        build=facts.tool,
        method=twenty_sim.method if twenty_sim is not None else "",
        step_size=step,
        finish_time=facts.stop_time,
        inputs=tuple(_plain(variable, twenty_sim) for variable in inputs),
        outputs=tuple(_plain(variable, twenty_sim) for variable in outputs),
        parameters=tuple(
            _plain(variable, twenty_sim, _tunability(variable, twenty_sim, follows=follower >= 0))
            for variable, follower in zip(parameters, followers, strict=True)
        ),
        states=tuple(_plain(variable, twenty_sim, state_writes[variable.initial == "exact"]) for variable in states),
        warnings=tuple(_warnings(facts, twenty_sim, step)),
    )
    groups = (inputs, outputs, parameters, states)
    return FmuLayout(description, tuple(tuple(v.reference for v in group) for group in groups), followers)


def _states(facts: Facts, twenty_sim: TwentySim | None) -> list[FmuVariable]:
    """The states; of a vector or matrix its elements."""
    reals = {variable.name: variable for variable in facts.variables if variable.is_real}
    found = []
    # dict.fromkeys: each once, in the order found.
    for name in dict.fromkeys(facts.states if twenty_sim is None else (*facts.states, *twenty_sim.states)):
        elements = (other for other in reals if other.startswith(f"{name}[") and "]" not in other[len(name) : -1])
        found += [reals[element] for element in ([name] if name in reals else elements)]
    return found


def _step(facts: Facts, twenty_sim: TwentySim | None, given: float | None, path: Path) -> float:
    # Its own files first: the model description repeats them, if it holds anything.
    own = twenty_sim.step_size if twenty_sim is not None else None
    step = next((step for step in (given, facts.step_size, own) if step is not None), None)
    if step is None:
        raise ModelError(f"FMU {path} gives no step size: pass it, in s, as load_fmu(path, step_size=0.01)")
    if not (math.isfinite(step) and step > 0.0):
        raise ModelError(f"a step of {step} s cannot be taken by FMU {path}: give a positive one as step_size")
    return step


def _plain(
    variable: FmuVariable, twenty_sim: TwentySim | None, write: tuple[Write, str] = (Write.NEVER, "")
) -> Variable:
    unit, value = variable.unit, variable.start
    if twenty_sim is not None:
        unit = unit or twenty_sim.units.get(variable.name, "")
        value = value if value is not None else twenty_sim.values.get(variable.name)
    low = -LARGEST if variable.minimum is None else variable.minimum
    high = LARGEST if variable.maximum is None else variable.maximum
    if not low <= high or (variable.start is not None and not low <= variable.start <= high):
        text = f"variable '{variable.name}' has the range {low:g} to {high:g}, and starts at {variable.start}"
        raise ModelError(f"{text}: correct the model and export it again")
    return Variable(variable.name, unit or "1", value if value is not None else 0.0, *write, minimum=low, maximum=high)


def _tunability(variable: FmuVariable, twenty_sim: TwentySim | None, *, follows: bool) -> tuple[Write, str]:
    if variable.causality is Causality.CALCULATED_PARAMETER:
        return Write.NEVER, "calculated from other parameters"
    if variable.variability == "constant":
        return Write.NEVER, "constant"
    if variable.variability != "tunable":
        if twenty_sim is not None and twenty_sim.globals and not follows:
            return Write.NEVER, "fixed, and this FMU starts before it takes it"
        return Write.RESET, "fixed: the FMU takes it when it initializes"
    if twenty_sim is None:
        return Write.NOW, "tunable"
    return _twenty_sim_tunability(twenty_sim.sections.get(variable.name), twenty_sim)


def _twenty_sim_tunability(sections: frozenset[str] | None, twenty_sim: TwentySim) -> tuple[Write, str]:
    if sections == frozenset({"Initial"}):
        if twenty_sim.globals and not twenty_sim.restart_symbols:
            return Write.NEVER, "feeds initial equations, which this FMU does not let us run again"
        return Write.RESET, "feeds initial equations only"
    if sections is not None and "Static" not in sections:
        return Write.NOW, "tunable, and feeds no static equation"
    if twenty_sim.static_symbol is not None:
        return Write.STATIC, "feeds static equations" if sections else "may feed static equations"
    # From here on we cannot run the static equations; without sections it is not known that it feeds them.
    if twenty_sim.updates_itself:
        write = Write.NOW, "tunable: the FMU runs its static equations again by itself"
    elif sections is None:
        write = Write.NOW, "tunable, unless it feeds static equations, which this FMU does not show"
    elif twenty_sim.globals:
        write = Write.NEVER, "feeds static equations, which this FMU does not let us run again"
    else:
        write = Write.RESET, "feeds static equations, which this FMU runs only when it initializes"
    return write


def _warnings(facts: Facts, twenty_sim: TwentySim | None, step: float) -> Iterator[str]:
    left_out = [
        variable.name
        for variable in facts.variables
        if variable.causality in (Causality.PARAMETER, Causality.STRUCTURAL_PARAMETER) and not variable.is_real
    ]
    if left_out:
        yield f"parameters that are not real numbers keep their values and are not shown: {', '.join(left_out)}"
    if twenty_sim is None:
        if not facts.variable_steps and (asked := facts.step_size) not in (None, step):
            yield f"the FMU asks for steps of {asked} s and is given {step} s, which it does not promise to take"
        return
    if twenty_sim.globals:
        yield "outputs at time zero belong to the FMU's own inputs: it computes them before it takes any"
    own = twenty_sim.step_size or facts.step_size
    if own is not None and not (step >= 0.5 * own and math.isclose(step, round(step / own) * own, rel_tol=_ROUNDING)):
        yield f"the model's own step is {own} s: a step of {step} s is no multiple of it, so its time runs ahead"
