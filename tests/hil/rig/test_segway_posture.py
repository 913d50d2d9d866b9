# SPDX-License-Identifier: MIT
"""The packaged segways fall, end and come back in lock step, with sensor errors on; zero torque is what leaves."""

import pytest
from msgspec import structs

from segway_ecc.hil.design.balance import Balance
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.modes import ACTIVE, Action, Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.safety.settings import PostureSettings

STOP = PUBLISHED.stop_angle
PERIOD = 0.005
UP = [Posture.RESTING, Posture.STANDING_UP, Posture.BALANCING]
ROBOTS = pytest.mark.parametrize("robot", ["segway", "segway-odrive", "segway-moteus", "segway-hoverboard"])


def story(balance: Balance) -> list[Posture | None]:
    """The postures, each once."""
    found = balance.postures
    return [each for i, each in enumerate(found) if i == 0 or each is not found[i - 1]]


def on_request(robot: str = "segway") -> RobotFile:
    return structs.replace(load_robot(robot), arming="on_request")


def shove(balance: Balance) -> None:
    balance.plant.write("PushForce", 16.0)


def let_go(balance: Balance) -> None:
    balance.plant.write("PushForce", 0.0)


SHOVED = {3.0: shove, 4.0: let_go}


@ROBOTS
def test_a_robot_that_is_knocked_over_has_fallen_without_torque_and_with_the_reason(robot: str) -> None:
    balance = Balance(load_robot(robot), pitch=STOP)
    balance.run(8.0, SHOVED)
    assert story(balance) == [*UP, Posture.FALLEN]
    assert balance.loop.modes.mode is Mode.FAULT
    assert balance.loop.modes.reason.startswith(("the robot has fallen: it leans ", "the robot runs away: "))
    at = balance.postures.index(Posture.FALLEN)
    assert at * PERIOD < 5.0
    assert set(map(tuple, balance.commands[at:])) == {(0.0, 0.0)}


@ROBOTS
def test_one_request_stands_a_fallen_robot_up_again(robot: str) -> None:
    balance = Balance(load_robot(robot), pitch=STOP)
    rests_s = 24.0 if robot == "segway-hoverboard" else 9.0  # that one coasts on its bumper
    balance.run(rests_s + 4.0, {**SHOVED, rests_s: lambda b: b.ask(Action.STAND_UP)})
    assert [answer.accepted for answer in balance.answers] == [True]
    assert story(balance) == [*UP, Posture.FALLEN, *UP]
    assert balance.loop.modes.mode is Mode.ARMED
    fallen = [i for i, each in enumerate(balance.postures) if each is Posture.FALLEN]
    assert not {balance.modes[i] for i in fallen} & ACTIVE, "no robot is FALLEN and armed, for a cycle either"
    assert {tuple(balance.commands[i]) for i in fallen} == {(0.0, 0.0)}


def test_a_fallen_robot_that_may_not_arm_stays_fallen_and_says_why() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    balance.run(8.0, {**SHOVED, 4.8: lambda b: b.ask(Action.STAND_UP)})
    (answer,) = balance.answers
    assert not answer.accepted
    assert "still: " in answer.message
    assert balance.loop.modes.mode is Mode.FAULT
    assert story(balance)[-1] is Posture.FALLEN


def test_the_value_that_stands_it_up_does_not_raise_a_fallen_robot() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    balance.run(9.0, {**SHOVED, 6.0: lambda b: b.stand(1.0), 7.0: lambda b: b.ask(Action.CLEAR_FAULT)})
    assert story(balance) == [*UP, Posture.FALLEN, Posture.RESTING]
    assert balance.loop.modes.mode is Mode.DISARMED


def test_after_a_stop_standing_up_is_refused_with_the_reason_and_works_once_the_fault_is_cleared() -> None:
    """It was "taken" and did nothing: the model had given up meanwhile, and took no second 1 for a request."""
    balance = Balance(load_robot("segway"), pitch=STOP)
    script = {
        3.0: lambda b: b.ask(Action.STOP),
        8.0: lambda b: b.ask(Action.STAND_UP),
        8.1: lambda b: b.ask(Action.CLEAR_FAULT),
        8.2: lambda b: b.ask(Action.STAND_UP),
    }
    balance.run(12.0, script)
    assert [(answer.accepted, answer.message) for answer in balance.answers] == [
        (True, "FAULT: stop was pressed"),
        (False, "clear the fault first: stop was pressed"),
        (True, "DISARMED: fault cleared"),
        (True, "ARMED: asked to arm"),
    ]
    assert story(balance) == [*UP, Posture.FALLEN, *UP]


def test_after_a_stop_the_robot_that_is_armed_rests_until_it_is_asked_to_stand() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    script = {
        3.0: lambda b: b.ask(Action.STOP),
        6.0: lambda b: b.ask(Action.CLEAR_FAULT),
        6.1: lambda b: b.ask(Action.ARM),
        8.0: lambda b: b.stand(1.0),
    }
    balance.run(11.0, script)
    assert story(balance) == [*UP, Posture.FALLEN, *UP]
    assert balance.postures.index(Posture.STANDING_UP, round(6.0 / PERIOD)) == pytest.approx(8.0 / PERIOD, abs=2)


def test_a_robot_that_is_disarmed_while_it_balances_falls_and_one_request_brings_it_back() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    balance.run(11.0, {3.0: lambda b: b.ask(Action.DISARM), 6.0: lambda b: b.ask(Action.STAND_UP)})
    assert story(balance) == [*UP, Posture.FALLEN, *UP]


def test_a_robot_that_waited_for_long_stands_up_when_it_is_armed() -> None:
    """The model tried while nothing reached the motors, gave up after 3.5 s, and lay there armed."""
    balance = Balance(on_request(), pitch=STOP)
    balance.run(12.0, {8.0: lambda b: b.ask(Action.ARM)})
    assert story(balance) == UP
    balance = Balance(on_request(), pitch=STOP)
    balance.run(12.0, {8.0: lambda b: b.ask(Action.STAND_UP)})
    assert story(balance) == UP


def test_a_first_sample_that_is_wrong_delays_standing_up_and_does_no_more() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    balance.model.biases["AccelerationX"] = -50.0  # leans 1.35 rad, as the accelerometer has it
    balance.run(6.0, {2 * PERIOD: lambda b: b.model.biases.clear()})
    assert story(balance) == UP
    assert Phase.GIVEN_UP not in balance.phases


def test_sitting_down_and_standing_up_on_request() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    balance.run(12.0, {3.0: lambda b: b.ask(Action.SIT_DOWN), 7.0: lambda b: b.ask(Action.STAND_UP)})
    assert story(balance) == [*UP, Posture.SITTING_DOWN, *UP]
    assert [answer.message for answer in balance.answers] == ["the robot sits down", "the robot stands up"]
    assert balance.loop.modes.mode is Mode.ARMED


def test_a_robot_that_sits_gives_no_torque_though_it_is_armed() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    balance.run(8.0, {3.0: lambda b: b.ask(Action.SIT_DOWN)})
    at = balance.postures.index(Posture.RESTING, round(3.0 / PERIOD))
    assert set(map(tuple, balance.commands[at:])) == {(0.0, 0.0)}
    assert balance.loop.modes.mode is Mode.ARMED


@ROBOTS
def test_a_robot_that_is_to_end_sits_down_first(robot: str) -> None:
    balance = Balance(load_robot(robot), pitch=STOP)
    truth = balance.run(20.0, {3.0: lambda b: b.loop.stop("SIGINT")}, sits_down_first=True)
    assert story(balance) == [*UP, Posture.SITTING_DOWN, Posture.RESTING]
    assert balance.loop.stop_reason == "SIGINT"
    assert truth[-1].time < 6.5
    assert max(at.pitch_rate for at in truth if at.time > 3.0) < 1.2  # falling freely it would be some 4.5 rad/s


def test_asked_twice_it_ends_at_once() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    script = {3.0: lambda b: b.loop.stop("SIGINT"), 3.2: lambda b: b.loop.stop("SIGINT")}
    truth = balance.run(20.0, script, sits_down_first=True)
    assert truth[-1].time == pytest.approx(3.2, abs=3 * PERIOD)


def test_a_robot_that_ends_does_not_stand_up_again() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    script = {
        3.0: lambda b: b.loop.stop("SIGTERM"),
        3.5: lambda b: b.ask(Action.STAND_UP),
        3.6: lambda b: b.stand(1.0),
    }
    balance.run(20.0, script, sits_down_first=True)
    assert story(balance) == [*UP, Posture.SITTING_DOWN, Posture.RESTING]
    (answer,) = balance.answers
    assert (answer.accepted, answer.message) == (False, "the robot ends: it sits down first")


def test_a_robot_that_ends_and_does_not_sit_down_in_time_ends_all_the_same() -> None:
    file = load_robot("segway")
    assert file.safety is not None
    posture = PostureSettings(down_rad=0.4, sit_down_s=0.2)
    balance = Balance(structs.replace(file, safety=structs.replace(file.safety, posture=posture)), pitch=STOP)
    truth = balance.run(20.0, {3.0: lambda b: b.loop.stop("SIGTERM")}, sits_down_first=True)
    assert truth[-1].time == pytest.approx(3.2, abs=4 * PERIOD)
    assert story(balance)[-1] is Posture.FALLEN
    assert balance.loop.modes.reason == "the robot did not sit down within 0.2 s"
    assert set(balance.commands[-1]) == {0.0}


def test_a_robot_that_rests_ends_at_once() -> None:
    balance = Balance(on_request(), pitch=STOP)
    truth = balance.run(20.0, {3.0: lambda b: b.loop.stop("SIGINT")}, sits_down_first=True)
    assert truth[-1].time == pytest.approx(3.0, abs=3 * PERIOD)
