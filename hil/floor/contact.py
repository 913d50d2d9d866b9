# SPDX-License-Identifier: MIT
"""A robot file with the plant whose wheels slip in place of the one whose wheels do not."""

import importlib.util
from collections.abc import Mapping
from typing import Final

from msgspec import structs

from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.node.config import RobotFile

_SLIPPING: Final = {
    "segway_ecc.hil.plants.segway:SegwayPlant": "segway_ecc.hil.plants.segway_contact:SegwayContactPlant",
    "segway_ecc.hil.plants.segway:SegwayTorquePlant": "segway_ecc.hil.plants.segway_contact:SegwayContactTorquePlant",
}
"""By the plant that rolls without slipping, the same robot on a floor with friction."""
LEAST_FRICTION: Final = 0.01
MOST_FRICTION: Final = 5.0
"""What the plants take."""


def lacks_mujoco() -> str:
    """What to install where the plants with friction cannot run; empty where they can."""
    return "" if importlib.util.find_spec("mujoco") else "pip install 'segway-ecc[contact]'"


def has_contact(file: RobotFile) -> bool:
    """Whether there is a plant with friction for this robot."""
    return file.simulation is not None and file.simulation.plant in {*_SLIPPING, *_SLIPPING.values()}


def is_on_floor(file: RobotFile) -> bool:
    """Whether its plant is one whose wheels slip."""
    return file.simulation is not None and file.simulation.plant in _SLIPPING.values()


def on_floor(file: RobotFile) -> RobotFile:
    """The robot with the plant whose wheels slip; one that has it already is as it was.

    Raises:
        NoSimulationError: There is none for this robot, or MuJoCo is not installed.
    """
    if file.simulation is None or not has_contact(file):
        raise NoSimulationError(f"robot '{file.name}' has no plant with friction: its plant is no packaged segway's")
    if lacks_mujoco():
        raise NoSimulationError(f"a plant with friction needs MuJoCo: {lacks_mujoco()}")
    plant = _SLIPPING.get(file.simulation.plant, file.simulation.plant)
    return structs.replace(file, simulation=structs.replace(file.simulation, plant=plant))


def tyres(friction: float) -> Mapping[str, float]:
    """The states of the plant that give both tyres this friction on the floor, 1."""
    return {"LeftFriction": friction, "RightFriction": friction}
