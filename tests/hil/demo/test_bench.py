# SPDX-License-Identifier: MIT
"""Trials beside the station's own commands: one at a time, each answered; and the way back."""

import threading
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import pytest

from segway_ecc.deploy.station.views import Act, Command, RobotView
from segway_ecc.hil.demo.bench import TestBench
from segway_ecc.testing import ScriptedClock
from tests.deploy.station.web.scripted_station import ScriptedStation
from tests.hil.demo.fake_parts import FakeParts
from tests.patience import PATIENCE_S

UP = RobotView(
    robot="/", is_alive=True, mode="ARMED", posture="BALANCING", reason="asked to arm", can_stand=True, pitch=0.0
)
FALLEN = msgspec.structs.replace(UP, mode="FAULT", posture="FALLEN", reason="the bus was cut")
STATES = ("PushForce",)


class Answer:
    """Waits for a reply."""

    def __init__(self) -> None:
        self.found: tuple[bool, str] | None = None
        self._is_there = threading.Event()

    def __call__(self, accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
        self.found = (accepted, text)
        self._is_there.set()

    def wait(self) -> tuple[bool, str]:
        assert self._is_there.wait(PATIENCE_S)
        assert self.found is not None
        return self.found


class Bench(NamedTuple):
    bench: TestBench
    station: ScriptedStation
    parts: FakeParts

    def ask(self, name: str, act: Act = Act.TRY) -> Answer:
        answer = Answer()
        self.bench.submit("ann", Command(id=1, robot="/", act=act, name=name), answer)
        return answer

    def shows(self, *robots: RobotView) -> None:
        """The picture from now on; of several, the next after each command."""
        self.station.robots = robots[:1]
        self.station.tick()


class Obedient(ScriptedStation):
    """A robot that does what it is asked, one step a command."""

    def __init__(self, *steps: RobotView) -> None:
        super().__init__(steps[:1])
        self._steps = steps

    def submit(self, who: str, command: Command, reply: "Answer") -> None:  # type: ignore[override]
        super().submit(who, command, reply)
        if self.answer[0]:
            self._steps = self._steps[1:] or self._steps
        self.robots = self._steps[:1]
        self.tick()


def bench_of(station: ScriptedStation) -> Bench:
    parts = FakeParts(ScriptedClock())
    return Bench(TestBench(station, parts, STATES, ("left.angle",), parts.clock), station, parts)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = bench_of(ScriptedStation([UP]))
    yield made
    made.bench.close()


def test_the_page_is_told_what_can_be_done(bench: Bench) -> None:
    names = [trial.name for trial in bench.bench.trials]
    assert {"push", "cut", "kill-node"} < set(names)
    assert "slope" not in names
    assert names[-1] == "recover"


def test_other_commands_are_the_stations(bench: Bench) -> None:
    assert bench.ask("", Act.ARM).wait() == (True, "done")
    assert [(who, command.act) for who, command in bench.station.commands] == [("ann", Act.ARM)]


def test_a_trial_is_done_and_told_about(bench: Bench) -> None:
    assert bench.ask("cut").wait() == (True, "it drives on, and leaned by 0.0° at most")
    assert bench.parts.lines == ["cut"]
    assert bench.station.commands == []


def test_a_name_that_is_none_is_refused(bench: Bench) -> None:
    assert bench.ask("no such").wait() == (False, "there is no trial 'no such'")


def test_one_at_a_time(bench: Bench) -> None:
    may_go_on, is_on = threading.Event(), threading.Event()

    def driven() -> int:
        is_on.set()
        assert may_go_on.wait(PATIENCE_S)
        return bench.parts.clock.now_ns()

    bench.parts.driven = driven
    first = bench.ask("cut")
    assert is_on.wait(PATIENCE_S)
    assert bench.ask("push").wait() == (False, "the robot is still being watched after the last one")
    may_go_on.set()
    assert first.wait()[0]
    assert bench.ask("push").wait()[0]


def test_a_plant_that_refuses_is_told_about(bench: Bench) -> None:
    bench.parts.refuses = "cut"
    assert bench.ask("cut").wait() == (False, "the plant: refused: cut")


def test_what_fails_is_answered_too(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    def driven() -> int:
        raise ZeroDivisionError("oh")

    bench.parts.driven = driven
    accepted, text = bench.ask("cut").wait()
    assert (accepted, text.startswith("ZeroDivisionError: oh")) == (False, True)
    assert "the station goes on" in caplog.text
    assert bench.ask("no such").wait()[0] is False


def test_it_is_brought_back_step_by_step() -> None:
    made = bench_of(Obedient(FALLEN, msgspec.structs.replace(FALLEN, mode="DISARMED"), UP))
    found = made.ask("recover").wait()
    made.bench.close()
    assert [command.act for _, command in made.station.commands] == [Act.CLEAR_FAULT, Act.STAND]
    assert found == (True, "it is back after 0.2 s: ARMED BALANCING: asked to arm")
    assert made.parts.lines[0] == "heal"
    assert made.parts.revivals == 1


def test_a_robot_that_cannot_stand_is_armed() -> None:
    cart = msgspec.structs.replace(UP, posture="", can_stand=False)
    made = bench_of(Obedient(msgspec.structs.replace(cart, mode="DISARMED"), cart))
    assert made.ask("recover").wait()[0]
    made.bench.close()
    assert [command.act for _, command in made.station.commands] == [Act.ARM]


def test_one_that_refuses_is_given_up_with_its_reason() -> None:
    made = bench_of(Obedient(FALLEN))
    made.station.answer = (False, "it still moves")
    assert made.ask("recover").wait() == (False, "it did not come back within 20 s: it still moves")
    made.bench.close()


def test_one_that_is_not_seen_is_given_up() -> None:
    made = bench_of(ScriptedStation())
    assert made.ask("recover").wait() == (False, "it did not come back within 20 s: no robot is seen")
    made.bench.close()
