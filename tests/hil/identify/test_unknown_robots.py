# SPDX-License-Identifier: MIT
"""Unknown robots on a floor with friction: found from one run that a hand begins, and designed anew.

Each is the published robot with its sizes, inertias, frictions and motor up to 30 % off; its file does not know. It is
held upright until it balances, let go, driven and turned for six seconds. `pytest -m proof -s` prints the tables of
docs/identification.md. Ten more robots, on which nothing was set, have a motor's resistance that is not as in the file.
"""

import random
from collections.abc import Mapping
from statistics import median
from typing import Final

import pytest
from msgspec import structs

from segway_ecc.hil.design.balance import Balance
from segway_ecc.hil.design.robot_text import rounded, with_parameters
from segway_ecc.hil.identify.identify import Identified, identify
from segway_ecc.hil.identify.robot_text import with_ranges, with_safety
from segway_ecc.hil.identify.windows import Run, run_of
from segway_ecc.hil.verbs.design_gains import designed, segway_parameters
from segway_ecc.hil.verbs.design_identify import is_by_voltage, rewritten
from segway_ecc.node.config import RobotFile, decode_robot, load_robot, read_text
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.models.segway_parameters import PUBLISHED, model_name
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.safety.posture import Posture

pytestmark = [pytest.mark.mujoco, pytest.mark.proof]

PLANTS: Final = {"segway": "SegwayContactPlant", "segway-odrive": "SegwayContactTorquePlant"}
OFF: Final = (
    "body_mass",
    "body_height_of_centre",
    "body_pitch_inertia",
    "body_yaw_inertia",
    "wheel_radius",
    "wheel_inertia",
    "track",
    "viscous_friction",
    "coulomb_friction",
    "imu_height",
)
SHARE: Final = 0.3
WITHIN: Final = 0.1
LAST_WITH_RESISTANCE_OF_FILE: Final = 10
RESISTANCE_DEVIATION: Final = 0.05
HELD_SHARE: Final = 0.9
"""Of true values that intervals of 95 % hold, at the least: those of one robot are not independent."""
SIDES: Final = {"front": 0.5, "rear": -0.5}


def unknown(robot: str, seed: int) -> dict[str, float]:
    """The plant's parameters of an unknown robot, each off by up to 30 %."""
    rng = random.Random(seed)  # noqa: S311 - robots that can be had again, no secret
    names = (*OFF, "motor_constant") if robot == "segway" else OFF
    plant = {model_name(name): getattr(PUBLISHED, name) * rng.uniform(1.0 - SHARE, 1.0 + SHARE) for name in names}
    if robot == "segway" and seed > LAST_WITH_RESISTANCE_OF_FILE:
        plant["MotorResistance"] = PUBLISHED.motor_resistance * rng.gauss(1.0, RESISTANCE_DEVIATION)
    # No moment of inertia is larger than the sum of the others; the published ones are near that.
    plant["BodyRollInertia"] = 0.95 * (plant["BodyPitchInertia"] + plant["BodyYawInertia"])
    return plant


def on_floor(file: RobotFile) -> RobotFile:
    """The robot with the plant whose wheels slip."""
    assert file.simulation is not None
    plant = f"segway_ecc.hil.plants.segway_contact:{PLANTS[file.name]}"
    return structs.replace(file, simulation=structs.replace(file.simulation, plant=plant))


def held_at_first(file: RobotFile, plant: Mapping[str, float], seed: int) -> Run:
    """A run that a hand begins."""
    balance = Balance(on_floor(file), pitch=0.0, seed=seed, plant={**plant, "Lift": 1e-6})
    records: list[CycleRecord] = []
    script = {
        0.9: lambda b: b.plant.write("Lift", 0.0),
        2.5: lambda b: b.drive(0.4, 0.0),
        3.5: lambda b: b.drive(-0.4, 0.0),
        4.5: lambda b: b.drive(0.0, 1.5),
        5.5: lambda b: b.drive(0.0, -1.5),
        6.5: lambda b: b.drive(0.4, 1.0),
        7.5: lambda b: b.drive(0.0, 0.0),
    }
    balance.run(8.5, script, keep=records.append)
    return run_of(records, layout_of(balance.robot), skip_s=1.0)


def stands_up(file: RobotFile, plant: Mapping[str, float], pitch: float, seed: int) -> bool:
    """Whether it stands up from a bumper, and still stands."""
    balance = Balance(on_floor(file), pitch=pitch, seed=seed, plant=plant)
    balance.run(5.0)
    print(" ", round(pitch, 1), balance.loop.modes.reason)  # noqa: T201 - the tables
    return balance.postures[-1] is Posture.BALANCING


def _identified(robot: str, seed: int) -> Identified:
    """What is found of an unknown robot."""
    file = load_robot(robot)
    run = held_at_first(file, unknown(robot, seed), seed)
    return identify([run], segway_parameters(file), voltage=is_by_voltage(file))


def found_of(robot: str, seed: int) -> tuple[Identified, RobotFile]:
    """What is found of an unknown robot, and its file with that."""
    file, found = load_robot(robot), _identified(robot, seed)
    text, _notes = rewritten(read_text(robot), file, found)
    return found, decode_robot(text, "the robot file")


def _designed_for(robot: str, true: Mapping[str, float]) -> RobotFile:
    """The file of a robot that is known exactly."""
    file = load_robot(robot)
    text = with_parameters(read_text(robot), "simulation", true)
    text = with_safety(text, segway_parameters(decode_robot(text, "the robot file")))
    names = {"WheelRadius", "Track", "ImuHeight", "MotorConstant"} & true.keys()
    grip = (true["BodyMass"] + 0.3652) * true["WheelRadius"] / ((PUBLISHED.body_mass + 0.3652) * PUBLISHED.wheel_radius)
    follows = {**{name: true[name] for name in names}, "TorqueLimit": 1.3 * min(1.0, grip)}
    text, _moved = with_ranges(text, file, follows)
    known = decode_robot(text, "the robot file")
    gains = rounded(designed(known).gains)
    return decode_robot(with_parameters(text, "model", {**file.model.parameters, **follows, **gains}), "the robot file")


@pytest.mark.parametrize("robot", PLANTS)
def test_intervals_hold_the_true_values_of_ten_more_robots(robot: str) -> None:
    held: dict[str, list[bool]] = {}
    errors: dict[str, list[float]] = {}
    for seed in range(11, 21):
        true = unknown(robot, seed)
        for e in (e for e in _identified(robot, seed).estimates if e.name in true):
            held.setdefault(e.name, []).append(e.least <= true[e.name] <= e.most)
            errors.setdefault(e.name, []).append(abs(e.value / true[e.name] - 1.0))
    print(f"\n{robot} 11 to 20: median, largest error, how many intervals hold the true value")  # noqa: T201 - the tables
    for name, found in errors.items():
        print(f"{name:20s} {100 * median(found):6.1f} % {100 * max(found):6.1f} % {sum(held[name])}")  # noqa: T201 - the tables
    flags = [flag for each in held.values() for flag in each]
    assert sum(flags) >= HELD_SHARE * len(flags)


@pytest.mark.parametrize("robot", PLANTS)
@pytest.mark.parametrize("seed", range(1, 11))
def test_an_unknown_robot_is_found_and_stands_up(robot: str, seed: int) -> None:
    true = unknown(robot, seed)
    found, redesigned = found_of(robot, seed)
    before = {side: stands_up(load_robot(robot), true, pitch, seed) for side, pitch in SIDES.items()}
    after = {side: stands_up(redesigned, true, pitch, seed) for side, pitch in SIDES.items()}
    print(f"\n{robot} {seed}: stands up before {before}, after {after}; {found.fit.windows} windows, {found.remarks}")  # noqa: T201 - the tables
    for e in found.estimates:
        if e.name in true:
            value, error = true[e.name], e.value / true[e.name] - 1.0
            holds = "holds" if e.least <= value <= e.most else "MISSES"
            print(f"{e.name:20s} {value:9.4g} {e.value:9.4g} +-{e.interval_text:>8s} {100 * error:6.1f} % {holds}")  # noqa: T201 - the tables
    for e in found.estimates:
        if e.name in true:
            off = abs(e.value - true[e.name]) / true[e.name]
            assert off < WITHIN or e.most - e.least > 2.0 * WITHIN * e.value, e.name
    possible = {side: stands_up(_designed_for(robot, true), true, pitch, seed) for side, pitch in SIDES.items()}
    print("with the gains for the true robot:", possible)  # noqa: T201 - the tables
    assert after["front"] >= before["front"]
    assert after["rear"] >= before["rear"]
