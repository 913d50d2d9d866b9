"""A robot file made into the parts that run."""

from dataclasses import dataclass

from firmware_io.drives.wheel_board.driver import WheelBoard
from firmware_io.hardware import Hardware, NoHardware
from firmware_io.links.can_link import CanLink
from firmware_io.links.link import Link
from node.config import CanSection, NoHardwareSection, RobotFile, WheelBoardSection
from node.cycle.clock import NS_PER_S, Clock
from node.cycle.cycle import Cycle
from node.cycle.loop import Loop
from node.cycle.seams import Recorder, Stage
from node.cycle.setpoints import SetpointSchedule
from node.cycle.time_base import TimeBase
from node.cycle.wiring import Wiring, wire
from node.model.load import load_model
from node.model.model import Model


@dataclass(frozen=True, slots=True)
class Robot:
    """The parts of a robot, wired but not yet opened."""

    file: RobotFile
    model: Model
    hardware: Hardware
    wiring: Wiring
    clock: Clock

    @property
    def period_ns(self) -> int:
        """The period of the loop: one step of the model."""
        return round(self.model.step_size * NS_PER_S)

    def loop(self, stage: Stage, recorder: Recorder) -> Loop:
        """The loop of this robot in the world of `stage`, kept by `recorder`."""
        cycle = Cycle(
            model=self.model,
            hardware=self.hardware,
            wiring=self.wiring,
            schedule=self._schedule(),
            time_base=TimeBase(self.period_ns),
            clock=self.clock,
            stage=stage,
            recorder=recorder,
            arm_at_start=self.file.arming == "at_start",
            actuate_immediately=self.file.actuate == "immediately",
        )
        return Loop(
            cycle=cycle,
            clock=self.clock,
            stage=stage,
            recorder=recorder,
            period_ns=self.period_ns,
            robot_name=self.file.name,
        )

    def _schedule(self) -> SetpointSchedule:
        section, step = self.file.setpoint, self.model.step_size
        return SetpointSchedule(
            timeout_cycles=round(section.timeout_s / step),
            tolerance_cycles=round(section.stamp_tolerance_s / step),
            horizon_cycles=round(section.horizon_s / step),
        )


def build_robot(file: RobotFile, clock: Clock, link: Link | None = None) -> Robot:
    """Load the model, make the hardware and wire them.

    Args:
        file: The robot file.
        clock: The clock the robot runs on.
        link: A link to use instead of the bus that the file names, as the rig does.

    Raises:
        ModelError: The model cannot be loaded.
        ConfigurationError: The wiring does not fit.
    """
    section = file.model
    model = load_model(section.source, section.parameters, method=section.method, step_size=section.step_size)
    hardware = _hardware(file, model.step_size, clock, link)
    return Robot(file, model, hardware, wire(model, hardware, file.wiring), clock)


def can_link(section: CanSection, clock: Clock) -> CanLink:
    """The link that a robot file describes."""
    return CanLink(section.interface, section.channel, section.bitrate, clock.now_ns, clock.wall_ns)


def _hardware(file: RobotFile, period_s: float, clock: Clock, link: Link | None) -> Hardware:
    match file.hardware:
        case NoHardwareSection():
            return NoHardware()
        case WheelBoardSection(can=can, watchdog_s=watchdog_s):
            return WheelBoard(link or can_link(can, clock), watchdog_s, period_s, clock.now_ns)
