# SPDX-License-Identifier: MIT
"""What an operator asks of a robot that balances, by its mode."""

import pytest

from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.interfaces import Request
from segway_ecc.node.cycle.posture import PostureControl
from segway_ecc.node.cycle.setpoints import SetpointSchedule
from segway_ecc.node.safety.modes import STATION_LOST, Action, Answer, Mode
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.settings import NOTHING_WATCHED, PostureSettings
from segway_ecc.testing import RecordingHardware

PERIOD_S = 0.01


class Robot:
    """Armed, and sat down."""

    def __init__(self) -> None:
        hardware = RecordingHardware({}, {}, ())
        schedule = SetpointSchedule(timeout_cycles=50, tolerance_cycles=10, horizon_cycles=100)
        self.arming = ArmingManager(hardware, schedule, arm_at_start=False)
        monitor = SafetyMonitor(NOTHING_WATCHED, (), (), round(PERIOD_S * 1e9))
        self.posture = PostureControl(PostureSettings(down_rad=0.6), ["stand"], monitor, self.arming, PERIOD_S)
        self.values = [0.0]
        self.arming.arm_again(lambda _answer: None)
        self.pass_cycle()

    def pass_cycle(self, *, station_lost: bool = False) -> Mode:
        self.arming.observe((), ready=True, setpoints_silent=False, station_lost=station_lost)
        return self.arming.modes.mode

    def stand_up(self) -> Answer:
        answers: list[Answer] = []
        self.posture.act(Request(Action.STAND_UP, answers.append), self.values)
        (answer,) = answers
        return answer


@pytest.fixture
def robot() -> Robot:
    return Robot()


def test_a_robot_whose_station_is_lost_refuses_to_stand_up(robot: Robot) -> None:
    assert robot.pass_cycle(station_lost=True) is Mode.HOLD
    answer = robot.stand_up()
    assert not answer.accepted
    assert answer.message == f"{STATION_LOST}: the robot does not stand up before one is back"
    assert robot.values == [0.0]


def test_it_stands_up_once_a_station_is_back(robot: Robot) -> None:
    robot.pass_cycle(station_lost=True)
    assert robot.pass_cycle() is Mode.ARMED
    assert robot.stand_up() == Answer(accepted=True, message="the robot stands up")
    assert robot.values == [1.0]


def test_a_robot_that_holds_for_want_of_set_points_stands_up(robot: Robot) -> None:
    robot.arming.observe((), ready=True, setpoints_silent=True)
    assert robot.arming.modes.mode is Mode.HOLD
    assert robot.stand_up().accepted
