# SPDX-License-Identifier: MIT
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction

import pytest

from segway_ecc.node.errors import ModelError, UnknownNameError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel

NOT_FINITE = [math.nan, math.inf, -math.inf]


class Sections(SectionedModel):
    """Notes each section as it runs. x' = rate, held' = 0, y = gain x + u."""

    name = "sections"
    step_size = 0.1
    method = Method.EULER
    inputs = (Variable("u", "V", 0.5),)
    outputs = (Variable("y", "m", -1.0),)
    parameters = (
        Variable("gain", value=2.0, write=Write.STATIC),
        Variable("rate", "m/s", 1.0, Write.NOW),
        Variable("start", "m", 3.0, Write.RESET),
        Variable("fixed", value=9.0),
    )
    states = (Variable("x", "m"), Variable("held", "m/s", 5.0, Write.NOW))

    def __init__(self, parameters: Mapping[str, float] | None = None) -> None:
        super().__init__(parameters)
        self.ran: list[str] = []
        self.times: list[float] = []

    def initial(self) -> None:
        self.ran.append("initial")
        self.s[0] = self.p["start"]

    def static(self) -> None:
        self.ran.append("static")
        self.gain = self.p["gain"]

    def input(self, u: Sequence[float]) -> None:
        self.ran.append("input")
        self.u = u[0]

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        self.ran.append("dynamic")
        self.times.append(t)
        assert len(s) == 2
        return (self.p["rate"], 0.0)

    def output(self) -> Sequence[float]:
        self.ran.append("output")
        return (self.gain * self.s[0] + self.u,)

    def final(self) -> None:
        self.ran.append("final")


@pytest.fixture
def model() -> Sections:
    model = Sections()
    model.initialize([0.0])
    return model


def test_the_sections_run_in_the_order_of_20_sim() -> None:
    model = Sections()
    model.initialize([0.0])
    assert model.ran == ["initial", "static", "input", "output"]
    model.ran.clear()
    model.step([0.0])
    assert model.ran == ["input", "dynamic", "output"]
    model.ran.clear()
    model.terminate()
    assert model.ran == ["final"]


def test_the_dynamic_section_runs_as_often_as_the_method_asks() -> None:
    class Classical(Sections):
        method = Method.RUNGE_KUTTA_4

    model = Classical()
    model.initialize([0.0])
    model.ran.clear()
    model.step([0.0])
    assert model.ran == ["input", *["dynamic"] * 4, "output"]


def test_outputs_are_those_of_the_end_of_the_step_under_its_own_inputs(model: Sections) -> None:
    assert Sections().initialize([0.25]) == [2.0 * 3.0 + 0.25]
    assert model.step([0.5]) == [pytest.approx(2.0 * 3.1 + 0.5)]
    assert model.step([0.0]) == [pytest.approx(2.0 * 3.2)]


def test_a_step_starts_at_the_time_that_the_last_one_reached(model: Sections) -> None:
    model.step([0.0])
    model.step([0.0])
    assert model.times == [0.0, 0.1]
    assert model.time == 0.2


def test_time_has_no_summation_error() -> None:
    class Bare(SectionedModel):
        name = "bare"
        step_size = 0.01

    steps = 100_003
    model = Bare()
    model.initialize(())
    summed = 0.0
    for _ in range(steps):
        model.step(())
        summed += 0.01
    assert model.time == float(Fraction(steps, 100))
    assert model.time != summed  # so that the line above could have failed


def test_initializing_again_starts_over(model: Sections) -> None:
    model.write("held", 1.0)
    model.step([1.0])
    assert model.initialize([0.0]) == [6.0]
    assert (model.time, model.s) == (0.0, [3.0, 5.0])
    model.step([0.0])
    assert model.time == 0.1


def test_an_artificial_state_keeps_what_is_written_while_running(model: Sections) -> None:
    model.step([0.0])
    model.write("held", -0.1)
    assert model.read("held") == -0.1
    for _ in range(1000):
        model.step([0.0])
    assert model.read("held") == -0.1


def test_a_write_now_takes_effect_at_the_next_step(model: Sections) -> None:
    model.write("rate", 5.0)
    assert model.step([0.0]) == [pytest.approx(2.0 * 3.5)]


def test_a_static_write_runs_the_static_equations_and_takes_effect_at_the_next_step(model: Sections) -> None:
    model.ran.clear()
    model.write("gain", 10.0)
    assert model.ran == ["static"]
    assert model.read("y") == 6.0  # an output already given stays what it was
    assert model.step([0.0]) == [pytest.approx(31.0)]


def test_a_write_now_runs_no_section(model: Sections) -> None:
    model.ran.clear()
    model.write("rate", 5.0)
    model.write("held", 5.0)
    assert model.ran == []


def test_a_reset_write_to_a_parameter_takes_effect_when_initialized_again(model: Sections) -> None:
    model.write("start", 7.0)
    assert model.step([0.0]) == [pytest.approx(2.0 * 3.1)]
    assert model.initialize([0.0]) == [14.0]


def test_a_reset_write_to_a_state_takes_effect_when_initialized_again() -> None:
    class WithResetState(SectionedModel):
        name = "reset"
        step_size = 1.0
        states = (Variable("x", value=1.0, write=Write.RESET),)
        outputs = (Variable("y"),)

        def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
            del t
            return [0.0 for _ in s]

        def output(self) -> Sequence[float]:
            return self.s

    model = WithResetState()
    model.initialize(())
    model.write("x", 4.0)
    assert model.step(()) == [1.0]
    assert model.initialize(()) == [4.0]


@pytest.mark.parametrize("name", ["fixed", "x"])
def test_what_is_never_written_refuses_and_keeps_its_value(model: Sections, name: str) -> None:
    before = model.read(name)
    with pytest.raises(ModelError, match=f"^'{name}' of model 'sections' cannot be written while it runs$"):
        model.write(name, 1.0)
    assert model.read(name) == before


@pytest.mark.parametrize("value", NOT_FINITE)
@pytest.mark.parametrize("name", ["held", "rate", "gain", "start"])
def test_a_value_that_is_not_finite_is_refused_and_the_old_one_kept(model: Sections, name: str, value: float) -> None:
    before = model.read(name)
    with pytest.raises(ModelError, match=f"^'{name}' cannot be {value}: only finite values are taken$"):
        model.write(name, value)
    assert model.read(name) == before


@pytest.mark.parametrize("value", NOT_FINITE)
def test_a_parameter_that_is_not_finite_is_refused_from_the_start(value: float) -> None:
    with pytest.raises(ModelError, match=f"^'gain' cannot be {value}"):
        Sections({"gain": value})


def test_parameters_other_than_their_defaults_are_in_force_from_the_start() -> None:
    assert Sections({"start": 1, "gain": 4.0}).initialize([0.0]) == [4.0]
    assert Sections({"start": 1}).read("fixed") == 9.0


def test_one_model_s_parameters_are_not_those_of_another() -> None:
    first, second = Sections(), Sections()
    first.write("rate", 5.0)
    assert second.read("rate") == 1.0


def test_everything_can_be_read_by_name(model: Sections) -> None:
    assert Sections().read("u") == 0.5
    assert Sections().read("y") == -1.0
    assert Sections().read("held") == 5.0
    model.step([0.75])
    values = {name: model.read(name) for name in ("gain", "rate", "x", "held", "u", "y")}
    assert values == {"gain": 2.0, "rate": 1.0, "x": 3.1, "held": 5.0, "u": 0.75, "y": pytest.approx(6.95)}


def test_an_unknown_parameter_is_refused_with_those_that_there_are() -> None:
    text = "^no parameter of model 'sections' is called 'Gain'; there is gain, rate, start, fixed$"
    with pytest.raises(UnknownNameError, match=text) as caught:
        Sections({"Gain": 1.0})
    assert (caught.value.name, caught.value.known) == ("Gain", ("gain", "rate", "start", "fixed"))


def test_reading_an_unknown_name_is_refused_with_those_that_there_are(model: Sections) -> None:
    text = "^no variable of model 'sections' is called 'z'; there is gain, rate, start, fixed, x, held, u, y$"
    with pytest.raises(UnknownNameError, match=text):
        model.read("z")


@pytest.mark.parametrize("name", ["z", "u", "y"])
def test_writing_what_is_no_parameter_or_state_is_refused_with_those_that_there_are(model: Sections, name: str) -> None:
    text = f"^no writable variable of model 'sections' is called '{name}'; there is gain, rate, start, fixed, x, held$"
    with pytest.raises(UnknownNameError, match=text):
        model.write(name, 1.0)


@pytest.mark.parametrize("u", [[], [1.0, 2.0]])
def test_a_wrong_number_of_inputs_is_refused(model: Sections, u: list[float]) -> None:
    text = f"^model 'sections' has 1 inputs and was given {len(u)}$"
    with pytest.raises(ModelError, match=text):
        model.step(u)
    with pytest.raises(ModelError, match=text):
        Sections().initialize(u)
    assert (model.time, model.s) == (0.0, [3.0, 5.0])


class Inverse(Sections):
    """Its static equations divide by the gain."""

    def static(self) -> None:
        super().static()
        self.inverse = 1.0 / self.p["gain"]


def test_a_write_that_fails_in_the_static_equations_is_refused_whole() -> None:
    model = Inverse()
    model.initialize([0.0])
    with pytest.raises(ZeroDivisionError):
        model.write("gain", 0.0)
    assert (model.read("gain"), model.inverse) == (2.0, 0.5)
    model.write("gain", 4.0)
    assert model.inverse == 0.25
