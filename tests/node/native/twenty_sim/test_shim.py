# SPDX-License-Identifier: MIT
"""What the compiled model computes, against the same code called by its own entry points, to the last bit."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.library import NativeModel
from segway_ecc.node.native.load import load_native
from tests.fixtures.twenty_sim import generate, models, more_models
from tests.fixtures.twenty_sim.made import Input, Layout, Made, Style, Write, input_at
from tests.fixtures.twenty_sim.maker import Maker
from tests.fixtures.twenty_sim.native import native_outputs
from tests.fixtures.twenty_sim.spec import Spec

STEPS = 10_000


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "compiled"))


def ramps(spec: Spec) -> list[Input]:
    return [Input(0.5 + 0.1 * index, 1e-4) for index in range(len(spec.inputs))]


def rows(model: NativeModel, inputs: list[Input], steps: int) -> list[list[float]]:
    first = model.initialize(input_at(inputs, 0))
    return [first, *(model.step(input_at(inputs, k)) for k in range(steps))]


def assert_native(made: Made, model: NativeModel) -> None:
    inputs = ramps(made.spec)
    assert rows(model, inputs, STEPS) == native_outputs(made, inputs, STEPS)


@pytest.mark.variants(2)
@pytest.mark.parametrize(
    ("spec", "style", "prefix"),
    [
        (models.CART, Style.V48, "xx"),
        (models.TANK, Style.V46, "xx"),
        (models.PID, Style.V48, "tank"),
        (models.OSCILLATOR, Style.V46, "q"),
        (models.LIMITER, Style.V48, "xx"),
        (models.MATRICES, Style.V46, "xx"),
        (more_models.INITIAL, Style.V48, "xx"),
        (more_models.LITERAL, Style.V46, "xx"),
    ],
    ids=lambda value: value.name if isinstance(value, Spec) else str(value),
)
def test_a_c_submodel_computes_what_its_code_does(make: Maker, spec: Spec, style: Style, prefix: str) -> None:
    made = make.submodel(spec, style, prefix)
    assert_native(made, load_native(made.path))


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    ("spec", "layout", "xml"),
    [
        (models.CART, Layout.GENERATED, True),
        (models.TANK, Layout.MOVED, False),
        (models.PID, Layout.MOVED, True),
        (models.OSCILLATOR, Layout.GENERATED, False),
        (models.MATRICES, Layout.GENERATED, True),
        (models.LIMITER, Layout.MOVED, True),
        (more_models.INITIAL, Layout.GENERATED, True),
        (more_models.LITERAL, Layout.MOVED, False),
    ],
    ids=lambda value: value.name if isinstance(value, Spec) else str(value),
)
def test_a_cpp_class_computes_what_its_code_does(
    make: Maker,
    spec: Spec,
    layout: Layout,
    xml: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    made = make.cpp_class(spec, layout, xml)
    assert_native(made, load_native(made.path))


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    "spec", [models.PID, models.TANK, models.OSCILLATOR, models.CART], ids=lambda spec: spec.method
)
def test_a_partial_copy_is_integrated_as_its_own_code_would(make: Maker, spec: Spec) -> None:
    made = make.partial(spec)
    assert_native(made, load_native(made.path, method=spec.method))


@pytest.mark.variants(1)
@pytest.mark.parametrize("spec", [models.PID, models.CART], ids=lambda spec: spec.method)
def test_a_partial_copy_with_its_integration_needs_no_help(make: Maker, spec: Spec) -> None:
    made = make.partial(spec, Style.V46, True)  # noqa: FBT003 - with xxinteg
    assert_native(made, load_native(made.path))


def test_a_partial_copy_without_states_has_nothing_to_integrate(make: Maker) -> None:
    made = make.partial(models.LIMITER)
    model = load_native(made.path)
    assert_native(made, model)
    assert model.description.method == ""


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
@pytest.mark.parametrize("spec", [models.CART, models.MATRICES, more_models.INITIAL], ids=lambda spec: spec.name)
def test_a_second_start_gives_the_bits_of_the_first(make: Maker, shape: str, spec: Spec) -> None:
    model = load_native(getattr(make, shape)(spec).path)
    inputs = ramps(spec)
    first = rows(model, inputs, 200)
    model.terminate()
    assert rows(model, inputs, 200) == first
    assert rows(model, inputs, 200) == first


def test_two_instances_share_nothing(make: Maker) -> None:
    made = make.submodel(models.TANK)
    one, two = load_native(made.path), load_native(made.path)
    alone = rows(one, [Input(0.0)], 500)
    two.initialize([0.0])
    two.write(r"Setpoint\C", 99.0)
    one.initialize([0.0])
    assert [one.step([0.0]) for _ in range(500) if two.step([1.0])] == alone[1:]


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_two_models_in_one_process_do_not_see_each_other(make: Maker, shape: str) -> None:
    """Both have the same names for different things."""
    tank, cart = (getattr(make, shape)(spec) for spec in (models.TANK, models.CART))
    inputs = [Input(0.3, 1e-3)]
    one, two = load_native(tank.path), load_native(cart.path)
    found = [one.initialize(input_at(inputs, 0))]
    two.initialize([])
    for k in range(1000):
        two.step([])
        found.append(one.step(input_at(inputs, k)))
    assert found == native_outputs(tank, inputs, 1000)


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_the_end_of_the_experiment_does_not_end_the_model(make: Maker, shape: str) -> None:
    """Its experiment lasts 10 s; the set-point's output goes on following the leak after 12 s."""
    model = load_native(getattr(make, shape)(models.TANK).path)
    model.initialize([0.0])
    for _ in range(1200):
        before = model.step([0.0])
    for _ in range(1000):
        after = model.step([4.0])
    # At rest the controller's flow equals the leak: K (C - level) = leak, so level = 10 - 4 / 2.
    assert before[0] == pytest.approx(10.0, abs=1e-4)
    assert after[0] == pytest.approx(8.0, abs=1e-3)


def test_time_is_counted_once(make: Maker) -> None:
    """The phase is omega t, with omega = 2 pi 0.5 Hz."""
    model = load_native(make.submodel(models.OSCILLATOR).path)
    model.initialize([])
    for _ in range(200):
        _, phase = model.step([])
    assert phase == pytest.approx(3.141592653589793 * 200 * 0.005, rel=1e-12)


def test_a_models_stop_request_is_reported(make: Maker) -> None:
    model = load_native(make.submodel(more_models.STOPPING).path)
    model.initialize([1.0])
    status = [model._library.ecc_step(model._u, model._y) for _ in range(150)]
    # One metre at 1 m/s in steps of 0.01 s.
    assert status[:99] == [0] * 99
    assert status[103:] == [1] * 47


def test_a_models_stop_request_lasts_until_it_is_initialized_again(make: Maker) -> None:
    model = load_native(make.submodel(more_models.STOPPING).path)
    model.initialize([1.0])
    states = []
    for _ in range(120):
        model.step([1.0])
        states.append(model.stopped)
    model.initialize([1.0])
    assert (states[98], states[-1], model.stopped) == (False, True, False)


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_a_parameter_in_static_equations_takes_effect_at_once(make: Maker, shape: str) -> None:
    made = getattr(make, shape)(models.TANK)
    model = load_native(made.path)
    model.initialize([0.0])
    for _ in range(99):
        model.step([0.0])
    model.write(r"Setpoint\C", 30.0)
    after = [model.step([0.0]) for _ in range(901)]
    assert after[-1][0] == pytest.approx(29.997, abs=1e-3)
    truth = native_outputs(made, [Input()], 1000, [Write(100, "P", 0, 30.0, static=True, dynamic=True)])
    assert after == truth[100:]


@pytest.mark.variants(2)
@pytest.mark.parametrize(
    "name",
    [
        "crlf_latin1",
        "wrong_case_header",
        "stale_xml",
        "spaced_names",
        "odd_folder",
        "algebraic_loop",
        "build_copies",
        "single_precision",
    ],
)
def test_a_folder_that_is_odd_in_some_way_computes_what_its_code_does(make: Maker, name: str) -> None:
    made = make.variant(name)
    assert_native(made, load_native(made.path))


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    "spec", [models.PID, models.TANK, models.OSCILLATOR, models.CART], ids=lambda spec: spec.method
)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_a_written_state_is_where_the_next_step_begins(make: Maker, shape: str, spec: Spec) -> None:
    made = getattr(make, shape)(spec)
    model = load_native(made.path)
    inputs = ramps(spec)
    found = rows(model, inputs, 49)
    model.write(spec.states[0].name, 1.25)
    assert model.read(spec.states[0].name) == 1.25
    found += [model.step(input_at(inputs, k)) for k in range(49, 100)]
    truth = native_outputs(made, inputs, 100, [Write(50, "s", 0, 1.25, dynamic=True)])
    assert found == truth
    assert found != native_outputs(made, inputs, 100)


@pytest.mark.variants(1)
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_a_parameter_in_initial_equations_waits_for_the_next_start(make: Maker, shape: str) -> None:
    model = load_native(getattr(make, shape)(more_models.INITIAL).path)
    model.initialize([])
    unwritten = [model.step([]) for _ in range(10)]
    model.initialize([])
    model.write(r"Body\start", 20.0)
    assert [model.step([]) for _ in range(10)] == unwritten
    assert model.initialize([]) == [20.0]
    assert model.initialize([]) == [20.0]


def test_a_parameter_in_initial_equations_of_a_partial_copy(make: Maker) -> None:
    model = load_native(make.partial(more_models.INITIAL).path, method="RungeKutta4")
    model.write(r"Body\start", 20.0)
    assert model.initialize([]) == [20.0]


def test_what_no_equation_reads_is_refused(tmp_path: Path, make: Maker) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    file = path / "xxmodel.c"
    code = file.read_text(encoding="utf-8")
    assert "xx_P[0];" in code
    file.write_text(code.replace("= xx_P[0];", "= 10.0;"), encoding="utf-8")
    text = r"^'Setpoint\\C' of model 'SingleWaterTank' cannot be written: no equation reads it"
    with pytest.raises(ModelError, match=text):
        load_native(path).write(r"Setpoint\C", 30.0)


def test_a_value_can_be_read_before_the_start_and_after_the_end(make: Maker) -> None:
    model = load_native(make.submodel(models.TANK).path)
    assert (model.read(r"Setpoint\C"), model.read(r"Tank\volume"), model.read("level")) == (10.0, 20.0, 0.0)
    model.initialize([0.25])
    assert (model.read("leak"), model.read("level")) == (0.25, 10.0)
    model.terminate()
    assert model.read(r"Tank\volume") == 20.0


def test_a_step_or_a_state_before_the_start_is_refused(make: Maker) -> None:
    model = load_native(make.submodel(models.TANK).path)
    with pytest.raises(ModelError, match=r"^model 'SingleWaterTank' failed to write .*once the model is initialized$"):
        model.write(r"Tank\volume", 1.0)
    with pytest.raises(ModelError, match=r"^model 'SingleWaterTank' failed to step: it is not initialized$"):
        model.step([0.0])
    model.terminate()


RANDOM = """
import ctypes, sys
libc = ctypes.CDLL(None)
from pathlib import Path
from segway_ecc.node.native.load import load_native
models = [load_native(Path(sys.argv[1])) for _ in range(2)]
def run(model):
    model.initialize([0.0])
    return [model.step([0.0])[0] for _ in range(5)]
libc.rand()
first, second, again = run(models[0]), run(models[1]), run(models[0])
libc.srand(1)
assert first == second == again == [libc.rand() / 2147483647 for _ in range(6)][1:], (first, second, again)
"""


def test_random_numbers_are_those_of_a_fresh_process_for_each_instance(tmp_path: Path) -> None:
    made = generate.submodel(models.TANK, tmp_path / "tank")
    file = made.path / "xxmodel.c"
    code = file.read_text(encoding="utf-8")
    assert code.count("xx_V[0] = xx_s[0] / xx_P[2];") <= 1
    output = "void XXCalculateOutput (void)\n{"
    assert output in code
    place = next(line.split("=")[1].strip(" ;\t") for line in _submodel_lines(made.path) if "y[0] =" in line)
    changed = f"{output}\n\t{place} = rand () / 2147483647.0;"
    file.write_text(code.replace(output, changed), encoding="utf-8")
    subprocess.run([sys.executable, "-c", RANDOM, str(made.path)], check=True)


def _submodel_lines(path: Path) -> list[str]:
    lines = (path / "xxsubmod.c").read_text(encoding="utf-8").splitlines()
    return [line.split(";")[0] for line in lines]


def test_single_precision_is_computed_in_and_warned_of(tmp_path: Path) -> None:
    made = generate.submodel(models.TANK, tmp_path / "tank")
    file = made.path / "xxtypes.h"
    code = file.read_text(encoding="utf-8")
    assert "typedef double XXDouble;" in code
    file.write_text(code.replace("typedef double XXDouble;", "typedef float XXDouble;"), encoding="utf-8")
    model = load_native(made.path)
    assert model.initialize([0.1]) == [10.0]
    assert model.read("leak") == pytest.approx(0.1, abs=1e-8)
    assert model.read("leak") != 0.1
    assert model.description.warnings == ("it computes in single precision: XXDouble is float in its types",)
