# SPDX-License-Identifier: MIT
"""The bus lost in every way there is, while the cart drives: how long until the serial line carries it on."""

import math
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.build import can_link, make_link, takes_serial, with_port
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.hil.case_study.can import read_truth, resample, start_of
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.processes import ProcessFailedError, command
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord, NoRecorder
from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import ACTIVE
from segway_ecc.node.sequence.manoeuvre import ManoeuvreStage, Player, single_segment

MANOEUVRE: Final = single_segment(1.0, 0.5, 4.0)
FAULT_AFTER_S: Final = 2.0
"""Of driving; the line in standby has long shown by then that it is alive."""
INTERFACE_DOWN: Final = "interface down"
"""The one cause that is not pretended: the kernel sets the interface down."""
CAUSES: Final = (*map(str, LinkFault), INTERFACE_DOWN)
_PLANT_STARTS_WITHIN_S: Final = 20.0


@dataclass(frozen=True, slots=True)
class FailoverResult:
    """One loss of the bus.

    Attributes:
        cause: What was done to the bus.
        seen_as: The reason that the robot gave for passing to the other line; None where it did not.
        telemetry_gap_s: From the last good frame on the bus to the first on the serial line.
        torque_gap_s: From then until the motors followed commands again.
        off_course_m: Largest distance between where the cart was and where the model alone is.
        odometry_step_m: Largest step of the robot's own position from one cycle to the next.
        end: Why the run ended, and the mode it ended in.
    """

    cause: str
    seen_as: str | None
    telemetry_gap_s: float | None
    torque_gap_s: float | None
    off_course_m: float
    odometry_step_m: float
    end: str


class Failover:
    """Drives the cart in real time over a redundant link, and takes the bus from under it."""

    def __init__(self, robot: str, file: RobotFile, folder: Path) -> None:
        """Drive a robot; keep its plant's outputs in `folder`.

        Args:
            robot: What the plant's command is given: the file, or the name of one that ships with the package.
            file: The same, read; its bus is the one to lose.
            folder: A folder that is there; the serial line appears in it too.

        Raises:
            ConfigurationError: The robot's drives have no serial line.
        """
        hardware = file.hardware
        if not isinstance(hardware, BusSettings) or not takes_serial(hardware):
            raise ConfigurationError(f"the drives of robot '{file.name}' have no serial line to fall back on")
        self._port = folder / "serial"
        self._can = hardware.can
        self._hardware = with_port(hardware, str(self._port))
        self._file = msgspec.structs.replace(file, hardware=self._hardware)
        self._robot = robot
        self._folder = folder

    def run(self, cause: str) -> FailoverResult:
        """Drive once, and lose the bus in the middle by one of `CAUSES`."""
        name = cause.replace(" ", "_")
        truth, can = self._folder / f"{name}.truth.csv", self._can
        plant = ["plant", self._robot, "--interface", can.interface, "--channel", can.channel]
        plant += ["--serial", str(self._port), "--truth", str(truth)]
        with command(plant, self._folder / f"{name}.plant.txt"):
            deadline = time.monotonic() + _PLANT_STARTS_WITHIN_S
            while not self._port.exists():
                if time.monotonic() > deadline:
                    raise ProcessFailedError(f"the plant made no serial line at {self._port}")
                time.sleep(0.01)
            drive = self._drive(cause)
        if cause == INTERFACE_DOWN:
            _set_interface(can.channel, "up")
        points = resample(read_truth(truth), drive.started_ns, MANOEUVRE.duration_ns)
        alone = OfflineSeat(self._folder).run("alone", MANOEUVRE).trajectory
        undisturbed = zip(alone.x, alone.y, strict=True)
        return drive.result(cause, max(math.dist((p.x, p.y), q) for p, q in zip(points, undisturbed, strict=True)))

    def _drive(self, cause: str) -> "_Drive":
        clock = RealClock()
        bus = FaultyLink(can_link(self._can, clock))

        def break_bus() -> None:
            if cause == INTERFACE_DOWN:
                _set_interface(self._can.channel, "down")
            else:
                bus.fault = LinkFault(cause)

        drive = _Drive(self._file, clock, make_link(self._hardware, clock, bus), break_bus)
        drive.run()
        return drive


class _Drive(NoRecorder):
    """One drive through the manoeuvre; it watches its own cycles, and breaks the bus in one of them."""

    def __init__(self, file: RobotFile, clock: RealClock, link: Link, break_bus: Callable[[], None]) -> None:
        robot = build_robot(file, clock, link)
        names = list(robot.wiring.published)
        self._stage = ManoeuvreStage(Player(MANOEUVRE), names, clock)
        self._hardware = robot.hardware
        self._loop = robot.loop(self._stage, self)
        self._break_bus = break_bus
        self._break_at = round(FAULT_AFTER_S * 1e9 / robot.period_ns)
        if not {"odometry.x", "odometry.y"} <= set(names):
            raise ConfigurationError(f"robot '{file.name}' has no odometry.x and odometry.y: wire its model's position")
        self._places = [names.index(f"odometry.{part}") for part in ("x", "y")]
        self._active = 0
        self._way: list[tuple[float, float]] = []

    @property
    def started_ns(self) -> int:
        """The wall clock at its start, ns since the Unix epoch; see `start_of`."""
        return start_of(self._stage, self._loop)

    def run(self) -> None:
        """Drive until the manoeuvre is over, or the robot breaks it off."""
        with real_time_priority():
            self._loop.run()

    def write(self, record: CycleRecord) -> None:
        """Watch a cycle."""
        if record.mode in ACTIVE:
            x, y = (record.published[place] for place in self._places)
            self._way.append((x, y))
            self._active += 1
            if self._active == self._break_at:
                self._break_bus()

    def result(self, cause: str, off_course_m: float) -> FailoverResult:
        """The outcome of the drive."""
        switching = self._hardware.switching if isinstance(self._hardware, Assembly) else None
        switch = switching.switches[0] if switching is not None and switching.switches else None
        steps = [math.dist(a, b) for a, b in zip(self._way, self._way[1:], strict=False)]
        return FailoverResult(
            cause=cause,
            seen_as=None if switch is None else switch.reason,
            telemetry_gap_s=None if switch is None else _seconds(switch.telemetry_gap_ns),
            torque_gap_s=None if switch is None else _seconds(switch.torque_gap_ns),
            off_course_m=off_course_m,
            odometry_step_m=max(steps, default=0.0),
            end=f"{self._loop.stop_reason}; {self._loop.modes.mode}: {self._loop.modes.reason}",
        )


def _set_interface(channel: str, state: str) -> None:
    """Set a CAN interface up or down; not waited for, since the loop goes on."""
    subprocess.Popen(["ip", "link", "set", channel, state])  # noqa: S603, S607 - no shell reads it


def _seconds(duration_ns: int | None) -> float | None:
    return None if duration_ns is None else duration_ns * 1e-9
