# SPDX-License-Identifier: MIT
"""What the robot file says of the robot, which commissioning measures."""

import math
from dataclasses import dataclass

from segway_ecc.hil.commission.session import SIDES
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.rig.simulation import hardware_of, simulated_plant
from segway_ecc.node.config import RobotFile
from segway_ecc.node.models.load import load_model


@dataclass(frozen=True, slots=True)
class Expected:
    """From model and plant of the robot file; NaN for what neither names.

    Attributes:
        wheel_radius, track: m, as the model has them.
        wheel_inertia: kg m2, as the plant has it: of a wheel that turns in the air.
        back_emf: Of a motor at its wheel, V s.
    """

    wheel_radius: float
    track: float
    wheel_inertia: float
    back_emf: float


def require_two_wheels(file: RobotFile) -> None:
    """Refuse a robot with other axes, before anything is switched on.

    Half of the steps are about a body on two wheels. A joint that hangs in gravity or has an end stop may not be turned
    once around, nor be given a rising command until it moves, as wheels in the air are.

    Raises:
        NoSimulationError: The robot has no hardware.
        RigError: Its axes are not `left` and `right`.
    """
    axes = getattr(hardware_of(file), "axes", None)
    if axes is not None and set(axes) != set(SIDES):
        raise RigError(
            f"robot '{file.name}' has the axes {', '.join(axes)}: commissioning is for a robot that balances on two "
            "wheels, left and right; try each axis of another by hand, with its drive's own tool, at a small limit"
        )


def expected_of(file: RobotFile) -> Expected:
    """Read them from the robot file, whose model and plant are loaded for it.

    Raises:
        ModelError: One cannot be loaded.
    """
    section = file.model
    model = load_model(section.source, section.parameters, method=section.method, step_size=section.step_size)
    values = {variable.name: model.read(variable.name) for variable in model.parameters}
    if file.simulation is not None:
        plant = simulated_plant(file)
        values = {**{v.name: plant.read(v.name) for v in plant.parameters}, **values}
    constant, gear = values.get("MotorConstant", math.nan), values.get("GearRatio", 1.0)
    return Expected(
        values.get("WheelRadius", math.nan),
        values.get("Track", math.nan),
        values.get("WheelInertia", math.nan),
        constant * gear,
    )
