# SPDX-License-Identifier: MIT
from dataclasses import replace
from pathlib import Path

import pytest

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import LARGEST, Variable, Write
from segway_ecc.node.native.fmu.description import FmuLayout, describe
from segway_ecc.node.native.fmu.facts import read_facts
from segway_ecc.node.native.fmu.twenty_sim import TwentySim, read_twenty_sim
from segway_ecc.node.native.library import Description, Flavour
from tests.fixtures.tiny_fmu.make import CONFIGURATION, NAME_OF_INPUT, Shape, description

NOTHING: frozenset[str] = frozenset()
TOKENS = """<?xml version="1.0" encoding="ISO-8859-1"?>
<tokens>
  <token name="INTEGRATION_METHOD_NAME"><![CDATA[RungeKutta4]]></token>
  <token name="TIME_STEP_SIZE"><![CDATA[0.002]]></token>
  <token name="STATIC_EQUATIONS"><![CDATA[ xx_V[3] = xx_P[1] * 2.0; /* Plant\\scale */ ]]></token>
  <token name="INITIALIZE_PARAMETERS"><![CDATA[
    xx_P[0] = 0.75; /* Controller\\gain {1/s} */
    xx_P[1] = 1.5; /* Plant\\scale factor */
  ]]></token>
</tokens>
"""
OLD = TwentySim(
    globals=True,
    restart_symbols=("a", "b", "c", "d", "e"),
    starting_symbol=None,
    static_symbol="XXCalculateStatic",
    stop_symbol=None,
    updates_itself=False,
    step_size=None,
    method="Euler",
    states=(),
    units={},
    values={},
    sections={"Controller.gain": frozenset({"Dynamic"}), "Plant.scale factor": frozenset({"Static", "Output"})},
)
INITIAL = {"Controller.gain": frozenset({"Initial", "Dynamic"}), "Plant.scale factor": frozenset({"Initial"})}
NEW = replace(OLD, globals=False, static_symbol=None)


def laid_out(
    folder: Path,
    text: str,
    twenty_sim: TwentySim | None = None,
    step_size: float | None = None,
    encoding: str = "latin-1",
) -> FmuLayout:
    (folder / "modelDescription.xml").write_bytes(text.encode(encoding))
    return describe(read_facts(folder, Path("tiny.fmu")), twenty_sim, step_size, Path("tiny.fmu"))


def found(folder: Path, tool: str = "20-sim 4.6", symbols: frozenset[str] = NOTHING) -> TwentySim:
    (folder / "modelDescription.xml").write_bytes(description(Shape.OLD).encode("latin-1"))
    twenty_sim = read_twenty_sim(folder, tool, symbols)
    assert twenty_sim is not None
    return twenty_sim


class TestDescription:
    @pytest.mark.parametrize("shape", [Shape.OTHER, Shape.FMI3], ids=lambda shape: shape.name)
    def test_matches_the_model_description(self, shape: Shape, tmp_path: Path) -> None:
        layout = laid_out(tmp_path, description(shape))
        assert layout.description == Description(
            name="tiny",
            flavour=Flavour.FMI3 if shape is Shape.FMI3 else Flavour.FMI2,
            build="Tool 1.0",
            method="",
            step_size=0.01,
            finish_time=1.0,
            inputs=(Variable(NAME_OF_INPUT, "rad"),),
            outputs=(Variable("Plant.y", "m"), Variable("Plant.z")),
            parameters=(
                Variable("Controller.gain", "1/s", 0.75, Write.NOW, "tunable"),
                Variable("Plant.scale factor", "1", 1.5, Write.NOW, "tunable"),
                Variable("x_initial", "1", 0.25, Write.RESET, "fixed: the FMU takes it when it initializes"),
            ),
            states=(Variable("Plant.x", "1", 0.25, Write.RESET, "the FMU takes its start value when it initializes"),),
        )
        assert layout.references == ((4,), (5, 8), (0, 1, 2), (6,))
        assert layout.followers == (-1, -1, -1)

    @pytest.mark.parametrize("encoding", ["ISO-8859-1", "UTF-8", "UTF-16", "windows-1252"])
    def test_reads_names_in_the_declared_encoding(self, encoding: str, tmp_path: Path) -> None:
        text = description(Shape.OTHER).replace("ISO-8859-1", encoding)
        assert laid_out(tmp_path, text, encoding=encoding).description.inputs[0].name == "Regler.Stell\u00f6ffnung"

    def test_names_parameters_that_cannot_be_written(self, tmp_path: Path) -> None:
        more = (
            '<ScalarVariable name="c" valueReference="30" causality="calculatedParameter"><Real/></ScalarVariable>'
            '<ScalarVariable name="n" valueReference="31" causality="parameter"><Integer start="3"/></ScalarVariable>'
            '<ScalarVariable name="path" valueReference="1" causality="parameter"><String start=""/></ScalarVariable>'
            '<ScalarVariable name="k" valueReference="32" causality="parameter" variability="constant"><Real/>'
            "</ScalarVariable>"
        )
        made = laid_out(tmp_path, description(Shape.OTHER, more=more)).description
        assert made.parameters[-1] == Variable("c", "1", 0.0, Write.NEVER, "calculated from other parameters")
        assert made.parameters[-2] == Variable("k", "1", 0.0, Write.NEVER, "constant")
        assert made.warnings == ("parameters that are not real numbers keep their values and are not shown: n, path",)

    def test_reports_a_state_that_the_fmu_calculates(self, tmp_path: Path) -> None:
        text = description(Shape.OTHER).replace('initial="exact"', 'initial="calculated"')
        (state,) = laid_out(tmp_path, text).description.states
        assert (state.write, state.why) == (Write.NEVER, "the FMU calculates it")

    def test_refuses_a_causality_that_is_not_in_the_standard(self, tmp_path: Path) -> None:
        text = description(Shape.OTHER).replace('causality="local"', 'causality="inner"', 1)
        with pytest.raises(ModelError, match=r"causality of variable 'Plant\.x' in .* is 'inner'"):
            laid_out(tmp_path, text)


class TestStep:
    @pytest.mark.parametrize(
        ("asked", "own", "given", "step"),
        [(True, None, None, 0.01), (True, 0.02, None, 0.01), (False, 0.02, None, 0.02), (True, 0.02, 0.04, 0.04)],
    )
    def test_is_the_one_given_or_asked_for_or_20_sims(
        self,
        asked: bool,  # noqa: FBT001 - a case
        own: float | None,
        given: float | None,
        step: float,
        tmp_path: Path,
    ) -> None:
        text = description(Shape.OLD, step=asked)
        assert laid_out(tmp_path, text, replace(OLD, step_size=own), given).description.step_size == step

    def test_may_be_fixed_in_fmi_3(self, tmp_path: Path) -> None:
        interface = '<CoSimulation modelIdentifier="tiny" fixedInternalStepSize="0.005"/>'
        text = description(Shape.FMI3, step=False, interface=interface)
        assert laid_out(tmp_path, text).description.step_size == 0.005
        assert laid_out(tmp_path, text, step_size=0.01).description.warnings == (
            "the FMU asks for steps of 0.005 s and is given 0.01 s, which it does not promise to take",
        )

    @pytest.mark.parametrize("step", [0.015, 0.005, 0.0100001])
    def test_of_20_sim_is_a_multiple_of_the_models_own_or_is_warned_about(self, step: float, tmp_path: Path) -> None:
        warnings = laid_out(tmp_path, description(Shape.NEW), NEW, step).description.warnings
        assert warnings == (
            f"the model's own step is 0.01 s: a step of {step} s is no multiple of it, so its time runs ahead",
        )
        assert laid_out(tmp_path, description(Shape.NEW), NEW, 0.03).description.warnings == ()

    @pytest.mark.parametrize("step", [0.0, -0.01, float("nan"), float("inf")])
    def test_is_positive(self, step: float, tmp_path: Path) -> None:
        with pytest.raises(ModelError, match=r"a step of .* s cannot be taken by FMU tiny\.fmu: give a positive one"):
            laid_out(tmp_path, description(Shape.OTHER), step_size=step)


class TestTwentySim:
    @pytest.mark.parametrize(
        ("twenty_sim", "gain", "factor"),
        [
            (OLD, Write.NOW, Write.STATIC),
            (replace(OLD, sections={}), Write.STATIC, Write.STATIC),
            (replace(OLD, static_symbol=None), Write.NOW, Write.NEVER),
            (NEW, Write.NOW, Write.RESET),
            (replace(NEW, updates_itself=True), Write.NOW, Write.NOW),
            (replace(NEW, sections={}), Write.NOW, Write.NOW),
            (replace(NEW, sections=INITIAL), Write.NOW, Write.RESET),
            (replace(OLD, sections=INITIAL), Write.NOW, Write.RESET),
            (replace(OLD, sections=INITIAL, restart_symbols=()), Write.NOW, Write.NEVER),
        ],
    )
    def test_reports_when_a_tunable_parameter_takes_effect(
        self, twenty_sim: TwentySim, gain: Write, factor: Write, tmp_path: Path
    ) -> None:
        parameters = laid_out(tmp_path, description(Shape.OLD), twenty_sim).description.parameters
        assert [parameter.write for parameter in parameters[:2]] == [gain, factor]
        assert all(parameter.why for parameter in parameters)

    def test_starts_a_state_from_its_initial_value(self, tmp_path: Path) -> None:
        text = description(Shape.OLD).replace("x_initial", "Plant.x_initial")
        old = laid_out(tmp_path, text, replace(OLD, states=("Plant.x",)))
        assert (old.followers, old.description.parameters[2].write) == ((-1, -1, 0), Write.RESET)
        stuck = laid_out(tmp_path, text, replace(OLD, states=("Plant.x",), restart_symbols=()))
        assert (stuck.followers, stuck.description.parameters[2].write) == ((-1, -1, -1), Write.NEVER)
        hidden = laid_out(tmp_path, text, OLD)
        assert (hidden.followers, hidden.description.parameters[2].write) == ((-1, -1, -1), Write.NEVER)
        new = laid_out(tmp_path, text, replace(NEW, states=("Plant.x",)))
        assert (new.followers, new.description.parameters[2].write) == ((-1, -1, 0), Write.RESET)
        other = laid_out(tmp_path, description(Shape.OTHER).replace("x_initial", "Plant.x_initial"))
        assert other.followers == (-1, -1, -1)

    def test_warns_of_outputs_that_precede_the_inputs(self, tmp_path: Path) -> None:
        (warning,) = laid_out(tmp_path, description(Shape.OLD), OLD).description.warnings
        assert warning.startswith("outputs at time zero belong to the FMU's own inputs")

    def test_gives_states_units_and_step_from_its_configuration(self, tmp_path: Path) -> None:
        (tmp_path / "resources").mkdir()
        (tmp_path / "resources" / "ModelConfiguration.xml").write_text(CONFIGURATION)
        twenty_sim = found(tmp_path)
        assert (twenty_sim.states, twenty_sim.step_size) == (("Plant.x",), 0.01)
        text = description(Shape.NEW).replace('initial="exact"><Real start="0.25"/>', "><Real/>")
        made = laid_out(tmp_path, text, twenty_sim).description
        assert made.states == (Variable("Plant.x", "m", -0.125, Write.NOW, "20-sim's FMUs take a state at any time"),)
        assert made.outputs[1] == Variable("Plant.z", "mm")

    def test_gives_the_elements_of_a_state_that_is_a_vector(self, tmp_path: Path) -> None:
        more = "".join(
            f'<ScalarVariable name="{name}" valueReference="{place}"><Real/></ScalarVariable>'
            for place, name in enumerate(("q[0]", "q[1]", "q[0].extra", "qq[0]"), start=20)
        )
        layout = laid_out(tmp_path, description(Shape.NEW, more=more), replace(NEW, states=("q",)))
        assert ([state.name for state in layout.description.states], layout.references[3]) == (
            ["q[0]", "q[1]"],
            (20, 21),
        )

    def test_reads_tokens(self, tmp_path: Path) -> None:
        (tmp_path / "tokens.xml").write_text(TOKENS)
        twenty_sim = found(tmp_path)
        assert (twenty_sim.method, twenty_sim.step_size) == ("RungeKutta4", 0.002)
        assert twenty_sim.sections == {"Controller.gain": frozenset(), "Plant.scale factor": {"Static"}}

    @pytest.mark.parametrize("wrap", ["<![CDATA[{}]]>", "{}"], ids=["text", "elements"])
    def test_reads_a_configuration_within_the_tokens(self, wrap: str, tmp_path: Path) -> None:
        inner = CONFIGURATION if "CDATA" in wrap else CONFIGURATION.split("?>", 1)[1]
        token = f'<token name="MODEL_CONFIGURATION">{wrap.format(inner)}</token></tokens>'
        (tmp_path / "tokens.xml").write_text(TOKENS.replace("</tokens>", token))
        twenty_sim = found(tmp_path)
        assert (twenty_sim.states, twenty_sim.step_size) == (("Plant.x",), 0.01)

    def test_reads_its_annotation(self, tmp_path: Path) -> None:
        note = '<VendorAnnotations><Tool name="20-sim"><Run stepSize="0.004"/></Tool></VendorAnnotations>'
        text = description(Shape.OLD, step=False).replace("<ModelStructure>", f"{note}<ModelStructure>")
        (tmp_path / "modelDescription.xml").write_bytes(text.encode("latin-1"))
        twenty_sim = read_twenty_sim(tmp_path, "20-sim 5.1", NOTHING)
        assert twenty_sim is not None
        assert twenty_sim.step_size == 0.004

    def test_reads_sources_with_any_prefix_line_end_and_encoding(self, tmp_path: Path) -> None:
        code = (
            "void abModelInitialize (void)\n{\n\tab_P[0] = 1.0;\t\t/* Gr\u00f6\u00dfe\\kp {N} */\n"
            "\tab_P[1] = 2.0;\t\t/* ti */\n}\n"
            "void ABCalculateStatic (void)\n{\n\tif (1) {\n\t\tab_V[1] = ab_P[1];\n\t}\n}\n"
            "void ABCalculateDynamic (void)\n{\n\tab_V[0] = ab_P[0];\n}\n"
        )
        (tmp_path / "sources").mkdir()
        (tmp_path / "sources" / "abmodel.c").write_bytes(code.replace("\n", "\r\n").encode("latin-1"))
        (tmp_path / "sources" / "absubmod.c").write_text("\tABRungeKutta2Step (model_instance);\n")
        twenty_sim = found(tmp_path, symbols=frozenset({"ABCalculateStatic", "ab_MEMORY", "ab_stop_simulation"}))
        assert twenty_sim.sections == {"Gr\u00f6\u00dfe.kp": {"Dynamic"}, "ti": {"Static"}}
        assert (twenty_sim.method, twenty_sim.globals) == ("RungeKutta2", True)
        assert twenty_sim.restart_symbols == ()
        assert (twenty_sim.static_symbol, twenty_sim.stop_symbol) == ("ABCalculateStatic", "ab_stop_simulation")

    @pytest.mark.parametrize(("memory", "expected"), [({"ab_MEMORY"}, 5), (set[str](), 0)])
    def test_can_start_again_where_it_keeps_its_values_in_globals(
        self, memory: set[str], expected: int, tmp_path: Path
    ) -> None:
        sections = ("Output", "Input", "Initial", "Static", "Dynamic", "Final")
        names = {f"ABCalculate{section}" for section in sections} | {"ab_initialize", "ABModelInitialize"}
        twenty_sim = found(tmp_path, symbols=frozenset(names | memory))
        order = (
            "ABCalculateInitial",
            "ABCalculateStatic",
            "ABCalculateInput",
            "ABCalculateDynamic",
            "ABCalculateOutput",
        )
        assert twenty_sim.restart_symbols == order[:expected]
        assert twenty_sim.starting_symbol == "ab_initialize"

    def test_is_not_suspected_behind_another_tool(self, tmp_path: Path) -> None:
        (tmp_path / "modelDescription.xml").write_bytes(description(Shape.OTHER).encode("latin-1"))
        assert read_twenty_sim(tmp_path, "Tool 1.0", frozenset({"CalculateStatic"})) is None


def test_ranges_are_those_of_the_variable_or_else_of_its_type(tmp_path: Path) -> None:
    text = description(Shape.OLD)
    text = text.replace('<Real unit="rad"/>', '<Real unit="rad" min="-1.5" max="1.5"/>')
    text = text.replace('start="0" declaredType', 'start="0" max="0.5" declaredType')
    text = text.replace('start="0.75" unit', 'start="0.75" min="0.5" unit')
    found = laid_out(tmp_path, text).description
    (port,), gain, scale = found.inputs, *found.parameters[:2]
    assert (port.minimum, port.maximum, port.range_text) == (-1.5, 0.5, "-1.5 to 0.5 rad")
    assert (gain.minimum, gain.maximum, gain.range_text) == (0.5, LARGEST, "0.5 or more 1/s")
    assert (scale.minimum, scale.maximum, scale.range_text) == (-LARGEST, LARGEST, "")


@pytest.mark.parametrize("bounds", ['min="1.0"', 'max="0.5"', 'min="2" max="1"'])
def test_a_start_value_beyond_its_range_is_refused(tmp_path: Path, bounds: str) -> None:
    text = description(Shape.OLD).replace('start="0.75" unit', f'start="0.75" {bounds} unit')
    with pytest.raises(ModelError, match=r"^variable 'Controller.gain' has the range .*, and starts at 0.75: correct"):
        laid_out(tmp_path, text)
