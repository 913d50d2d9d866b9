# SPDX-License-Identifier: MIT
"""The robot file: one YAML document, decoded into typed structures in one go."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import structs

from segway_ecc.firmware_io.drives.family import drive_family, family_of
from segway_ecc.firmware_io.errors import PluginError
from segway_ecc.firmware_io.imus.family import DEFAULT_IMU, imu_family, imu_of
from segway_ecc.firmware_io.plugins import DRIVES, entry_points
from segway_ecc.firmware_io.settings import AxisName, BusSettings, HardwareSettings, check_axes
from segway_ecc.firmware_io.value import Section
from segway_ecc.node.cycle.mixing import (
    GEOMETRY,
    DifferentialMixing,
    GeometrySection,
    Mixer,
    WiredSignal,
    controller_mixers,
    plant_mixers,
    wired_signal,
)
from segway_ecc.node.documents import decode_data, read_document, read_yaml
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.model.declared import Range
from segway_ecc.node.models.load import locate
from segway_ecc.node.safety.settings import SHARED_LENGTHS, SafetySettings, StationSettings

Seconds = Annotated[float, msgspec.Meta(gt=0.0, le=86_400.0)]
Velocity = Annotated[float, msgspec.Meta(gt=0.0, le=1_000.0)]
SecondsOrNone = Annotated[float, msgspec.Meta(ge=0.0, le=86_400.0)]

_Kind = TypeVar("_Kind", bound=Section)
_PACKAGED = Path(__file__).parent / "robots"


class ModelSection(Section, frozen=True, kw_only=True):
    """Which model runs.

    Attributes:
        source: What `load_model` takes, such as `segway_ecc.node.models.cart:Cart`.
        parameters: Parameters other than their defaults, by name, in the model's units.
        method: The integration method of a partial copy of generated code that does not name it.
        step_size: The step of a model that does not give it, s.
        ranges: The least and the largest value of inputs, states and parameters by name, in the model's units; narrower
            than the model's own.
        tunable_while_armed: States and parameters that may be written while the robot is armed, beside those that the
            model declares.
        step_limit_s: What a step may take before the model counts as stuck and its process is ended, s; no less than
            the step. By default ten steps, and at least 0.1 s.
    """

    source: str
    method: Literal["Discrete", "Euler", "RungeKutta2", "RungeKutta4"] | None = None
    step_size: Seconds | None = None
    step_limit_s: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] | None = None
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    ranges: dict[str, Range] = msgspec.field(default_factory=dict)
    tunable_while_armed: tuple[str, ...] = ()


class NoHardwareSection(Section, frozen=True, kw_only=True, tag="none"):
    """The robot is all model."""


class SetpointSection(Section, frozen=True, kw_only=True):
    """How set-points are taken.

    Attributes:
        timeout_s: Silence after which the robot holds its place, s.
        stamp_tolerance_s: How late a stamped set-point may come and still be applied, s.
        horizon_s: How far ahead a stamp may lie, s.
        max_linear_velocity: Largest linear velocity that may be asked for, m/s; None for any.
        max_angular_velocity: Largest angular velocity that may be asked for, rad/s; None for any.
        beyond_limits: What becomes of a set-point that asks for more: it is refused, or clamped.
    """

    timeout_s: Seconds = 0.5
    stamp_tolerance_s: SecondsOrNone = 0.1
    horizon_s: Seconds = 30.0
    max_linear_velocity: Velocity | None = None
    max_angular_velocity: Velocity | None = None
    beyond_limits: Literal["refuse", "clamp"] = "refuse"


class SimulationSection(Section, frozen=True, kw_only=True):
    """What stands at the other end of the bus in simulation.

    Attributes:
        plant: What `load_model` takes.
        parameters: Those other than its defaults, by name in its own units.
        wiring: For each of its ports that has another name than what the drives give it, or measure of it, that signal.
        drives: Which of their family's releases or kinds the simulated drives are, such as 0.5.4; None for the family's
            own choice.
    """

    plant: str
    parameters: dict[str, float] = msgspec.field(default_factory=dict)
    drives: str | None = None
    wiring: Mapping[str, str | WiredSignal] = msgspec.field(default_factory=dict)


class RosSection(Section, frozen=True, kw_only=True):
    """Names under which ROS knows the robot.

    Attributes:
        odometry_frame: Frame of the pose (REP-105).
        base_frame: Frame of the velocities (REP-105).
        imu_frame: Frame of the IMU's values (REP-145): where the IMU sits, with the robot's axes.
        left_joint: The joint of the axis `left`.
        right_joint: The joint of the axis `right`.
        joints: The joints of other axes, by the axis' name; `<axis>_joint` where one is left out.
        odometry_depth: How many odometry messages wait for a reliable subscriber that is stopped or starved.
        cmd_vel: The type of `cmd_vel`.
        pitch: The `topic.<name>` of the wiring on which the model publishes how far the frame of the IMU is turned
            about y, rad: with it and the heading the IMU has an orientation.
        prefix_frames: Whether frames begin with the namespace, so that robots share `/tf`: `robot1/base_link`.
        odometry_tf: Whether the odometry is a transform on `/tf` too; not where a filter publishes a better one.
    """

    node_name: str = "model"
    odometry_frame: str = "odom"
    base_frame: str = "base_link"
    imu_frame: str = "imu_link"
    left_joint: str = "left_wheel_joint"
    right_joint: str = "right_wheel_joint"
    joints: dict[AxisName, str] = msgspec.field(default_factory=dict)
    odometry_depth: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 10
    cmd_vel: Literal["Twist", "TwistStamped"] = "Twist"
    pitch: str | None = None
    prefix_frames: bool = False
    odometry_tf: bool = True

    def in_namespace(self, namespace: str) -> "RosSection":
        """The same with the names that its frames have in a namespace."""
        if not self.prefix_frames or not namespace.strip("/"):
            return self
        frames = ("odometry_frame", "base_frame", "imu_frame")
        return structs.replace(self, **{each: f"{namespace.strip('/')}/{getattr(self, each)}" for each in frames})

    def joint_names(self, joints: Sequence[str]) -> list[str]:
        """What ROS calls the joints whose angles are these signals."""
        names = {"left": self.left_joint, "right": self.right_joint, **self.joints}
        axes = [signal.rpartition(".")[0] for signal in joints if signal.endswith(".angle")]
        return [names.get(axis, f"{axis}_joint") for axis in axes]


RobotName = Annotated[str, msgspec.Meta(pattern=r"^[^./\x00-\x1f\x7f][^/\x00-\x1f\x7f]{0,63}$")]
"""Part of the name of a file: it has no / and no control characters, and does not begin with a point."""


class RobotFile(Section, frozen=True, kw_only=True):
    """A whole robot.

    Made by `decode_robot`, since only the document says which drives its hardware are.

    Attributes:
        wiring: The robot's signal of each model port or state, by name.
        geometry: The lengths that its checks, its mixing and its model share.
        mixing: What makes several axes move the robot, by name: `base` adds `base.force` and others to the signals.
        arming: Whether the robot arms itself at start, or waits to be asked.
        commissioned: Whether it arms only with a report of its commissioning that passed and still holds.
        actuate: When commands leave: in the next cycle's exchange, without jitter, or as soon as they are limited.
        safety: What is watched, beyond what always is; nothing where it is left out.
        station: What the robot does when the base station falls silent; nothing where it is left out.
    """

    name: RobotName
    model: ModelSection
    wiring: Mapping[str, str | WiredSignal]
    geometry: GeometrySection = GeometrySection()
    mixing: dict[AxisName, DifferentialMixing] = msgspec.field(default_factory=dict)
    hardware: NoHardwareSection | HardwareSettings = NoHardwareSection()
    arming: Literal["at_start", "on_request"] = "on_request"
    commissioned: Literal["required", "optional"] = "optional"
    actuate: Literal["next_cycle", "immediately"] = "next_cycle"
    setpoint: SetpointSection = SetpointSection()
    safety: SafetySettings | None = None
    station: StationSettings | None = None
    ros: RosSection = RosSection()
    simulation: SimulationSection | None = None

    def __post_init__(self) -> None:
        """Refuse a mixing that is called as something else; ValueError."""
        check_axes(self.mixing)

    @property
    def controller_mixers(self) -> list[Mixer]:
        """What the mixing adds to what the model can be wired to."""
        return controller_mixers(self.mixing, self.geometry)

    @property
    def plant_mixers(self) -> list[Mixer]:
        """What it adds to what the plant can be wired to."""
        return plant_mixers(self.mixing, self.geometry)


def decode_robot(text: str, where: str) -> RobotFile:
    """Decode the text of a robot file; messages call it `where`. See `decode_yaml`.

    Raises:
        ConfigurationError: It is not as it must be, or names drives or an IMU that are not installed, an IMU that the
            bus of its drives does not suit, or a length that its geometry lacks.
    """
    return convert_robot(read_yaml(text, where), where)


def convert_robot(data: object, where: str) -> RobotFile:
    """A robot file of its mappings, lists, texts and numbers; see `decode_robot`."""
    try:
        kind = _kind_of(data, where)
    except PluginError as error:
        raise ConfigurationError(f"{where}: {error}") from error
    decoded = decode_data(_with_lengths(data), kind, where)
    hardware = decoded.hardware
    if not isinstance(hardware, NoHardwareSection):
        hardware = _as(family_of(hardware).settings, hardware)
        if (why := _why_not_on_bus(hardware)) is not None:
            raise ConfigurationError(f"{where}: hardware.external_imu: {why}")
    try:
        return _with_geometry(structs.replace(_as(RobotFile, decoded), hardware=hardware))
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from error


def _why_not_on_bus(hardware: HardwareSettings) -> str | None:
    """Why the IMU cannot be on the bus of the drives; None where it can, or where there is none."""
    imu = hardware.external_imu
    if imu is None or not isinstance(hardware, BusSettings) or not hardware.can.fd:
        return None
    why_not_fd = imu_of(imu).why_not_fd
    return None if why_not_fd is None else why_not_fd(imu)


def _with_lengths(data: object) -> object:
    """The document with the lengths of its geometry in the checks that lack them."""
    if not isinstance(data, dict):
        return data
    geometry, safety = data.get("geometry"), data.get("safety")
    if not isinstance(geometry, dict) or not isinstance(safety, dict):
        return data
    checks = {
        check: {name: geometry[name] for name in SHARED_LENGTHS[check] if name in geometry} | found
        for check, found in safety.items()
        if check in SHARED_LENGTHS and isinstance(found, dict)
    }
    return {**data, "safety": {**safety, **checks}}


def _with_geometry(file: RobotFile) -> RobotFile:
    """The robot with the lengths of its geometry in the parameters of model and plant that are wired to them.

    Raises:
        ConfigurationError: A length is missing.
    """
    wiring, parameters = _parameters(file, "wiring", file.wiring, file.model.parameters)
    file = structs.replace(file, wiring=wiring, model=structs.replace(file.model, parameters=parameters))
    simulation = file.simulation
    if simulation is not None:
        wiring, parameters = _parameters(file, "simulation.wiring", simulation.wiring, simulation.parameters)
        simulation = structs.replace(simulation, wiring=wiring, parameters=parameters)
        file = structs.replace(file, simulation=simulation)
    if file.mixing:
        _ = file.controller_mixers
    return file


def _parameters(
    file: RobotFile, where: str, wiring: Mapping[str, str | WiredSignal], parameters: Mapping[str, float]
) -> tuple[dict[str, str | WiredSignal], dict[str, float]]:
    """A wiring without the parameters that are wired to lengths, and all parameters; one that is set has its own."""
    left, found = dict[str, str | WiredSignal](), dict(parameters)
    for port, entry in wiring.items():
        wired = wired_signal(entry)
        if not wired.signal.startswith(GEOMETRY):
            left[port] = entry
            continue
        length = getattr(file.geometry, wired.signal.removeprefix(GEOMETRY), None)
        if length is None:
            raise ConfigurationError(f"{where}.{port}: there is no {wired.signal} in this robot file")
        found.setdefault(port, length * wired.gain + wired.offset)
    return left, found


def _kind_of(data: object, where: str) -> type[RobotFile]:
    """`RobotFile`, with the settings of the drives and the IMU that a document names.

    Raises:
        ConfigurationError: It has hardware, and names no drives, or has drives as 0.1 had them.
        PluginError: What it names is not installed.
    """
    hardware = data.get("hardware") if isinstance(data, dict) else None
    if not isinstance(hardware, dict):
        return _with_field(RobotFile, "hardware", NoHardwareSection)
    if "type" not in hardware:
        names = ", ".join(sorted({"none", *(point.name for point in entry_points(DRIVES))}))
        raise ConfigurationError(f"{where}: Object missing required field `type` at hardware; allowed is {names}")
    name, imu = hardware["type"], hardware.get("external_imu")
    if name == "none":
        return _with_field(RobotFile, "hardware", NoHardwareSection)
    settings = drive_family(name).settings
    if "axes" in settings.__struct_fields__ and hardware.keys() & {"left", "right"}:
        raise ConfigurationError(
            f"{where}: hardware.left and hardware.right, as 0.1 had them, are two of any number of axes now: write "
            "hardware.axes.left and hardware.axes.right"
        )
    if isinstance(imu, dict):
        settings = _with_field(settings, "external_imu", imu_family(imu.get("type", DEFAULT_IMU)).settings | None)
    return _with_field(RobotFile, "hardware", NoHardwareSection | settings)


def _with_field(kind: type[_Kind], name: str, of: Any) -> type[_Kind]:  # noqa: ANN401 - a type, or several
    """A section with another type for one of its fields."""
    default = next(field.default for field in structs.fields(kind) if field.name == name)
    tag = kind.__struct_config__.tag
    made: type[Any] = msgspec.defstruct(
        kind.__name__, [(name, of, default)], bases=(kind,), frozen=True, kw_only=True, tag=tag
    )
    return made


def _as(kind: type[_Kind], decoded: Section) -> _Kind:
    """The plain section of what was decoded by `_with_field`."""
    return kind(**{name: getattr(decoded, name) for name in kind.__struct_fields__})


def packaged_robots() -> list[str]:
    """The names of the robots that ship with the package."""
    return sorted(entry.name.removesuffix(".yaml") for entry in _PACKAGED.iterdir() if entry.name.endswith(".yaml"))


def load_robot(robot: str) -> RobotFile:
    """Read a robot file by its path, or a robot that ships with the package by its name.

    Its model and plant carry the folder that they lie in, where that is the robot file's or the current one; a packaged
    robot's are installed.

    Raises:
        ConfigurationError: The file is missing or not as it must be; the text gives the path within the file.
    """
    file = decode_robot(read_text(robot), robot)
    if robot in packaged_robots():
        return file
    folders = (Path(robot).resolve().parent, Path())
    model = msgspec.structs.replace(file.model, source=locate(file.model.source, folders))
    file = msgspec.structs.replace(file, model=model)
    if file.simulation is None:
        return file
    simulation = msgspec.structs.replace(file.simulation, plant=locate(file.simulation.plant, folders))
    return msgspec.structs.replace(file, simulation=simulation)


def read_text(robot: str) -> str:
    """The text of a robot file; see `load_robot`."""
    if robot in packaged_robots():
        return (_PACKAGED / f"{robot}.yaml").read_text(encoding="utf-8")
    path = Path(robot)
    try:
        return read_document(path)
    except OSError as error:
        raise ConfigurationError(
            f"cannot read robot file '{robot}': {error.strerror}; "
            f"the packaged robots are {', '.join(packaged_robots())}"
        ) from error
