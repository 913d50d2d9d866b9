# SPDX-License-Identifier: MIT
"""The fixtures themselves: that they run, and that they behave as the code of 20-sim does."""

import ctypes
import dataclasses
import math
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from segway_ecc.node.models.cart import Cart
from tests.fixtures.twenty_sim import fmu, generate, models, more_models, variants
from tests.fixtures.twenty_sim.made import FmuKind, Input, Layout, Made, Style, Write, input_at
from tests.fixtures.twenty_sim.maker import Maker
from tests.fixtures.twenty_sim.native import native_outputs, native_run
from tests.fixtures.twenty_sim.spec import Spec

STEPS = 400
RAMP = Input(0.1, 1e-3)
SETPOINT, ANGULAR_SETPOINT = 0, 1
"""Places of the cart's set-points among its states."""
RUNNABLE = sorted(set(variants.BY_NAME) - {"missing_dll", "source_fmu"})


def _ids(spec: Spec) -> str:
    return spec.name


def _check_finite(made: Made) -> list[list[float]]:
    rows = native_outputs(made, [RAMP] * len(made.spec.inputs), STEPS)
    assert len(rows) == STEPS + 1
    assert all(len(row) == len(made.spec.outputs) for row in rows)
    assert all(math.isfinite(value) for row in rows for value in row)
    return rows


@pytest.mark.variants(2)
@pytest.mark.parametrize("spec", more_models.ALL, ids=_ids)
def test_every_model_gives_the_same_outputs_in_each_style(make: Maker, spec: Spec) -> None:
    outputs = _check_finite(make.submodel(spec))
    assert _check_finite(make.submodel(spec, Style.V46, "tank")) == outputs


@pytest.mark.variants(1)
@pytest.mark.parametrize("spec", [models.PID, models.OSCILLATOR, models.LIMITER, models.MATRICES], ids=_ids)
def test_every_class_gives_the_submodels_outputs(make: Maker, spec: Spec) -> None:
    assert _check_finite(make.cpp_class(spec)) == _check_finite(make.submodel(spec))


@pytest.mark.variants(3)
@pytest.mark.parametrize("kind", FmuKind)
@pytest.mark.parametrize("spec", [models.CART, models.PID, models.OSCILLATOR, models.MATRICES], ids=_ids)
def test_every_fmu_gives_the_submodels_outputs(make: Maker, spec: Spec, kind: FmuKind) -> None:
    # From zero, since an old FMU is initialized before its inputs can be set.
    inputs = [Input(0.0, 1e-3)] * len(spec.inputs)
    expected = native_outputs(make.submodel(spec), inputs, STEPS)
    found = native_outputs(make.fmu(spec, kind), inputs, STEPS)
    # A new FMU trims each step to the time that it is asked for: by the last bit or two.
    tolerance = 0.0 if kind is FmuKind.OLD else 1e-11
    for row, expected_row in zip(found, expected, strict=True):
        assert row == pytest.approx(expected_row, rel=tolerance, abs=tolerance)


def test_moved_class_without_xml_is_the_same_model(make: Maker) -> None:
    moved = make.cpp_class(models.TANK, Layout.MOVED, False)  # noqa: FBT003 - a key
    assert not list(moved.path.rglob("*.xml"))
    assert _check_finite(moved) == _check_finite(make.cpp_class(models.TANK))


def test_partial_copy_has_a_whole_models_equations(make: Maker) -> None:
    made = make.partial(models.TANK)
    names = {path.name for path in made.path.iterdir()}
    assert names == {"xxmodel.c", "xxmodel.h", "xxfuncs.c", "xxfuncs.h", "xxtypes.h"}
    assert _check_finite(made) == _check_finite(make.submodel(models.TANK))


@pytest.mark.variants(3)
@pytest.mark.parametrize("name", RUNNABLE)
def test_variants_run(make: Maker, name: str) -> None:
    _check_finite(make.variant(name))


@pytest.mark.variants(1)
@pytest.mark.parametrize("name", ["wrong_case_header", "stale_xml", "odd_folder", "build_copies", "algebraic_loop"])
def test_variants_compute_what_the_plain_model_does(make: Maker, name: str) -> None:
    assert _check_finite(make.variant(name)) == _check_finite(make.submodel(models.TANK))


def test_cart_is_the_cart(make: Maker) -> None:
    speed, turn, steps = 0.4, 0.7, 1000
    cart = Cart()
    cart.initialize([])
    cart.write("LinearSetpoint", speed)
    cart.write("AngularSetpoint", turn)
    expected = [cart.step([]) for _ in range(steps)]
    # Rates again after the writes: a step begins with those that the call before it has left.
    writes = [Write(1, "s", SETPOINT, speed), Write(1, "s", ANGULAR_SETPOINT, turn, dynamic=True)]
    for made in (make.submodel(models.CART), make.cpp_class(models.CART)):
        found = native_outputs(made, [], steps, writes)[1:]
        for row, expected_row in zip(found, expected, strict=True):
            assert row == pytest.approx(expected_row, rel=0, abs=1e-12)


def test_written_state_reaches_the_first_stage_a_step_late(make: Maker) -> None:
    made = make.submodel(models.TANK)
    late = native_outputs(made, [Input()], 2, [Write(1, "s", 0, 30.0)])
    # Volume 30: the first Euler step adds the old rate, zero; the next one 2 * (10 - 15) * 0.01.
    assert [row[0] for row in late] == pytest.approx([10.0, 15.0, 14.95], abs=1e-12)


@pytest.mark.parametrize(
    ("spec", "calls_a_step"),
    [(models.CART, 4), (models.OSCILLATOR, 2), (models.TANK, 1), (models.PID, 1)],
    ids=["RungeKutta4", "RungeKutta2", "Euler", "Discrete"],
)
def test_steps_count_the_calls_of_the_dynamic_equations(make: Maker, spec: Spec, calls_a_step: int) -> None:
    assert native_run(make.submodel(spec), [Input()] * len(spec.inputs), 25).calls == calls_a_step * 25 + 1


def test_tank_ignores_its_set_point_until_the_static_equations_run(make: Maker) -> None:
    made = make.submodel(models.TANK)
    ignored = native_outputs(made, [Input()], 1000, [Write(1, "P", 0, 30.0)])
    heeded = native_outputs(made, [Input()], 1000, [Write(1, "P", 0, 30.0, static=True)])
    assert {row[0] for row in ignored} == {10.0}
    # One time constant is a second; 1000 steps are ten.
    assert heeded[-1][0] == pytest.approx(30.0 - 20.0 * math.exp(-10.0), abs=2e-4)


def test_class_runs_its_static_equations_at_every_step(make: Maker) -> None:
    rows = native_outputs(make.cpp_class(models.TANK), [Input()], 1000, [Write(1, "P", 0, 30.0)])
    assert rows[-1][0] == pytest.approx(30.0, abs=2e-3)


def test_class_stops_silently_at_its_finish_time(make: Maker) -> None:
    run = native_run(make.cpp_class(models.TANK), [RAMP], 1100, keep_end=True)
    assert run.stopped
    assert run.time == pytest.approx(10.0)
    assert run.outputs[1000] == run.outputs[1100]


def test_initial_equations_take_a_parameter_at_the_start_only(make: Maker) -> None:
    made = make.submodel(more_models.INITIAL)
    plain = native_outputs(made, [], 50)
    assert native_outputs(made, [], 50, [Write(10, "P", 0, 40.0, static=True, dynamic=True)]) == plain
    assert native_outputs(made, [], 50, [Write(0, "P", 0, 40.0)])[0] == [40.0]


def test_literal_is_no_parameter() -> None:
    assert [parameter.name for parameter in more_models.LITERAL.parameters] == [r"Loop\K"]


def test_model_can_stop_itself(make: Maker) -> None:
    run = native_run(make.submodel(more_models.STOPPING), [Input(3.0)], 100)
    assert run.stopped
    assert run.outputs[-1][0] == pytest.approx(1.02)


def test_matrices_are_inverted(make: Maker) -> None:
    # y = A^-1 x, and x starts at (1, 0): the first column of the inverse of ((-1/2, 1), (-1, -1/4)), whose
    # determinant is 9/8.
    first = native_outputs(make.submodel(models.MATRICES), [Input()], 0)[0]
    assert first == pytest.approx([-0.25 / 1.125, 1.0 / 1.125], rel=1e-15)


def test_old_fmu_fails_after_the_time_that_is_baked_in(make: Maker) -> None:
    run = native_run(make.fmu(models.TANK, FmuKind.OLD), [Input()], 1100, keep_end=True)
    assert run.stopped
    assert run.time == pytest.approx(10.0, abs=0.03)


@pytest.mark.parametrize(("kind", "instances"), [(FmuKind.OLD, 1), (FmuKind.NEW, 2)])
def test_only_old_fmus_give_the_same_instance_twice(make: Maker, tmp_path: Path, kind: FmuKind, instances: int) -> None:
    with zipfile.ZipFile(make.fmu(models.TANK, kind).path) as archive:
        archive.extractall(tmp_path)
    (binary,) = (tmp_path / fmu.BINARY).iterdir()
    guid = ET.fromstring((tmp_path / "modelDescription.xml").read_bytes()).attrib["guid"]  # noqa: S314 - our own file
    library = ctypes.CDLL(str(binary))
    library.fmi2Instantiate.restype = ctypes.c_void_p
    callbacks = _callbacks()
    found = {library.fmi2Instantiate(b"one", 1, guid.encode(), b"", ctypes.byref(callbacks), 0, 0) for _ in range(2)}
    assert None not in found
    assert len(found) == instances


class _Callbacks(ctypes.Structure):
    _fields_ = (
        ("logger", ctypes.c_void_p),
        ("allocate", ctypes.c_void_p),
        ("free", ctypes.c_void_p),
        ("finished", ctypes.c_void_p),
        ("environment", ctypes.c_void_p),
    )


def _callbacks() -> _Callbacks:
    process = ctypes.CDLL(None)
    at = {name: ctypes.cast(getattr(process, name), ctypes.c_void_p) for name in ("printf", "calloc", "free")}
    return _Callbacks(at["printf"], at["calloc"], at["free"], None, None)


def test_old_code_keeps_empty_arrays_and_new_code_leaves_them_out(make: Maker) -> None:
    old = (make.submodel(models.LIMITER, Style.V46).path / "xxmodel.c").read_text(encoding="utf-8")
    new = (make.submodel(models.LIMITER).path / "xxmodel.c").read_text(encoding="utf-8")
    assert "XXDouble xx_s[0 + 1];" in old
    assert "xx_s[" not in new


def test_arguments_without_ports_are_left_out_of_new_prototypes(make: Maker) -> None:
    old = (make.submodel(models.OSCILLATOR, Style.V46).path / "xxsubmod.h").read_text(encoding="utf-8")
    new = (make.submodel(models.OSCILLATOR).path / "xxsubmod.h").read_text(encoding="utf-8")
    assert "XXCalculateSubmodel (XXDouble *u, XXDouble *y, XXDouble t);" in old
    assert "XXCalculateSubmodel (XXDouble *y, XXDouble t);" in new


def test_mixed_encodings_are_really_mixed(make: Maker) -> None:
    folder = make.variant("crlf_latin1").path
    assert b"\r\n" in (folder / "xxmodel.c").read_bytes()
    assert b"\xb0C}" in (folder / "xxmodel.c").read_bytes()
    assert b"\r" not in (folder / "xxsubmod.c").read_bytes()
    assert "°C}".encode() in (folder / "xxsubmod.c").read_bytes()
    root = ET.fromstring((folder / "tokens.xml").read_bytes())  # noqa: S314 - our own file
    assert [token.text for token in root if token.get("name") == "OUTPUT_NAMES3"] == ["Wärme\n"]


def test_fmu_is_the_same_file_every_time(tmp_path: Path) -> None:
    spec = dataclasses.replace(models.LIMITER, name="Twice")
    first, second = (fmu.write(spec, tmp_path / name / "x.fmu", FmuKind.NEW).path for name in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()


def test_missing_function_is_declared_and_called_only(tmp_path: Path) -> None:
    folder = variants.missing_dll(tmp_path).path
    lines = [line for path in folder.glob("*.[ch]") for line in path.read_text().splitlines()]
    code = [line.strip() for line in lines if "drive_characteristic (" in line and "/*" not in line]
    assert sorted(code) == [
        "XXDouble drive_characteristic (XXDouble argument);",
        "xx_V[0] = drive_characteristic (xx_V[1]);",
    ]


def test_ramp_is_counted_from_the_first_step() -> None:
    assert input_at([Input(1.0, 0.5), Input(2.0)], 3) == [2.5, 2.0]


def test_prefix_is_everywhere(tmp_path: Path) -> None:
    folder = generate.submodel(models.TANK, tmp_path / "tank", Style.V48, "tank").path
    text = (folder / "xxsubmod.c").read_text(encoding="utf-8")
    assert "void TANKInitializeSubmodel (XXDouble *u, XXDouble *y, XXDouble t)" in text
    assert "xx_" not in text
