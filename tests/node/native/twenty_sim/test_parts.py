# SPDX-License-Identifier: MIT
"""What is found out about generated code by reading it; nothing is compiled here."""

import shutil
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Write
from segway_ecc.node.native.library import Description, Flavour
from segway_ecc.node.native.twenty_sim.files import read_folder
from segway_ecc.node.native.twenty_sim.model import describe_model
from segway_ecc.node.native.twenty_sim.names import Label, find_ports, label_of, read_tables
from segway_ecc.node.native.twenty_sim.parts import find_parts
from tests.fixtures.twenty_sim import models, more_models
from tests.fixtures.twenty_sim.made import Layout, Made, Style
from tests.fixtures.twenty_sim.maker import Maker
from tests.fixtures.twenty_sim.spec import Spec


def describe(path: Path, method: str | None = None, step_size: float | None = None) -> Description:
    folder = read_folder(path)
    parts = find_parts(folder)
    table = read_tables(folder.tables)
    return describe_model(parts, table, find_ports(parts, table), method, step_size)


def assert_as_specified(made: Made, found: Description, flavour: Flavour) -> None:
    spec = made.spec
    assert (found.name, found.flavour, found.method) == (spec.name, flavour, spec.method)
    assert (found.step_size, found.finish_time) == (spec.step_size, spec.finish_time)
    assert found.build == f"20-sim {made.style}, July 1, 2021"
    assert [(v.name, v.unit) for v in found.inputs] == [(q.name, q.unit or "1") for q in spec.inputs]
    assert [(v.name, v.unit) for v in found.outputs] == [(q.name, q.unit or "1") for q in spec.outputs]
    for variables, quantities in ((found.parameters, spec.parameters), (found.states, spec.states)):
        expected = [(q.name, q.unit or "1", q.value) for q in quantities]
        assert [(v.name, v.unit, v.value) for v in variables] == expected
    assert found.warnings == ()


@pytest.mark.parametrize("spec", more_models.ALL, ids=lambda spec: spec.name)
@pytest.mark.parametrize(("style", "prefix"), [(Style.V46, "xx"), (Style.V48, "xx"), (Style.V48, "Yaw")])
def test_a_c_submodel_is_described_as_it_was_specified(make: Maker, spec: Spec, style: Style, prefix: str) -> None:
    made = make.submodel(spec, style, prefix)
    assert_as_specified(made, describe(made.path), Flavour.C_SUBMODEL)


@pytest.mark.parametrize("spec", more_models.ALL, ids=lambda spec: spec.name)
@pytest.mark.parametrize("layout", list(Layout))
@pytest.mark.parametrize("xml", [True, False])
def test_a_cpp_class_is_described_as_it_was_specified(
    make: Maker,
    spec: Spec,
    layout: Layout,
    xml: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    made = make.cpp_class(spec, layout, xml)
    assert_as_specified(made, describe(made.path), Flavour.CPP_CLASS)


def test_a_partial_copy_has_its_ports_guessed_with_a_warning(make: Maker) -> None:
    made = make.partial(models.PID)
    found = describe(made.path, "Discrete")
    assert found.flavour is Flavour.C_PARTIAL
    assert [v.name for v in found.inputs] == ["in", "position"]
    assert [v.name for v in found.outputs] == ["out"]
    (warning,) = found.warnings
    assert warning == (
        "xxmodel.c does not name its ports (xxsubmod and tokens.xml are missing): "
        "inputs are taken to be 'in', 'position' and outputs 'out'"
    )


def test_a_partial_copy_with_its_tokens_needs_no_guess(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.partial(models.PID).path, tmp_path / "partial")
    shutil.copy2(make.submodel(models.PID).path / "tokens.xml", path)
    found = describe(path, "Discrete")
    assert [(v.name, v.unit) for v in found.inputs] == [("in", "rad"), ("position", "rad")]
    assert found.warnings == ()


def test_a_partial_copy_without_a_table_of_names_takes_them_from_above_its_equations(
    make: Maker, tmp_path: Path
) -> None:
    path = shutil.copytree(make.partial(models.TANK).path, tmp_path / "partial")
    file = path / "xxmodel.c"
    text = file.read_text(encoding="utf-8")
    assert "variable_names" in text
    file.write_text(text.replace("variable_names", "variable_table"), encoding="utf-8")
    found = describe(path, "Euler")
    assert [v.name for v in found.inputs] == ["leak"]
    assert [v.name for v in found.outputs] == ["level"]


def test_the_method_or_step_that_a_partial_copy_lacks_has_to_be_given(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.partial(models.TANK).path, tmp_path / "partial")
    text = (
        r"names no integration method \(xxinteg and xxsubmod are missing\): "
        "pass method=, one of Discrete, Euler, RungeKutta2, RungeKutta4 to load_model$"
    )
    with pytest.raises(ModelError, match=text):
        describe(path)
    with pytest.raises(ModelError, match=r"^there is no method 'Heun'; there is Discrete, .*RungeKutta4$"):
        describe(path, "Heun")
    file = path / "xxmodel.c"
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(line for line in lines if "step_size = " not in line), encoding="utf-8")
    with pytest.raises(ModelError, match=r"gives no step size: pass step_size= in s to load_model$"):
        describe(path, "Euler")
    assert describe(path, "Euler", 0.02).step_size == 0.02


@pytest.mark.parametrize("step_size", [0.0, -0.01])
def test_a_step_size_that_is_not_positive_is_refused(make: Maker, tmp_path: Path, step_size: float) -> None:
    path = shutil.copytree(make.partial(models.TANK).path, tmp_path / "partial")
    file = path / "xxmodel.c"
    lines = file.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(line for line in lines if "step_size = " not in line), encoding="utf-8")
    with pytest.raises(ModelError, match=rf"has a step of {step_size:g} s, and a step must be longer than zero$"):
        describe(path, "Euler", step_size)


def test_the_codes_own_method_and_step_cannot_be_overridden(make: Maker) -> None:
    path = make.submodel(models.TANK).path
    with pytest.raises(ModelError, match=r"integrates with Euler; it cannot be made to use Discrete$"):
        describe(path, "Discrete")
    with pytest.raises(ModelError, match=r"has a step of 0.01 s; it cannot be made to use 0.02 s$"):
        describe(path, None, 0.02)


def test_a_method_that_a_header_defines_is_found_and_holds(make: Maker) -> None:
    made = make.partial(models.OSCILLATOR, Style.V48, True)  # noqa: FBT003 - with xxinteg
    assert describe(made.path).method == "RungeKutta2"
    with pytest.raises(ModelError, match=r"integrates with RungeKutta2; it cannot be made to use Euler$"):
        describe(made.path, "Euler")


def test_older_xml_is_warned_of_and_the_code_is_followed(make: Maker) -> None:
    found = describe(make.variant("stale_xml").path)
    assert found.step_size == 0.01
    assert [v.name for v in found.parameters] == [r"Setpoint\C", r"Controller\K", r"Tank\area"]
    assert found.warnings == (
        r"tokens.xml calls parameter 'Tank\area' of the code 'Tank\surface': the code is followed",
        "tokens.xml gives a step of 10.0755 s and the code has 0.01 s: the code is followed",
    )


def test_xml_of_another_size_is_warned_of(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    shutil.copy2(make.submodel(models.PID).path / "tokens.xml", path)
    assert "tokens.xml lists 6 parameters and the code has 3: the code is followed" in describe(path).warnings


def test_broken_xml_is_warned_of(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    (path / "tokens.xml").write_text("<tokens>", encoding="utf-8")
    (warning,) = describe(path).warnings
    assert warning.startswith("tokens.xml cannot be read (")


def test_names_beyond_ascii_and_with_spaces_come_through(make: Maker) -> None:
    found = describe(make.variant("crlf_latin1").path)
    assert [(v.name, v.unit) for v in found.outputs] == [("Wärme", "°C")]
    assert [v.name for v in found.parameters] == [r"Behälter\capacity", r"Behälter\loss"]
    spaced = describe(make.variant("spaced_names").path)
    assert [v.name for v in spaced.outputs] == ["outlet temperature"]
    assert spaced.states[0].name == r"Water Heater 1\state"


def test_every_name_of_a_model_is_its_own(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    (path / "tokens.xml").unlink()
    file = path / "xxmodel.c"
    text = file.read_text(encoding="utf-8").replace(r"/* Tank\volume {m3} */", "/* level {m3} */")
    text = text.replace(r"/* Controller\K {m2/s} */", r"/* Setpoint\C {m2/s} */").replace(r"/* Tank\area {m2} */", "")
    file.write_text(text, encoding="utf-8")
    found = describe(path)
    names = [v.name for v in (*found.inputs, *found.outputs, *found.parameters, *found.states)]
    assert names == ["leak", "level", r"Setpoint\C", r"Setpoint\C (parameter)", "parameter[2]", "level (state)"]
    assert found.warnings == (
        r"parameter 1 has the name 'Setpoint\C' of another variable: it is called 'Setpoint\C (parameter)' here",
        "parameter 2 has no name in the code: it is called 'parameter[2]' here",
        "state 0 has the name 'level' of another variable: it is called 'level (state)' here",
    )


def test_a_model_configuration_fills_in_what_comments_lack(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    (path / "tokens.xml").unlink()
    variables = "".join(
        f"<variable><name>{name}</name><unit><symbol>{unit}</symbol></unit>"
        f"<storage><name>xx_P</name><index>{index}</index></storage></variable>"
        for index, (name, unit) in enumerate([(r"Setpoint\C", "m"), (r"Controller\K", "m2/s"), (r"Tank\area", "m2")])
    )
    text = f"<modelConfiguration><variables>{variables}</variables></modelConfiguration>"
    (path / "ModelConfiguration.xml").write_text(text, encoding="utf-8")
    file = path / "xxmodel.c"
    file.write_text(file.read_text(encoding="utf-8").replace(r"/* Tank\area {m2} */", ""), encoding="utf-8")
    assert [(v.name, v.unit) for v in describe(path).parameters][2] == (r"Tank\area", "m2")


@pytest.mark.parametrize(
    ("comment", "label"),
    [
        (r"PID1\kp", Label(r"PID1\kp", "")),
        (r"PID1\tauD {s}", Label(r"PID1\tauD", "s")),
        (r"PID1\kp {}", Label(r"PID1\kp", "")),
        ("A[1,2] {N.m/rad}", Label("A[1,2]", "N.m/rad")),
        ("outlet temperature {C}", Label("outlet temperature", "C")),
        ("", Label()),
    ],
)
def test_a_comment_holds_a_name_and_perhaps_a_unit(comment: str, label: Label) -> None:
    assert label_of(comment) == label


def test_arrays_may_be_pointers_and_entry_points_may_lack_vectors(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    file = path / "xxmodel.c"
    text = file.read_text(encoding="utf-8")
    assert "XXDouble xx_P[" in text
    start = text.index("XXDouble xx_P[")
    line = text[start : text.index(";", start) + 1]
    file.write_text(text.replace(line, "XXDouble *xx_P = xx_MEMORY;"), encoding="utf-8")
    parts = find_parts(read_folder(path))
    assert parts.symbols["P"].is_pointer
    assert not parts.symbols["s"].is_pointer
    assert parts.symbols["s"].is_array


def test_a_folder_without_equations_is_refused(tmp_path: Path) -> None:
    (tmp_path / "xxfuncs.c").write_text("/* generated by 20-sim ANSI-C Code Generator */", encoding="utf-8")
    with pytest.raises(ModelError, match=r"holds no model: none of its C or C[+][+] files has dynamic equations$"):
        describe(tmp_path)


def test_a_folder_with_two_models_is_refused(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    shutil.copy2(path / "xxmodel.c", path / "yymodel.c")
    with pytest.raises(ModelError, match=r"holds 2 models \(xxmodel.c, yymodel.c\): give the folder of one of them$"):
        describe(path)


def test_other_numbers_than_floating_point_are_refused(make: Maker, tmp_path: Path) -> None:
    path = shutil.copytree(make.submodel(models.TANK).path, tmp_path / "tank")
    file = path / "xxtypes.h"
    text = file.read_text(encoding="utf-8").replace("typedef double XXDouble", "typedef fixed XXDouble")
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError, match=r"computes with numbers of type 'fixed'; only double and float can be used$"):
        describe(path)


def test_inputs_and_outputs_cannot_be_written(make: Maker) -> None:
    found = describe(make.submodel(models.TANK).path)
    assert {v.write for v in (*found.inputs, *found.outputs)} == {Write.NEVER}
