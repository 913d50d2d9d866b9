# SPDX-License-Identifier: MIT
"""The packaged segways on a floor with friction: trials with all of safety and sensor errors, by the plant's truth.

A trial that a robot does not withstand is in the table too: it must end without torque and with a reason.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import pytest
from msgspec import structs

from segway_ecc.hil.design.balance import Balance
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.posture import Posture

pytestmark = pytest.mark.mujoco

STOP = PUBLISHED.stop_angle
PLANTS: Final = {"segway": "SegwayContactPlant", "segway-odrive": "SegwayContactTorquePlant"}
BOTH: Final = frozenset(PLANTS)
ODRIVE: Final = frozenset({"segway-odrive"})
NONE: Final[frozenset[str]] = frozenset()
NOTHING: Final[Mapping[str, float]] = MappingProxyType({})
UP_S: Final = 3.5
"""When it stands, and trials begin, s."""

Script = Mapping[float, Callable[[Balance], None]]
LEFT_ALONE: Final[Script] = MappingProxyType({})


class Trial(NamedTuple):
    """What is done to a robot that stands up from a bumper, and which robots do not withstand it."""

    name: str
    plant: Mapping[str, float] = NOTHING
    script: Script = LEFT_ALONE
    duration: float = 8.0
    pitch: float = STOP
    fall: frozenset[str] = NONE


def on_floor(robot: str) -> RobotFile:
    """A packaged robot with the plant whose wheels slip."""
    file = load_robot(robot)
    plant = f"segway_ecc.hil.plants.segway_contact:{PLANTS[robot]}"
    assert file.simulation is not None
    return structs.replace(file, simulation=structs.replace(file.simulation, plant=plant))


def _tyres(friction: float) -> dict[str, float]:
    return {"LeftFriction": friction, "RightFriction": friction}


def _push(force: float, seconds: float) -> Script:
    return {
        UP_S: lambda b: b.plant.write("PushForce", force),
        UP_S + seconds: lambda b: b.plant.write("PushForce", 0.0),
    }


def _standing_up() -> Iterator[Trial]:
    for pitch, side in ((STOP, "front"), (-STOP, "rear")):
        for friction in (0.5, 0.6, 0.8, 1.2):
            fall = NONE if friction > 0.5 else ODRIVE if pitch > 0.0 else BOTH
            yield Trial(f"friction {friction}, {side} bumper", _tyres(friction), pitch=pitch, fall=fall)
    for pitch, side in ((STOP, "front"), (-STOP, "rear")):
        for degrees in (-5.0, 5.0):
            slope = math.radians(degrees)  # the stop is against the ground's normal, which leans back where it rises
            yield Trial(f"slope {degrees:g} degrees, {side} bumper", {"Slope": slope}, pitch=pitch - slope)


def _unlike() -> Iterator[Trial]:
    for name, published in (
        ("BodyMass", PUBLISHED.body_mass),
        ("BodyHeightOfCentre", PUBLISHED.body_height_of_centre),
        ("WheelRadius", PUBLISHED.wheel_radius),
    ):
        for factor in (0.7, 1.3):
            fall = BOTH if (name, factor) == ("WheelRadius", 0.7) else NONE
            yield Trial(f"{name} times {factor}", {name: factor * published}, fall=fall)
    yield Trial("sensor errors times 3", {"SensorErrors": 3.0})
    yield Trial("cogging 0.02 N m", {"Cogging": 0.02})
    yield Trial("backlash 0.5 degrees", {"Backlash": math.radians(0.5)})


def _pushed() -> Iterator[Trial]:
    for side, sign in (("ahead", 1.0), ("back", -1.0)):
        yield Trial(f"50 N {side} for 0.1 s, friction 0.6", _tyres(0.6), _push(50.0 * sign, 0.1))
        yield Trial(f"10 N {side} for 1 s, friction 0.6", _tyres(0.6), _push(10.0 * sign, 1.0))
        yield Trial(f"10 N {side} for 1 s, friction 0.8", script=_push(10.0 * sign, 1.0))


def _driven(name: str, speed: float, fall: frozenset[str] = NONE, **ground: float) -> Trial:
    """It gets up from its rear bumper, backwards, and drives ahead over what lies there."""
    script: Script = {UP_S: lambda b: b.drive(speed, 0.0)}
    return Trial(f"{name}, {speed} m/s", ground, script, UP_S + 1.8 / speed, -STOP, fall)


def _driving() -> Iterator[Trial]:
    for speed in (0.2, 0.4, 0.6):
        for side, wheels in ((0.0, "both wheels"), (1.0, "left wheel")):
            name = f"board of 1 cm, {wheels}"
            yield _driven(name, speed, BOTH, KerbAt=0.3, KerbHeight=0.01, KerbLength=0.2, KerbSide=side)
    for speed in (0.2, 0.6):
        yield _driven("ice of 0.2", speed, IceAt=0.2, IceLength=0.5, IceFriction=0.2)


TRIALS: Final = (*_standing_up(), *_unlike(), *_pushed(), *_driving())
QUICK: Final = ("friction 0.6, front bumper", "friction 0.5, rear bumper", "50 N ahead for 0.1 s, friction 0.6")


def _balance_through(trial: Trial, robot: str) -> None:
    balance = Balance(on_floor(robot), pitch=trial.pitch, plant=trial.plant)
    truth = balance.run(trial.duration, trial.script)
    reason = balance.loop.modes.reason
    if robot in trial.fall:
        assert balance.modes[-1] in {Mode.FAULT, Mode.DISARMED}, reason
        assert not any(balance.commands[-1])
    else:
        assert (balance.modes[-1], balance.postures[-1]) == (Mode.ARMED, Posture.BALANCING), reason
        assert abs(truth[-1].pitch) < 0.1
        assert abs(truth[-1].x) < 1.5


@pytest.mark.variants(3)
@pytest.mark.parametrize("robot", sorted(PLANTS))
@pytest.mark.parametrize("trial", [t for t in TRIALS if t.name in QUICK], ids=lambda t: t.name)
def test_on_a_floor_it_stays_up_or_ends_without_torque(trial: Trial, robot: str) -> None:
    _balance_through(trial, robot)


@pytest.mark.variants(1)
@pytest.mark.parametrize("robot", sorted(PLANTS))
def test_lifted_by_hand_its_wheels_stop_and_set_down_it_stands_up_again(robot: str) -> None:
    balance = Balance(on_floor(robot), pitch=STOP)
    speeds: dict[float, float] = {}

    def look(at: float) -> Callable[[Balance], None]:
        return lambda b: speeds.update({at: max(abs(b.plant.read(f"{side}.velocity")) for side in ("left", "right"))})

    lifted = [UP_S + 0.02 * i for i in range(1, 100)]
    script: Script = {
        UP_S: lambda b: b.plant.write("Lift", 0.3),
        **{at: look(at) for at in lifted},
        7.0: lambda b: b.plant.write("Lift", 0.0),
        9.0: lambda b: b.ask(Action.STAND_UP),
    }
    balance.run(12.0, script)
    first, last = (round(at / balance.robot.period_ns * 1e9) for at in (UP_S + 0.25, 9.0))
    assert all(mode is Mode.FAULT for mode in balance.modes[first:last])
    assert not any(any(command) for command in balance.commands[first:last])
    assert max(speeds.values()) < 80.0, "rad/s: 4 m/s"
    assert max(speed for at, speed in speeds.items() if at > UP_S + 1.0) < 1.0, "friction stops what runs down"
    assert [answer.accepted for answer in balance.answers] == [True]
    assert (balance.modes[-1], balance.postures[-1]) == (Mode.ARMED, Posture.BALANCING)


@pytest.mark.proof
@pytest.mark.parametrize("robot", sorted(PLANTS))
@pytest.mark.parametrize("trial", TRIALS, ids=lambda t: t.name)
def test_each_trial_on_a_floor_ends_as_the_documentation_has_it(trial: Trial, robot: str) -> None:
    _balance_through(trial, robot)
