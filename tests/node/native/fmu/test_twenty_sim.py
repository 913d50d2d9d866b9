# SPDX-License-Identifier: MIT
"""FMUs as 20-sim exports them, against their own binary driven in C and against exports with other numbers."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Write as Effect
from segway_ecc.node.native.fmu.load import FmuModel, load_fmu
from tests.fixtures.twenty_sim import fmu, models, more_models
from tests.fixtures.twenty_sim.made import FmuKind, Input, Made, Write
from tests.fixtures.twenty_sim.maker import Maker
from tests.fixtures.twenty_sim.native import native_outputs
from tests.fixtures.twenty_sim.spec import Spec

STEPS = 10_000
KINDS = pytest.mark.parametrize("kind", list(FmuKind), ids=lambda kind: kind.value)
SPECS = pytest.mark.parametrize("spec", more_models.ALL, ids=lambda spec: spec.name)


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache for all tests of this file, so that the shim is compiled once."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _cache(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(kept))


def dotted(name: str) -> str:
    return name.replace("\\", ".")


def given(spec: Spec) -> list[Input]:
    return [Input(0.5 + 0.1 * place, 1e-4) for place in range(len(spec.inputs))]


def run(
    model: FmuModel, inputs: Sequence[Input], steps: int, writes: Sequence[tuple[int, str, float]] = ()
) -> list[list[float]]:
    rows = [model.initialize([one.offset for one in inputs])]
    for k in range(steps):
        for step, name, value in writes:
            if step == k + 1:
                model.write(name, value)
        rows.append(model.step([one.offset + one.slope * k for one in inputs]))
    return rows


@pytest.mark.variants(4)
@KINDS
@SPECS
def test_numbers_are_those_of_the_binary_driven_in_c(spec: Spec, kind: FmuKind, make: Maker) -> None:
    made: Made = make.fmu(spec, kind)
    rows = run(load_fmu(made.path), given(spec), STEPS)
    assert rows == native_outputs(made, given(spec), STEPS)


@KINDS
@SPECS
def test_names_units_and_values_are_those_of_the_model(spec: Spec, kind: FmuKind, make: Maker) -> None:
    found = load_fmu(make.fmu(spec, kind).path).description
    assert (found.name, found.method, found.step_size, found.finish_time) == (
        spec.name,
        spec.method,
        spec.step_size,
        spec.finish_time,
    )
    expected = [(dotted(q.name), q.unit or "1") for q in (*spec.inputs, *spec.outputs)]
    assert [(v.name, v.unit) for v in (*found.inputs, *found.outputs)] == expected
    states = [(dotted(state.name), state.unit or "1") for state in spec.states]
    assert [(v.name, v.unit) for v in found.states] == states
    parameters = {v.name: (v.unit, v.value) for v in found.parameters}
    for quantity in spec.parameters:
        assert parameters[dotted(quantity.name)] == (quantity.unit or "1", quantity.value)


@KINDS
def test_a_static_parameter_takes_effect_while_it_runs(kind: FmuKind, make: Maker) -> None:
    made = make.fmu(models.TANK, kind)
    model = load_fmu(made.path)
    (setpoint,) = (v for v in model.parameters if v.name == "Setpoint.C")
    assert setpoint.write is Effect.STATIC
    rows = run(model, given(models.TANK), 200, [(101, "Setpoint.C", 30.0)])
    place = [q.name for q in models.TANK.parameters].index("Setpoint\\C")
    assert rows == native_outputs(made, given(models.TANK), 200, [Write(101, "P", place, 30.0, static=True)])
    assert rows[150] != native_outputs(made, given(models.TANK), 150)[150]


@KINDS
def test_a_state_takes_effect_while_it_runs(kind: FmuKind, make: Maker) -> None:
    made = make.fmu(models.OSCILLATOR, kind)
    rows = run(load_fmu(made.path), given(models.OSCILLATOR), 200, [(50, "Mass.x", 0.25)])
    assert rows == native_outputs(made, given(models.OSCILLATOR), 200, [Write(50, "s", 0, 0.25)])


@pytest.mark.variants(1)
@KINDS
def test_an_initial_value_takes_effect_at_the_next_start(kind: FmuKind, make: Maker, tmp_path: Path) -> None:
    spec = models.TANK
    model = load_fmu(make.fmu(spec, kind).path)
    run(model, given(spec), 20)
    model.write("Tank.volume_initial", 7.5)
    other = replace(spec, states=(replace(spec.states[0], value=7.5),))
    expected = native_outputs(fmu.write(other, tmp_path / "other.fmu", kind), given(spec), 200)
    assert run(model, given(spec), 200) == expected


@pytest.mark.variants(1)
@KINDS
def test_a_parameter_of_initial_equations_takes_effect_at_the_next_start(
    kind: FmuKind, make: Maker, tmp_path: Path
) -> None:
    spec = more_models.INITIAL
    model = load_fmu(make.fmu(spec, kind).path)
    (start,) = (v for v in model.parameters if v.name == "Body.start")
    assert (start.write, start.why) == (Effect.RESET, "feeds initial equations only")
    run(model, given(spec), 20)
    model.write("Body.start", 55.0)
    changed = tuple(replace(q, value=55.0) if q.name == "Body\\start" else q for q in spec.parameters)
    made = fmu.write(replace(spec, parameters=changed), tmp_path / "other.fmu", kind)
    assert run(model, given(spec), 200) == native_outputs(made, given(spec), 200)


def test_a_tool_wrapper_is_refused(make: Maker) -> None:
    with pytest.raises(ModelError, match=r"needs 20-sim.* running beside it .*: export it again as a stand-alone FMU"):
        load_fmu(make.variant("tool_wrapper").path)


@pytest.mark.variants(1)
@pytest.mark.parametrize("name", ["source_fmu", "latin1_fmu"])
def test_variants_give_the_numbers_of_the_plain_fmu(name: str, make: Maker) -> None:
    made = make.variant(name)
    plain = make.fmu(made.spec, FmuKind(made.shape.value))
    assert run(load_fmu(made.path), given(made.spec), STEPS) == native_outputs(plain, given(made.spec), STEPS)
