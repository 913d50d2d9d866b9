"""What a robot file says of its simulation."""

from collections.abc import Callable, Sequence

from hil.errors import NoSimulationError
from node.config import CanSection, RobotFile, WheelBoardSection
from node.model.load import load_model
from node.model.model import Model

Observer = Callable[[int, Sequence[float]], None]
"""Called after each tick of a device with the wall-clock time, ns, and the plant's outputs."""


def simulated_bus(file: RobotFile) -> CanSection:
    """The bus that the simulated device shares with the robot.

    Raises:
        NoSimulationError: The robot is on none.
    """
    if not isinstance(file.hardware, WheelBoardSection):
        raise NoSimulationError(f"robot '{file.name}' has no hardware that could be simulated: it is all model")
    return file.hardware.can


def simulated_plant(file: RobotFile) -> Model:
    """The plant that the robot file names.

    Raises:
        NoSimulationError: It names none.
        ModelError: The plant cannot be loaded.
    """
    if file.simulation is None:
        raise NoSimulationError(f"robot '{file.name}' has no plant: add simulation.plant to its file")
    return load_model(file.simulation.plant)
