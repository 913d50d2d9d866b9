"""The robot file: one YAML document, decoded into typed structures in one go."""

import importlib.resources
import types
import typing
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
import yaml
from msgspec import structs

from node.errors import ConfigurationError

T = TypeVar("T")
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]

_PACKAGED = importlib.resources.files("node") / "robots"


class _Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of the robot file; a key that it does not have is refused."""


class ModelSection(_Section, frozen=True, kw_only=True):
    """Which model runs.

    Attributes:
        source: What `load_model` takes, such as `node.models.cart:Cart`.
        parameters: Parameters other than their defaults, by name, in the model's units.
    """

    source: str
    parameters: dict[str, float] = {}


class CanSection(_Section, frozen=True, kw_only=True):
    """A CAN bus.

    Attributes:
        interface: A python-can interface, or `auto`: SocketCAN where the channel exists, else a virtual bus.
        channel: The channel, or `auto`: the first SocketCAN interface.
        bitrate: bit/s, for interfaces that set it themselves and for the simulated bus.
    """

    interface: str = "auto"
    channel: str = "auto"
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 500_000


class NoHardwareSection(_Section, frozen=True, kw_only=True, tag="none"):
    """The robot is all model."""


class WheelBoardSection(_Section, frozen=True, kw_only=True, tag="wheel_board"):
    """Our own wheel board.

    Attributes:
        can: The bus it is on.
        watchdog_s: How long the board waits for a command before it switches its motors off, s.
    """

    can: CanSection = CanSection()
    watchdog_s: Annotated[float, msgspec.Meta(ge=0.02, le=0.05)] = 0.05


class SetpointSection(_Section, frozen=True, kw_only=True):
    """How set-points are taken.

    Attributes:
        timeout_s: Silence after which the robot holds its place, s.
        stamp_tolerance_s: How late a stamped set-point may come and still be applied, s.
        horizon_s: How far ahead a stamp may lie, s.
    """

    timeout_s: Positive = 0.5
    stamp_tolerance_s: NotNegative = 0.1
    horizon_s: Positive = 30.0


class RosSection(_Section, frozen=True, kw_only=True):
    """Names under which ROS knows the robot.

    Attributes:
        node_name: Name of the model node.
        odometry_frame: Frame of the pose (REP-105).
        base_frame: Frame of the velocities (REP-105).
        left_joint: Name of the left wheel's joint.
        right_joint: Name of the right wheel's joint.
    """

    node_name: str = "model"
    odometry_frame: str = "odom"
    base_frame: str = "base_link"
    left_joint: str = "left_wheel_joint"
    right_joint: str = "right_wheel_joint"


class SimulationSection(_Section, frozen=True, kw_only=True):
    """What stands at the other end of the bus in simulation.

    Attributes:
        plant: What `load_model` takes; its inputs and outputs bear the names of the drive's commands and signals.
    """

    plant: str


class RobotFile(_Section, frozen=True, kw_only=True):
    """A whole robot.

    Attributes:
        name: What the robot is called.
        model: The model that runs.
        wiring: The robot's signal of each model port or state, by name.
        hardware: The drives.
        arming: Whether the robot arms itself at start, or waits to be asked.
        actuate: When commands leave: in the next cycle's exchange, without jitter, or as soon as they are limited.
        setpoint: How set-points are taken.
        ros: Names in ROS.
        simulation: The simulated plant, where there is one.
    """

    name: str
    model: ModelSection
    wiring: dict[str, str]
    hardware: NoHardwareSection | WheelBoardSection = NoHardwareSection()
    arming: Literal["at_start", "on_request"] = "on_request"
    actuate: Literal["next_cycle", "immediately"] = "next_cycle"
    setpoint: SetpointSection = SetpointSection()
    ros: RosSection = RosSection()
    simulation: SimulationSection | None = None


def packaged_robots() -> list[str]:
    """The names of the robots that ship with the package."""
    return sorted(entry.name.removesuffix(".yaml") for entry in _PACKAGED.iterdir() if entry.name.endswith(".yaml"))


def load_robot(robot: str) -> RobotFile:
    """Read a robot file.

    Args:
        robot: A path to a YAML file, or the name of a robot that ships with the package.

    Raises:
        ConfigurationError: The file is missing or not as it must be; the text gives the path within the file.
    """
    return decode_yaml(read_text(robot), RobotFile, robot)


def read_text(robot: str) -> str:
    """The text of a robot file; see `load_robot`."""
    if robot in packaged_robots():
        return (_PACKAGED / f"{robot}.yaml").read_text(encoding="utf-8")
    path = Path(robot)
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(
            f"cannot read robot file '{robot}': {reason}; the packaged robots are {', '.join(packaged_robots())}"
        ) from error


def decode_yaml(text: str, kind: type[T], where: str) -> T:
    """Decode a YAML document into `kind`.

    Raises:
        ConfigurationError: With the place in the document, what was found and what is allowed.
    """
    try:
        return msgspec.convert(yaml.safe_load(text), kind)
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{where} is not YAML: {' '.join(str(error).split())}") from error
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{where}: {_explain(str(error), kind)}") from error


def _explain(message: str, kind: type) -> str:
    """Add what is allowed to msgspec's message about a key or value that is not."""
    path = message.rpartition("`$")[2].rstrip("`") if "`$" in message else ""
    parts = [part for part in path.split(".") if part]
    if "unknown field" in message:
        return f"{message}; the keys there are {', '.join(_keys(_kinds_at([kind], parts)))}"
    if "Invalid enum value" in message:
        return f"{message}; allowed is {', '.join(_choices(_kinds_at([kind], parts)))}"
    if message.startswith("Invalid value"):
        return f"{message}; allowed is {', '.join(_tags(_kinds_at([kind], parts[:-1])))}"
    return message


def _kinds_at(kinds: list[object], path: list[str]) -> list[object]:
    """The types, alternatives included, that stand at `path` below `kinds`."""
    kinds = [kind for given in kinds for kind in (typing.get_args(given) if _is_union(given) else (given,))]
    if not path:
        return kinds
    below = [field.type for struct in _structs(kinds) for field in structs.fields(struct) if field.name == path[0]]
    return _kinds_at(below, path[1:])


def _is_union(kind: object) -> bool:
    return isinstance(kind, types.UnionType)


def _structs(kinds: list[object]) -> list[type[msgspec.Struct]]:
    return [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, msgspec.Struct)]


def _keys(kinds: list[object]) -> list[str]:
    return sorted({field.name for struct in _structs(kinds) for field in structs.fields(struct)})


def _choices(kinds: list[object]) -> list[str]:
    return sorted(str(choice) for kind in kinds for choice in typing.get_args(kind))


def _tags(kinds: list[object]) -> list[str]:
    return sorted(str(struct.__struct_config__.tag) for struct in _structs(kinds))
