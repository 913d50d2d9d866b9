# SPDX-License-Identifier: MIT
"""What is as declared and what is not, with a stand-in for the robot; and one input to a real one."""

import contextlib
import itertools
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.drill.plant_control import Torque
from segway_ecc.hil.inputs import misbehaving_models, trial
from segway_ecc.hil.inputs.rig import Arrangement, Misbehaviour, Place, Starter, State
from segway_ecc.hil.inputs.table import ITEMS, all_trials
from segway_ecc.hil.inputs.trial import Declared, Event, InputResult, InputTrial, balances, ends, falls, run_all
from segway_ecc.hil.processes import ProcessFailedError

UP = State("ARMED", "BALANCING", "asked to arm")
DOWN = State("FAULT", "FALLEN", "it broke")
RESTS = State("DISARMED", "RESTING", "")
GOES_ON = Torque(1.0, None, 0.01)
ENDED = Torque(0.02, 0.025, 0.0)
LIMIT_S = 0.05


class FakeRig:
    """A robot that comes to what it is told."""

    def __init__(self, arrangement: Arrangement) -> None:
        self.arrangement = arrangement
        self._written = ["from before"]
        self.state, self.last = UP, GOES_ON
        self.exit_code: int | None = None

    @property
    def lines(self) -> list[str]:
        return list(self._written)

    def torque(self, _since_ns: int) -> Torque:
        return self.last

    def becomes(self, state: State, line: str, torque: Torque, code: int | None = None) -> None:
        self.state, self.exit_code, self.last = state, code, torque
        self._written.append(line)


class FakeStarter:
    def __init__(self) -> None:
        self.started: list[FakeRig] = []
        self.running: list[FakeRig] = []

    @contextlib.contextmanager
    def __call__(self, arrangement: Arrangement) -> Iterator[Any]:
        rig = FakeRig(arrangement)
        self.started.append(rig)
        self.running.append(rig)
        yield rig
        self.running.remove(rig)


@pytest.fixture
def _in_a_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "_SETTLES_WITHIN_S", 0.0)


hurried = pytest.mark.usefixtures("_in_a_hurry")


def made(declared: Declared, do: Callable[[Any], object], **changes: Any) -> InputTrial:
    def give(rig: Any, _undo: ExitStack) -> Event:
        found = do(rig)
        return found if isinstance(found, Event) else Event(0)

    return InputTrial(1, "an input", give, declared, **{"look_s": 0.0, **changes})


def results(*trials: InputTrial) -> list[InputResult]:
    return list(run_all(trials, FakeStarter()))


def only(declared: Declared, do: Callable[[Any], object]) -> InputResult:
    (found,) = results(made(declared, do))
    return found


def well(rig: FakeRig) -> None:
    rig.becomes(UP, "b", GOES_ON)


def badly(rig: FakeRig) -> None:
    rig.becomes(DOWN, "b", ENDED)


@hurried
def test_an_outcome_as_declared() -> None:
    found = only(falls("it broke"), lambda rig: rig.becomes(DOWN, "FAULT, FALLEN: it broke", ENDED))

    text = "FAULT, FALLEN"
    assert found == InputResult(1, "an input", text, text, "FAULT, FALLEN: it broke", ENDED, LIMIT_S)
    assert found.is_as_declared


@hurried
@pytest.mark.parametrize(
    ("declared", "becomes", "wrong"),
    [
        (falls("b"), (UP, "b", ENDED), ("mode ARMED (asked to arm), not FAULT", "posture BALANCING, not FALLEN")),
        (falls("other"), (DOWN, "b", ENDED), ("no reason like 'other'",)),
        (falls("before"), (DOWN, "b", ENDED), ("no reason like 'before'",)),
        (falls("b"), (DOWN, "b", Torque(0.051, 0.06, 0.0)), ("torque for 51.0 ms, not 50 ms at the most",)),
        (falls("b"), (DOWN, "b", GOES_ON), ("torque goes on",)),
        (balances("b"), (UP, "b", ENDED), ("torque ended after 20.0 ms",)),
        (balances("b"), (UP, "b", Torque(1.0, None, 0.11)), ("no torque for 110.0 ms",)),
        (balances("b", 4), (UP, "b", GOES_ON), ("exit code none, not 4",)),
        (ends("b", 3), (UP, "b", ENDED, 139), ("exit code 139, not 3",)),
        (ends("b", 3), (UP, "b", ENDED), ("mode ARMED (asked to arm), not none", "exit code none, not 3")),
        (balances("b"), (UP, "b", GOES_ON, 0), ("mode none (run has ended), not ARMED",)),
        (trial.sits_down("b"), (UP, "b", ENDED, 0), ("torque for 20.0 ms, not 300 ms at the least",)),
        (trial.rests("b"), (RESTS, "b", ENDED), ("torque for 20.0 ms, not 0 ms at the most",)),
    ],
)
def test_whatever_is_otherwise_is_named(declared: Declared, becomes: Any, wrong: tuple[str, ...]) -> None:
    found = only(declared, lambda rig: rig.becomes(*becomes))

    assert not found.is_as_declared
    assert set(wrong) <= set(found.wrong)


@hurried
def test_a_refusal_counts_by_its_answer_and_its_exit_code() -> None:
    found = only(balances("refused: no", 4), lambda _rig: Event(0, ["refused: no"], 4))

    assert (found.is_as_declared, found.outcome) == (True, "ARMED, BALANCING; exit 4")


@hurried
def test_what_an_input_itself_finds_wrong_counts() -> None:
    assert only(balances("b"), lambda _rig: Event(0, ["b"], wrong=["too late"])).wrong == ("too late",)


@hurried
def test_an_input_that_cannot_be_given_has_failed() -> None:
    def fail(_rig: Any) -> None:
        raise ProcessFailedError("there is no guard")

    found, after = results(made(balances("b"), fail), made(balances("b"), well))

    assert found.wrong == ("failed: there is no guard",)
    assert after.is_as_declared


def test_what_is_lacking_here_is_not_run_and_not_as_declared() -> None:
    (found,) = results(made(balances("b"), well, needs=lambda: "no ROS"))

    assert (found.not_run, found.is_as_declared, found.wrong) == ("no ROS", False, ())


def given(*trials: InputTrial) -> tuple[list[bool], int]:
    """Whether each was as declared, and how many robots were started."""
    start = FakeStarter()
    found = [result.is_as_declared for result in run_all(trials, start)]
    assert start.running == []
    return found, len(start.started)


@hurried
def test_a_robot_that_goes_on_as_declared_is_there_for_the_next_input() -> None:
    on = made(balances("b"), well)
    assert given(on, on) == ([True, True], 1)
    assert given(on, made(balances("b"), well, arrangement=Arrangement(ros=True))) == ([True, True], 2)
    assert given(made(falls("b"), badly), on) == ([True, True], 2)
    assert given(made(balances("b"), badly), on) == ([False, True], 2)


@hurried
def test_an_input_that_follows_has_the_robot_as_the_one_before_left_it() -> None:
    after = made(balances("b"), well, follows=True)
    assert given(made(falls("b"), badly), after) == ([True, True], 1)
    assert given(made(balances("b"), badly), after) == ([False, False], 1)


class FailingStarter(FakeStarter):
    """Of which the first robots do not come to balance."""

    def __init__(self, failures: int) -> None:
        super().__init__()
        self.failures = failures

    @contextlib.contextmanager
    def __call__(self, arrangement: Arrangement) -> Iterator[Any]:
        self.failures -= 1
        if self.failures >= 0:
            raise ProcessFailedError("the machine stalled")
        with super().__call__(arrangement) as rig:
            yield rig


@hurried
@pytest.mark.parametrize(("failures", "is_as_declared"), [(2, True), (3, False)])
def test_a_robot_that_falls_before_it_is_given_anything_is_replaced_and_reported(
    capsys: pytest.CaptureFixture[str], failures: int, *, is_as_declared: bool
) -> None:
    (found,) = run_all([made(balances("b"), well)], FailingStarter(failures))

    assert found.is_as_declared is is_as_declared
    line = "segway-ecc: 1: an input: starting another robot: the machine stalled"
    assert capsys.readouterr().err.splitlines() == [line] * 2


@hurried
def test_what_was_begun_for_an_input_lasts_until_its_outcome_was_looked_at() -> None:
    ended = list[bool]()

    def give(rig: Any, undo: ExitStack) -> Event:
        undo.callback(lambda: ended.append(rig.state is DOWN))
        badly(rig)
        return Event(0)

    assert results(InputTrial(1, "an input", give, falls("b"), look_s=0.0))[0].is_as_declared
    assert ended == [True]


def test_every_item_has_inputs_with_names_of_their_own_and_patterns_that_can_be_read() -> None:
    trials = all_trials()
    assert {each.item for each in trials} == set(ITEMS)
    assert [each.item for each in trials] == sorted(each.item for each in trials)
    names = [each.name for each in trials if not each.follows]
    assert len(set(names)) == len(names)
    assert all(re.compile(each.declared.reason) for each in trials)
    follows = [(before, each) for before, each in itertools.pairwise(trials) if each.follows]
    assert all(before.arrangement == each.arrangement for before, each in follows)


@pytest.mark.real_time
def test_a_model_that_raises_on_a_real_robot_ends_as_declared(tmp_path: Path) -> None:
    """Not in which time: the machine may be busy."""
    (raises,) = [each for each in misbehaving_models.trials() if each.name == "a model raises"]
    assert raises.arrangement == Arrangement(model=Misbehaviour(once="1 / 0"), drives=True)
    (found,) = run_all([raises], Starter(Place("segway", tmp_path, f"inputs {tmp_path}")))

    assert [text for text in found.wrong if "at the most" not in text] == []
    assert (found.outcome, found.torque is not None) == ("exit 3", True)
