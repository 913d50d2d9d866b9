# SPDX-License-Identifier: MIT
"""The packaged segways on a floor with friction: trials with all of safety and sensor errors, by the plant's truth.

The trials and which robots do not withstand them stand in `segway_ecc.hil.floor.trials`.
"""

from collections.abc import Callable, Mapping
from typing import Final

import pytest

from segway_ecc.hil.design.balance import Balance
from segway_ecc.hil.floor.contact import on_floor, tyres
from segway_ecc.hil.floor.run import Ending, FloorRun, run_floor_trial
from segway_ecc.hil.floor.trials import FALLS, UP_S, FloorTrial, all_trials, listed_trials
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.posture import Posture

pytestmark = pytest.mark.mujoco

ROBOTS: Final = ("segway", "segway-odrive")
TRIALS: Final = listed_trials(PUBLISHED)
BUMPS: Final = (
    "board of 3 mm, both wheels, 0.4 m/s",
    "board of 1 cm, left wheel, 0.4 m/s",
    "board of 2 cm, both wheels, 0.6 m/s",
    "drop of 2 cm, 0.2 m/s",
)
QUICK: Final = ("friction 0.6, front bumper", "friction 0.5, rear bumper", "50 N ahead for 0.1 s, friction 0.6")
LIFTED: Final = "both wheels have lost the floor: the robot is lifted"


def _end_as_listed(trial: FloorTrial, robot: str) -> None:
    result = run_floor_trial(FloorRun(robot, trial, 1))
    falls = robot in FALLS.get(trial.name, frozenset())
    assert result.ending is (Ending.SAFE if falls else Ending.STANDS), result.reason
    assert falls or result.way_m < 2.0 + trial.speed * trial.duration_s


@pytest.mark.variants(3)
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("trial", [t for t in TRIALS if t.name in QUICK], ids=lambda t: t.name)
def test_on_a_floor_it_stays_up_or_ends_without_torque(trial: FloorTrial, robot: str) -> None:
    _end_as_listed(trial, robot)


@pytest.mark.variants(3)
@pytest.mark.parametrize(
    ("speed", "turning", "seed", "friction"),
    [
        (0.0, 0.0, 3, 0.8),
        (0.0, 0.0, 4, 1.2),
        (0.0, 1.0, 5, 0.8),
        (0.0, 0.0, 4, 0.8),
        (0.0, 0.0, 1, 0.8),
        (0.0, 1.0, 1, 0.8),
        (0.5, 0.0, 1, 0.8),
        (-0.5, 0.0, 1, 0.8),
    ],
)
@pytest.mark.parametrize("robot", ROBOTS)
def test_lifted_by_hand_its_wheels_stop_within_300_ms_and_set_down_it_stands_up_again(
    robot: str, speed: float, turning: float, seed: int, friction: float
) -> None:
    balance = Balance(on_floor(load_robot(robot)), pitch=PUBLISHED.stop_angle, seed=seed, plant=tyres(friction))
    speeds: dict[float, float] = {}

    def look(at: float) -> Callable[[Balance], None]:
        return lambda b: speeds.update({at: max(abs(b.plant.read(f"{side}.velocity")) for side in ("left", "right"))})

    lift_s = UP_S + 1.0
    lifted = [lift_s + 0.005 * i for i in range(1, 400)]
    script: Mapping[float, Callable[[Balance], None]] = {
        UP_S: lambda b: b.drive(speed, turning),
        lift_s: lambda b: b.plant.write("Lift", 0.3),
        **{at: look(at) for at in lifted},
        6.9: lambda b: b.drive(0.0, 0.0),
        7.0: lambda b: b.plant.write("Lift", 0.0),
        10.0: lambda b: b.ask(Action.STAND_UP),
    }
    balance.run(13.0, script)
    first, last = (round(at / balance.robot.period_ns * 1e9) for at in (lift_s + 0.3, 10.0))
    assert all(mode is Mode.FAULT for mode in balance.modes[first:last])
    assert not any(any(command) for command in balance.commands[first:last])
    assert max(turns for at, turns in speeds.items() if at > lift_s + 0.3) < 1.0, "rad/s: both have stopped"
    fault = next(entered for entered in balance.loop.modes.history if entered.mode is Mode.FAULT)
    assert fault.reason == LIFTED
    assert [answer.accepted for answer in balance.answers] == [True]
    assert (balance.modes[-1], balance.postures[-1]) == (Mode.ARMED, Posture.BALANCING)


@pytest.mark.variants(3)
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("trial", [t for t in all_trials(PUBLISHED) if t.name in BUMPS], ids=lambda t: t.name)
def test_what_no_hand_lifted_is_not_told_to_be_lifted(trial: FloorTrial, robot: str) -> None:
    balance = Balance(on_floor(load_robot(robot)), pitch=trial.pitch, plant=trial.plant)
    balance.run(trial.duration_s, {UP_S: lambda b: b.drive(trial.speed, 0.0)})
    assert Phase.LIFTED not in balance.phases
    assert LIFTED not in [entered.reason for entered in balance.loop.modes.history]


@pytest.mark.proof
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("trial", TRIALS, ids=lambda t: t.name)
def test_each_trial_on_a_floor_ends_as_the_documentation_has_it(trial: FloorTrial, robot: str) -> None:
    _end_as_listed(trial, robot)
