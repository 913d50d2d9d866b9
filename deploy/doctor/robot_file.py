# SPDX-License-Identifier: MIT
"""Whether a robot file is safe: its parameters against their design, its wiring, and the checks that it lacks."""

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Final

from segway_ecc.deploy.doctor.check import Finding, System, Workload, bad, good, warning
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.config import RobotFile, load_robot, packaged_robots
from segway_ecc.node.cycle.guarded_model import GuardedModel
from segway_ecc.node.cycle.mixing import wired_signal
from segway_ecc.node.cycle.setpoints import REST
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS, SET, SETPOINT_SIGNALS, TOPIC
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.model.model import Variable
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.settings import NOTHING_WATCHED
from segway_ecc.node.watchdog.apart import EndedError, run_apart
from segway_ecc.node.watchdog.watchdog import model_watchdog

_OURS: Final = "segway_ecc."
_PHYSICAL: Final = frozenset({"m", "kg", "kg m2", "Ohm", "H", "N m/A"})
"""Units of what is never negative where it is positive by default."""
_FAR: Final = 50.0
"""No gain of the packaged segways is stable at more than 44 times its design (steering; balance at 4.1; docs/segway).
One in degrees where radians are wanted is 57 times as large."""
_NOTED: Final = 10.0
_HOLD_UP: Final = ("PitchGain", "PitchRateGain", "VelocityGain")
"""Gains by which a segway stands. A lighter or smaller one has smaller ones, and in nearly the same proportion: the
quotient of the first two is the pendulum's rate, which goes with the root of its length. One that is far smaller than
both others holds up no robot."""
_SAME: Final = 0.1
"""Two figures of one length differ by no more than this part."""
_UNITS: Final = {
    name: "rad/s" if name.endswith("angular_velocity") else "m/s" if name.endswith("velocity") else "m"
    for name in (*ODOMETRY_SIGNALS, *SETPOINT_SIGNALS)
} | {"odometry.heading": "rad"}
_LIMITS: Final = {"tilt_rate_limit": "rad/s", "wheel_velocity_limit": "rad/s", "frozen_after_s": "s"}
"""Plain limits of section safety, which the packaged robots of the same model have too."""
_OF_DRIVES: Final = (
    "wheel_velocity_limit",
    "frozen_after_s",
    "velocity_consistency",
    "supply",
    "late_cycles_limit",
    "max_command",
    "command_slew",
    "output_limits",
    "oscillation",
)
_OF_WHAT_DRIVES: Final = "following_error"
"""Of a robot that follows velocities; one that goes to angles has limits of its joints."""
_OF_JOINTS: Final = "joint_limits"
_OF_AN_IMU: Final = ("tilt_limit_rad", "tilt_rate_limit", "yaw_consistency", "checklist")
_OF_WHAT_STANDS: Final = ("runaway", "gravity", "posture")
_STAND: Final = "stand"
"""What has the model of a robot that balances stand up, by its usual name."""
_AXIS: Final = re.compile(r"(?:^|[_.]|(?<=[a-z0-9]))([XYZ])$|(?:^|[_.])([xyz])$")
"""The axis that a name ends in: `GyroX`, `imu.angular_velocity_x`, and not `Velocity`."""
_MODEL: Final = "robot file: model"
_PARAMETERS: Final = "robot file: parameters"
_WIRING: Final = "robot file: wiring"
_CHECKS: Final = "robot file: safety"


def check_robot_file(_machine: System, workload: Workload) -> Iterator[Finding]:
    """The robot file that is named; nothing where none is. Its model is tried in a process of its own."""
    file = workload.robot
    if file is None:
        return
    try:
        findings = run_apart(lambda: examine_file(file)[1])
    except EndedError as error:
        remedy = "correct the model; segway-ecc model inspect and model simulate show more"
        findings = [bad(_MODEL, str(error), "a robot that runs ends as abruptly, and falls", remedy)]
    yield from findings or [good("robot file", "parameters, wiring and checks are as they should be")]


def examine_file(file: RobotFile) -> tuple[Robot, list[Finding]]:
    """The robot of a file, and what is wrong with it.

    Its model is watched meanwhile: one that does not return, or crashes, ends the process, which reports it.

    Raises:
        SegwayEccError: It cannot be built.
    """
    with model_watchdog(file.model.source) as watchdog:
        robot = build_robot(file, RealClock())
        return robot, list(examine_robot(dataclasses.replace(robot, model=watchdog.watch(robot.model))))


def examine_robot(robot: Robot) -> Iterator[Finding]:
    """What is wrong with a robot that can be built; nothing is opened."""
    yield from _parameters(robot)
    yield from _lengths(robot)
    yield from _limits(robot)
    yield from _start(robot)
    yield from _wiring(robot)
    yield from _checks(robot)


def _is_ours(robot: Robot) -> bool:
    return robot.file.model.source.startswith(_OURS)


@cache
def _packaged(source: str) -> Sequence[RobotFile]:
    """The packaged robots of a model."""
    return [file for file in map(load_robot, packaged_robots()) if file.model.source == source]


def _design(robot: Robot) -> Mapping[str, float]:
    """The parameters as designed: the packaged robot's of the same model, else the model's own."""
    return next((file.model.parameters for file in _packaged(robot.file.model.source) if file.model.parameters), {})


def _parameters(robot: Robot) -> Iterator[Finding]:
    """Those that are given, or left out where the design has them, against the design."""
    given, design = robot.file.model.parameters, _design(robot)
    shares = {name: given.get(name, 0.0) / design[name] for name in _HOLD_UP if design.get(name)}
    for variable in robot.model.parameters:
        name = variable.name
        if name in given or name in design:
            value, designed = given.get(name, variable.value), design.get(name, variable.value)
            others = [share for other, share in shares.items() if other != name]
            if _is_ours(robot) and name in shares and 0.0 <= shares[name] * _FAR <= min(others):
                yield _too_small(variable, value, designed)
                continue
            found = _compared(variable, value, designed, is_ours=_is_ours(robot))
            if found is not None:
                yield found


def _too_small(variable: Variable, value: float, designed: float) -> Finding:
    """One of the gains that hold a segway up, which does not."""
    unit, times = variable.unit, "nothing" if value == 0.0 else f"{value / designed:.3g} times that"
    return bad(
        f"{_PARAMETERS}, {variable.name}",
        f"{value:g} {unit}, the design has {designed:g} {unit}: {times}, and the others are not as small",
        "the robot does not stand: it falls, and is FALLEN",
        f"correct model.parameters.{variable.name}; gains of a segway: segway-ecc design gains ROBOT",
    )


def _compared(variable: Variable, value: float, designed: float, *, is_ours: bool) -> Finding | None:
    """What is wrong with a value, if anything; of a model of the user's the default is a hint, and no design."""
    title, unit = f"{_PARAMETERS}, {variable.name}", "" if variable.unit in {"", "1"} else f" {variable.unit}"
    found = f"{value:g}{unit}, {'the design has' if is_ours else 'its default is'} {designed:g}{unit}"
    remedy = f"correct model.parameters.{variable.name}; gains of a segway: segway-ecc design gains ROBOT"
    if designed in {0.0, value}:
        return None
    if value * designed < 0.0:
        grade = bad if is_ours or variable.unit in _PHYSICAL else warning
        return grade(title, f"{found}: reversed", "what it is to correct it drives further away", remedy)
    ratio = math.inf if value == 0.0 else max(value / designed, designed / value)
    if value / designed >= _FAR:
        grade = bad if is_ours else warning
        return grade(title, f"{found}: {value / designed:.3g} times that", "the robot oscillates, or runs away", remedy)
    if ratio >= _NOTED:
        times = "nothing" if value == 0.0 else f"{value / designed:.3g} times that"
        return warning(title, f"{found}: {times}", "the robot does not behave as it was designed to", remedy)
    return None


def _lengths(robot: Robot) -> Iterator[Finding]:
    """The wheels and the track of the checks against those of the model."""
    safety, model = robot.file.safety or NOTHING_WATCHED, {v.name: v.value for v in robot.model.parameters}
    model |= robot.file.model.parameters
    lengths = (
        ("track", model.get("Track")),
        ("wheel_radius", model.get("WheelRadius")),
        ("imu_height", model.get("ImuHeight")),
    )
    for key in ("yaw_consistency", "following_error", "runaway", "gravity"):
        section = getattr(safety, key)
        for name, of_model in lengths:
            value = getattr(section, name, None)
            if value is not None and of_model is not None and abs(value - of_model) > _SAME * abs(of_model):
                yield warning(
                    f"{_CHECKS}, {key}.{name}",
                    f"{value:g} m, the model has {of_model:g} m",
                    "the check trips without a fault, or sees none",
                    f"write the same length into geometry.{name}, for all checks, and model.parameters",
                )


def _limits(robot: Robot) -> Iterator[Finding]:
    """Limits of the checks that nothing reaches: by geometry, and against those of the packaged robots."""
    safety, effect = robot.file.safety or NOTHING_WATCHED, "the check sees nothing"
    tilt = safety.tilt_limit_rad
    if tilt is not None and tilt > math.pi / 2.0:
        found = f"{tilt:g} rad: at {math.pi / 2.0:.2f} rad any body lies on the ground"
        yield bad(f"{_CHECKS}, tilt_limit_rad", found, effect, "write the angle, rad, at which the robot has fallen")
    for name, unit in _LIMITS.items():
        limit, designed = getattr(safety, name), _designed_limit(robot, name)
        if limit is not None and designed is not None and limit >= _NOTED * designed:
            grade = bad if limit >= _FAR * designed else warning
            found = f"{limit:g} {unit}, the design has {designed:g} {unit}: {limit / designed:.3g} times that"
            yield grade(f"{_CHECKS}, {name}", found, effect, f"correct safety.{name}")


def _designed_limit(robot: Robot, name: str) -> float | None:
    """The largest that a packaged robot of the same model has."""
    limits = [getattr(file.safety, name) for file in _packaged(robot.file.model.source) if file.safety is not None]
    return max((limit for limit in limits if limit is not None), default=None)


def _start(robot: Robot) -> Iterator[Finding]:
    """The initial and static equations, one step and the final ones, under what is measured before anything arrives."""
    wiring, count = robot.wiring, len(robot.hardware.signals)
    nothing = Sensors((0.0,) * count, (math.inf,) * count, (False,) * count)
    model = GuardedModel(robot.model)
    try:
        u = wiring.model_inputs(nothing, REST, wiring.set_values)
        model.initialize(u)
        bad_output = model.bad_output
        model.step(u)
        model.terminate()
    except ModelFailedError as error:
        yield bad(_MODEL, str(error), "the robot does not start", "correct model.parameters, or the model")
    else:
        place = model.bad_output if bad_output is None else bad_output
        if place is not None:
            name = robot.model.outputs[place].name
            remedy = "correct model.parameters, or the model"
            yield bad(_MODEL, f"'{name}' is not finite", "the robot ends in FAULT at once", remedy)


def _wiring(robot: Robot) -> Iterator[Finding]:
    """Ports against signals: by the design, where there is one, else by what names and units show."""
    design, model, hardware = _designed_wiring(robot), robot.model, robot.hardware
    of_hardware = {**hardware.signals, **hardware.commands}
    units = {**_UNITS, **of_hardware}
    ports = {v.name: v for v in (*model.parameters, *model.states, *model.inputs, *model.outputs)}
    for port, signal in _signals(robot.file).items():
        title, remedy = f"{_WIRING}, {port}", f"correct wiring.{port}"
        designed = design.get(port)
        if designed is None:
            yield from _by_name(title, ports[port], signal, units.get(signal), remedy)
        elif signal not in designed and (designed & of_hardware.keys() or not signal.startswith((SET, TOPIC))):
            effect = "the model takes, or gives, one quantity for another"
            yield bad(title, f"{signal}, the design has {' or '.join(sorted(designed))}", effect, remedy)


def _designed_wiring(robot: Robot) -> Mapping[str, set[str]]:
    """What the packaged robots of the same model wire each port to."""
    design: dict[str, set[str]] = {}
    for file in _packaged(robot.file.model.source):
        for port, signal in _signals(file).items():
            design.setdefault(port, set()).add(signal)
    return design


def _signals(file: RobotFile) -> dict[str, str]:
    """The signal that each port is wired to."""
    return {port: wired_signal(entry).signal for port, entry in file.wiring.items()}


def _by_name(title: str, port: Variable, signal: str, unit: str | None, remedy: str) -> Iterator[Finding]:
    """A port that no design has."""
    axes = _AXIS.search(port.name), _AXIS.search(signal)
    if {_side(port.name), _side(signal)} == {"left", "right"}:
        effect = "the robot turns the wrong way, and turns the further the more it corrects that"
        yield bad(title, f"{signal}, of the other side", effect, remedy)
    if unit is not None and _plain(port.unit) not in {"", "1", _plain(unit)}:
        effect = "the model takes one quantity for another"
        yield warning(title, f"{signal} in {unit}, the port is in {port.unit}", effect, remedy)
    elif unit is not None and all(axes) and len({axis[0][-1].lower() for axis in axes if axis}) > 1:
        effect = "the model takes one axis for another; how an IMU is mounted is set in hardware"
        yield warning(title, f"{signal}, of another axis", effect, remedy)


def _side(name: str) -> str | None:
    """The one side that a name has."""
    sides = [side for side in ("left", "right") if side in name.lower()]
    return sides[0] if len(sides) == 1 else None


def _plain(unit: str) -> str:
    """A unit as it is compared, however it is written: N m, N.m and N·m are the same."""
    return unit.translate(str.maketrans("²", "2", " .*^·"))


def _checks(robot: Robot) -> Iterator[Finding]:
    """Those that the robot lacks, by what it drives and measures."""
    signals, safety = robot.hardware.signals, robot.file.safety
    if not robot.hardware.commands:
        return
    remedy = "take them from a packaged robot's file with this robot's figures; the reference explains each"
    if safety is None:
        effect = "only a lost sensor or drive ends control: a robot that tips over, runs away or stalls drives on"
        yield warning(_CHECKS, "there is no section safety", effect, remedy)
        return
    drives = any(signal in SETPOINT_SIGNALS for signal in _signals(robot.file).values())
    wanted = [
        *_OF_DRIVES,
        _OF_WHAT_DRIVES if drives else _OF_JOINTS,
        *(_OF_AN_IMU if "imu.angular_velocity_x" in signals else ()),
    ]
    if _STAND in robot.wiring.set_names:
        wanted += _OF_WHAT_STANDS
    lacking = [name for name in wanted if getattr(safety, name) is None]
    if "supply.voltage" not in signals and "supply" in lacking:
        lacking.remove("supply")
    if len(set(robot.hardware.limits)) > 1 and "max_command" in lacking:  # which is one for all
        lacking.remove("max_command")
    if lacking:
        yield warning(_CHECKS, f"there is no {', '.join(lacking)}", "what they would notice drives on", remedy)
