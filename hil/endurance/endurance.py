# SPDX-License-Identifier: MIT
"""Hours of normal driving in lock step, with sensor errors and lost frames: what the robot takes for a fault there.

They are divided over seeds and cores, and a robot that has tripped is started anew. Nothing is kept but counts,
extremes and the first few trips, however long it lasts.
"""

import contextlib
import math
from collections.abc import Callable, Sequence
from multiprocessing.sharedctypes import SynchronizedArray
from typing import Final, NamedTuple

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.endurance.driving import Driver
from segway_ecc.hil.faults.fault import Fault, Injections, Timeline
from segway_ecc.hil.faults.links import DisturbedBus
from segway_ecc.hil.faults.plant import DisturbedPlant
from segway_ecc.hil.processes import ignore_interrupt, quiet, spawning
from segway_ecc.hil.progress import OnSeconds
from segway_ecc.hil.rig.fronts import RecorderFront, kernel_ends
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, can_of, hardware_of, simulated_robot
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoRecorder, NoStage, Recorder, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import NodeError
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.modes import Mode, Modes

SETTLED_AFTER_S: Final = 3.0
"""How long a set-point stands before the robot's error from it counts, s."""
_ARMED_WITHIN_S: Final = 5.0
_REPORTED_EVERY_S: Final = 10.0
_WAIT_S: Final = 0.5
_MOST_TRIPS: Final = 20
"""Trips of one seed, after which it drives no more: what fails so often needs no more proof."""
_SEED: Final = "Seed"


class Trip(NamedTuple):
    """A robot that stopped following its driver: when, s since power-on, the mode that was entered, and why."""

    at_s: float
    mode: str
    reason: str


class DriveMonitor(RecorderFront):
    """Observes the plant tick by tick and the node cycle by cycle; see `Recorder`.

    Attributes:
        modes: The robot's; set once its loop is there.
        trip: The first mode other than ARMED after it was armed, or that it never was; None while all is well.
        max_tilt: Largest tilt either way, rad; 0 where the plant has none.
        max_errors: Largest errors of velocity, m/s, and yaw rate, rad/s, while a set-point stood.
    """

    def __init__(self, robot: SimulatedRobot, period_s: float, timeline: Timeline, recorder: Recorder) -> None:
        """Observe a robot with this period of its loop, s, in front of its recorder."""
        super().__init__(recorder)
        self.modes: Modes | None = None
        self.trip: Trip | None = None
        self.max_tilt = 0.0
        self.max_errors = (0.0, 0.0)
        self._robot = robot
        self._period_s = period_s
        self._timeline = timeline
        names = robot.output_names
        self._pitch = names.index("truth.pitch") if "truth.pitch" in names else None
        self._moving = [names.index(f"truth.{name}") for name in ("linear_velocity", "angular_velocity")]
        self._setpoint = Setpoint(math.nan, math.nan)
        self._stood = 0
        self._settled = round(SETTLED_AFTER_S / period_s)
        self._cycle = 0

    def look(self, _wall_ns: int, outputs: Sequence[float]) -> None:
        """Observe one tick, with the plant's outputs after it."""
        if self._pitch is not None and self.trip is None:
            self.max_tilt = max(self.max_tilt, abs(outputs[self._pitch]))

    def write(self, record: CycleRecord) -> None:
        """Observe one cycle, and record it."""
        self._cycle = record.cycle
        if record.mode is Mode.ARMED:
            self._timeline.start()
            self._stood = self._stood + 1 if record.setpoint == self._setpoint else 0
            self._setpoint = record.setpoint
            if self._stood >= self._settled:
                self.max_errors = tuple(  # type: ignore[assignment]  # two of them
                    max(largest, abs(self._robot.outputs[place] - wanted))
                    for largest, place, wanted in zip(self.max_errors, self._moving, record.setpoint, strict=True)
                )
        elif self._timeline.started_ns is not None or record.cycle * self._period_s > _ARMED_WITHIN_S:
            self._note(record.mode)
        super().write(record)

    def stop(self, reason: str) -> None:
        """The loop ended by an error."""
        self.trip = self.trip or Trip(self._cycle * self._period_s, "stopped", reason)

    def end(self) -> None:
        """The time is up."""
        if self._timeline.started_ns is None:
            self._note(Mode.DISARMED)

    def _note(self, mode: Mode) -> None:
        reason = "" if self.modes is None else self.modes.reason
        if self._timeline.started_ns is None:
            reason = f"it was never armed: {reason}"
        self.trip = self.trip or Trip(self._cycle * self._period_s, str(mode), reason)


class Stretch(NamedTuple):
    """One robot, driven from power-on until its time was up or it tripped.

    Attributes:
        seed: Of its sensors' errors, of the driving and of what is lost.
        trip: Why it ended early; None where it did not.
        max_tilt_rad: Largest tilt of the body by the plant's truth, rad.
        max_velocity_error: Largest error of the forward velocity while a set-point stood, m/s.
        max_yaw_rate_error: The same of the yaw rate, rad/s.
        frames: Frames that were sent either way.
        lost: How many of them were lost.
        refused: How many the node or the devices refused.
    """

    seed: int
    simulated_s: float
    cycles: int
    trip: Trip | None
    max_tilt_rad: float
    max_velocity_error: float
    max_yaw_rate_error: float
    frames: int
    lost: int
    refused: int


def drive(  # noqa: PLR0913 - what there is to choose
    file: RobotFile,
    seed: int,
    duration_s: float,
    frame_loss: float,
    *,
    faults: Sequence[Fault] = (),
    channel: str | None = None,
    keep: Callable[[Robot], Recorder] = lambda _: NoRecorder(),
    on_progress: OnSeconds = lambda _: None,
) -> Stretch:
    """Drive a robot for some time, or until it trips.

    Args:
        file: The robot file; it is armed at the start, whatever the file has.
        seed: Of its sensors' errors, of the driving and of what is lost.
        duration_s: How long, s.
        frame_loss: Share of the frames that is lost either way, from when it is armed.
        faults: What else fails: the bus, the plant's sensors or motors.
        channel: The CAN interface of robot and plant, which must be theirs alone; None for a simulated bus.
        keep: Makes the recorder of the robot's cycles.
        on_progress: Called every ten seconds of simulated time.

    Raises:
        ConfigurationError: The robot cannot be simulated.
    """
    hardware = hardware_of(file)
    rig = LockstepRig.of(hardware)
    node_end: Link
    plant_end: Link
    ports: Sequence[Port | None] = ()
    if channel is None:
        ends = rig.ends(hardware)
        node_end, plant_end, ports = ends.node, ends.devices, (ends.port, ends.imu_port)
    else:
        node_end, plant_end = kernel_ends(rig, (channel, channel), can_of(hardware))
    lossy = [Fault(target="can", type="intermittent", at_s=0.0, amount=frame_loss)] if frame_loss else []
    injections = Injections((*lossy, *faults), seed, rig.now_ns)
    bus, simulated = CountedBus(node_end, injections, rig.now_ns), simulated_robot(file, plant_end, *ports)
    if any(variable.name == _SEED for variable in simulated.plant.parameters):
        simulated.plant.write(_SEED, seed)
        simulated.outputs = simulated.plant.initialize(simulated.inputs)
    if faults:
        simulated.plant = DisturbedPlant(simulated.plant, injections)
    robot = build_robot(file, rig, bus)
    period_s = robot.period_ns * 1e-9
    watch = DriveMonitor(simulated, period_s, injections.timeline, keep(robot))
    rig.attach(simulated, watch.look)
    loop = robot.loop(_DriverStage(Driver(seed), watch, period_s, on_progress), watch)
    watch.modes = loop.modes
    with contextlib.closing(plant_end):
        plant_end.open()
        try:
            loop.run(max(round(duration_s * 1e9 / robot.period_ns), 1))
        except (NodeError, HardwareError) as error:
            watch.stop(str(error))
    watch.end()
    refused = sum(int(count) for name, count in robot.hardware.health.items() if ".refused." in name)
    return Stretch(
        seed=seed,
        simulated_s=loop.counters.cycles * robot.period_ns * 1e-9,
        cycles=loop.counters.cycles,
        trip=watch.trip,
        max_tilt_rad=watch.max_tilt,
        max_velocity_error=watch.max_errors[0],
        max_yaw_rate_error=watch.max_errors[1],
        frames=bus.frames,
        lost=bus.lost,
        refused=refused + simulated.refused_frames,
    )


class EndurancePlan(NamedTuple):
    """What is to be driven.

    Attributes:
        duration_s: How long, of all seeds together, s.
        frame_loss: Share of the frames that is lost either way.
        seeds: Seeds 1 to this, each of which has its share of the time.
        channel: The CAN interface of robot and plant; None for a simulated bus. On one the seeds take turns.
    """

    file: RobotFile
    duration_s: float
    frame_loss: float
    seeds: int
    faults: Sequence[Fault] = ()
    channel: str | None = None


def endure(plan: EndurancePlan, jobs: int, on_progress: OnSeconds) -> list[Stretch]:
    """Drive what is planned; the stretches are in the order of the seeds, and the same whatever `jobs` is.

    Raises:
        ConfigurationError: The robot cannot be simulated.
    """
    seeds = range(1, plan.seeds + 1)
    if jobs == 1 or plan.channel is not None:
        stretches: list[Stretch] = []
        for seed in seeds:
            before_s = sum(stretch.simulated_s for stretch in stretches)
            stretches += drive_seed(plan, seed, lambda time_s, before_s=before_s: on_progress(before_s + time_s))  # type: ignore[misc]
        return stretches
    with spawning() as processes:
        driven_s = processes.Array("d", plan.seeds)
        with processes.Pool(jobs, _start, (driven_s,)) as pool:
            ends = [pool.apply_async(_drive_in_pool, (plan, seed)) for seed in seeds]
            for end in ends:
                while not end.ready():
                    end.wait(_WAIT_S)
                    on_progress(sum(driven_s[:]))
            return [stretch for end in ends for stretch in end.get()]


def drive_seed(plan: EndurancePlan, seed: int, on_progress: OnSeconds) -> list[Stretch]:
    """Drive the share of one seed; after each trip a new robot, of another seed, drives on."""
    left_s, stretches = plan.duration_s / plan.seeds, list[Stretch]()
    while left_s > 0.0 and sum(stretch.trip is not None for stretch in stretches) < _MOST_TRIPS:
        before_s = plan.duration_s / plan.seeds - left_s
        with quiet("segway_ecc.node"):
            stretch = drive(
                plan.file,
                seed + plan.seeds * len(stretches),
                left_s,
                plan.frame_loss,
                faults=plan.faults,
                channel=plan.channel,
                on_progress=lambda time_s, before_s=before_s: on_progress(before_s + time_s),  # type: ignore[misc]
            )
        stretches.append(stretch)
        left_s = left_s - stretch.simulated_s if stretch.trip else 0.0
    on_progress(sum(stretch.simulated_s for stretch in stretches))
    return stretches


_driven_s: "SynchronizedArray[float] | None" = None
"""In a process of the pool: how far each seed has come, s."""


def _start(driven_s: "SynchronizedArray[float]") -> None:
    global _driven_s  # noqa: PLW0603 - the one way in which a pool hands shared memory to its processes
    _driven_s = driven_s
    ignore_interrupt()


def _drive_in_pool(plan: EndurancePlan, seed: int) -> list[Stretch]:
    def report(time_s: float) -> None:
        if _driven_s is not None:
            _driven_s[seed - 1] = time_s

    return drive_seed(plan, seed, report)


class CountedBus(DisturbedBus):
    """A disturbed bus that counts what did not come through; see `Link`."""

    def __init__(self, link: Link, injections: Injections, now_ns: Callable[[], int]) -> None:
        """Stand in front of `link`."""
        super().__init__(link, injections, now_ns)
        self._offered = 0
        self._came = 0
        self._handed = 0

    def send(self, frame: Frame) -> bool:
        """Count, and send; see `Link.send`."""
        self._offered += 1
        return super().send(frame)

    def receive(self) -> list[Frame]:
        """Receive, and count; see `Link.receive`."""
        frames = super().receive()
        self._came += len(frames)
        self._handed = self.counters.received  # the link behind keeps nothing back
        return frames

    @property
    def frames(self) -> int:
        """Frames that were sent either way."""
        return self._offered + self._handed

    @property
    def lost(self) -> int:
        """Frames that were sent, and did not arrive."""
        return self._offered - self.counters.sent + self._handed - self._came


class _DriverStage(NoStage):
    """A driver who sends the set-point anew in each cycle, and leaves where the robot has tripped; see `Stage`."""

    def __init__(self, driver: Driver, watch: DriveMonitor, period_s: float, on_progress: OnSeconds) -> None:
        self._driver, self._watch, self._period_s, self._on_progress = driver, watch, period_s, on_progress
        self._cycle = 0
        self._report_every = max(round(_REPORTED_EVERY_S / period_s), 1)

    @property
    def over(self) -> str | None:  # type: ignore[override]  # here it follows from what was observed
        return None if self._watch.trip is None else self._watch.trip.reason

    def take_inbox(self) -> Inbox:
        time_s = self._cycle * self._period_s
        self._cycle += 1
        if self._cycle % self._report_every == 0:
            self._on_progress(time_s)
        return Inbox(setpoints=[StampedSetpoint(self._driver.setpoint(time_s), None)])
