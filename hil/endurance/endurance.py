# SPDX-License-Identifier: MIT
"""Hours of normal driving in lock step, with sensor errors and lost frames: what the robot takes for a fault there.

Nothing is kept but counts, extremes and the first few trips, however long it lasts.
"""

import contextlib
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.endurance.driving import Driver
from segway_ecc.hil.endurance.watch import DriveMonitor, Trip
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.faults.injection import Injections
from segway_ecc.hil.faults.links import DisturbedBus
from segway_ecc.hil.faults.plant import DisturbedPlant
from segway_ecc.hil.rig.lockstep import LockstepRig
from segway_ecc.hil.rig.paced_link import kernel_ends
from segway_ecc.hil.rig.simulation import simulated_bus, simulated_robot
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import Inbox, NoRecorder, NoStage, Recorder, StampedSetpoint
from segway_ecc.node.errors import NodeError
from segway_ecc.node.robot import Robot, build_robot

OnProgress = Callable[[float], None]
"""Called now and then with the seconds simulated so far."""

_REPORTED_EVERY_S: Final = 10.0
_SEED: Final = "Seed"


class Stretch(NamedTuple):
    """One robot, driven from power-on until its time was up or it tripped.

    Attributes:
        seed: Of its sensors' errors, of the driving and of what is lost.
        simulated_s: How long, s.
        cycles: Cycles of its loop.
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
    on_progress: OnProgress = lambda _: None,
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
    bitrate = simulated_bus(file).bitrate
    rig = LockstepRig(bitrate)
    node_end: Link
    plant_end: Link
    if channel is None:
        node_end, plant_end = rig.bus.attach("node"), rig.bus.attach("plant")
    else:
        node_end, plant_end = kernel_ends(rig, (channel, channel), bitrate)
    lossy = [Fault(target="can", type="intermittent", at_s=0.0, amount=frame_loss)] if frame_loss else []
    injections = Injections((*lossy, *faults), seed, rig.now_ns)
    bus, simulated = CountedBus(node_end, injections, rig.now_ns), simulated_robot(file, plant_end)
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

    def __init__(self, driver: Driver, watch: DriveMonitor, period_s: float, on_progress: OnProgress) -> None:
        self._driver, self._watch, self._period_s, self._on_progress = driver, watch, period_s, on_progress
        self._cycle = 0
        self._report_every = max(round(_REPORTED_EVERY_S / period_s), 1)

    @property
    def over(self) -> str | None:  # type: ignore[override]  # here it follows from what was observed
        """Why it ended."""
        return None if self._watch.trip is None else self._watch.trip.reason

    def take_inbox(self) -> Inbox:
        """The set-point of this cycle."""
        time_s = self._cycle * self._period_s
        self._cycle += 1
        if self._cycle % self._report_every == 0:
            self._on_progress(time_s)
        return Inbox(setpoints=[StampedSetpoint(self._driver.setpoint(time_s), None)])
