# SPDX-License-Identifier: MIT
"""A robot file made into the parts that run."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from segway_ecc.firmware_io.build import build_hardware
from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.firmware_io.hardware import Hardware, NoHardware
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.node.commissioning import why_not_commissioned
from segway_ecc.node.config import NoHardwareSection, RobotFile
from segway_ecc.node.cycle.cycle import Cycle
from segway_ecc.node.cycle.interfaces import Recorder, Stage
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.cycle.posture import stand_place
from segway_ecc.node.cycle.report import tilt_limits_of
from segway_ecc.node.cycle.setpoints import Setpoint, SetpointSchedule
from segway_ecc.node.cycle.timing import TimeBase
from segway_ecc.node.cycle.trajectory import TrajectoryFollower
from segway_ecc.node.cycle.wiring import Wiring, wire
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.model.declared import declared_variables
from segway_ecc.node.model.model import Model, Variable
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.models.load import load_model
from segway_ecc.node.safety.modes import sit_down_values


@dataclass(frozen=True, slots=True)
class Robot:
    """The parts of a robot, wired but not yet opened; `not_commissioned` is why it may not arm, where that is so."""

    file: RobotFile
    model: Model
    hardware: Hardware
    wiring: Wiring
    clock: Clock
    not_commissioned: str | None = None

    @property
    def period_ns(self) -> int:
        """The period of the loop: one step of the model."""
        return round(self.model.step_size * NS_PER_S)

    @property
    def variables(self) -> Mapping[str, Variable]:
        """The model's inputs, states and parameters as this robot declares them, by name; before it is initialized."""
        return declared_variables(self.model, self.file.model.ranges, self.file.model.tunable_while_armed)

    def cycle(self, stage: Stage, recorder: Recorder) -> Cycle:
        """The cycle of this robot in the world of `stage`, kept by `recorder`."""
        section, step = self.file.setpoint, self.model.step_size
        largest = Setpoint(
            min(section.max_linear_velocity or math.inf, self.wiring.largest.linear_velocity),
            min(section.max_angular_velocity or math.inf, self.wiring.largest.angular_velocity),
        )
        horizon, time_base = round(section.horizon_s / step), TimeBase(self.period_ns)
        schedule = SetpointSchedule(
            timeout_cycles=round(section.timeout_s / step),
            tolerance_cycles=round(section.stamp_tolerance_s / step),
            horizon_cycles=horizon,
            largest=largest,
            clamps=section.beyond_limits == "clamp",
        )
        return Cycle(
            model=self.model,
            writer=VariableWriter(self.model, self.variables),
            hardware=self.hardware,
            wiring=self.wiring,
            schedule=schedule,
            trajectories=TrajectoryFollower(time_base, largest, horizon),
            time_base=time_base,
            clock=self.clock,
            stage=stage,
            recorder=recorder,
            arm_at_start=self.file.arming == "at_start",
            actuate_immediately=self.file.actuate == "immediately",
            safety=self.file.safety,
            station=self.file.station,
            not_commissioned=self.not_commissioned,
        )

    def loop(self, stage: Stage, recorder: Recorder) -> Loop:
        """The loop of this robot in the world of `stage`, kept by `recorder`."""
        return Loop(
            cycle=self.cycle(stage, recorder),
            clock=self.clock,
            stage=stage,
            period_ns=self.period_ns,
            robot_name=self.file.name,
            tilt_limits=tilt_limits_of(self.file.safety),
        )


def build_robot(file: RobotFile, clock: Clock, link: Link | None = None, report: Path | None = None) -> Robot:
    """Load the model, make the hardware and wire them.

    Args:
        file: The robot file.
        clock: The clock of its loop.
        link: Used instead of the bus that the file names, by rigs; what runs on it needs no commissioning.
        report: Where the report of its commissioning lies, of which arming asks where the file requires it.

    Raises:
        ModelError: The model cannot be loaded.
        ConfigurationError: The wiring does not fit, or a value or range is not in that of the model.
        UnknownNameError: The wiring, or sitting down, names what is not there.
    """
    section = file.model
    model = load_model(section.source, section.parameters, method=section.method, step_size=section.step_size)
    hardware: Hardware = NoHardware()
    if not isinstance(file.hardware, NoHardwareSection):
        try:
            hardware = build_hardware(file.hardware, model.step_size, clock, link)
        except ValueError as error:  # devices that cannot be on one bus
            raise ConfigurationError(f"hardware: {error}; give one of them other ids") from error
    declared = declared_variables(model, section.ranges, section.tunable_while_armed)
    wiring = wire(model, hardware, file.wiring, declared, file.controller_mixers)
    if file.ros.pitch is not None and file.ros.pitch not in wiring.topics:
        raise ConfigurationError(f"ros.pitch: nothing is wired to topic.{file.ros.pitch}")
    # So that what is wrong is reported before anything is opened.
    for place, value in sit_down_values(file.station, wiring.set_names):
        low, high = wiring.set_ranges[place]
        if not low <= value <= high:
            name = wiring.set_names[place]
            raise ConfigurationError(
                f"station.sit_down.{name} is {value:g}: what it is wired to allows {low:g} to {high:g}"
            )
    stand_place(file.safety.posture if file.safety else None, wiring.set_names)
    reason = None if link is not None else why_not_commissioned(file, report)
    return Robot(file, model, hardware, wiring, clock, reason)
