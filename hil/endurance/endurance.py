"""Hours of normal driving in lock step, with sensor errors and lost frames: what the robot takes for a fault there.

Nothing is kept but counts, extremes and the first few trips, however long it lasts.
"""

import contextlib
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.endurance.driving import Driver
from segway_ecc.hil.endurance.watch import Trip, Watch
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.faults.injection import Injections
from segway_ecc.hil.faults.links import DisturbedBus
from segway_ecc.hil.faults.plant import DisturbedPlant
from segway_ecc.hil.rig.lockstep import LockstepRig
from segway_ecc.hil.rig.paced_link import kernel_ends
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import simulated_bus, simulated_robot
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoRecorder, NoStage, Recorder, StampedSetpoint
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import NodeError
from segway_ecc.node.robot import Robot, build_robot

OnProgress = Callable[[float], None]
"""Called now and then with the seconds simulated so far."""

_TOLD_EVERY_S: Final = 10.0
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
    on_progress: OnProgress | None = None,
) -> Stretch:
    """Drive a robot for some time, or until it trips.

    Args:
        file: The robot file; it is armed at the start, whatever it says.
        seed: Of its sensors' errors, of the driving and of what is lost.
        duration_s: How long, s.
        frame_loss: Share of the frames that is lost either way, from when it is armed.
        faults: What else fails: the bus, the plant's sensors or motors.
        channel: The CAN interface of robot and plant, which must be theirs alone; None for a simulated bus.
        keep: Makes what keeps the robot's cycles.
        on_progress: Called every ten seconds of simulated time.

    Raises:
        ConfigurationError: The robot cannot be simulated.
    """
    bench = _Bench(file, seed, frame_loss, faults, channel)
    return bench.run(duration_s, keep, on_progress or (lambda _: None))


class _Bench:
    """Robot, bus, devices and plant, joined."""

    def __init__(
        self, file: RobotFile, seed: int, frame_loss: float, faults: Sequence[Fault], channel: str | None
    ) -> None:
        self._seed = seed
        bitrate = simulated_bus(file).bitrate
        rig = self._rig = LockstepRig(bitrate)
        node_end, self._plant_end = _ends(rig, channel, bitrate)
        lossy = [Fault(target="can", type="intermittent", at_s=0.0, amount=frame_loss)] if frame_loss else []
        injections = Injections((*lossy, *faults), seed, rig.now_ns)
        self._bus = CountedBus(node_end, injections, rig.now_ns)
        self._simulated = simulated = _with_seed(simulated_robot(file, self._plant_end), seed)
        if faults:
            simulated.plant = DisturbedPlant(simulated.plant, injections)
        self._robot = build_robot(file, rig, self._bus)
        self._watch = Watch(simulated, self._robot.period_ns, injections.timeline)
        rig.attach(simulated, self._watch.look)

    def run(self, duration_s: float, keep: Callable[[Robot], Recorder], on_progress: OnProgress) -> Stretch:
        robot, watch = self._robot, self._watch
        cycles = max(round(duration_s * 1e9 / robot.period_ns), 1)
        street = _Street(Driver(self._seed), watch, robot.period_ns * 1e-9, on_progress)
        loop = robot.loop(street, _Both(watch, keep(robot)))
        watch.modes = loop.modes
        with contextlib.closing(self._plant_end):
            self._plant_end.open()
            try:
                loop.run(cycles)
            except (NodeError, HardwareError) as error:
                watch.stop(str(error))
        watch.end()
        return self._stretch(loop.counters.cycles)

    def _stretch(self, cycles: int) -> Stretch:
        watch, bus = self._watch, self._bus
        return Stretch(
            seed=self._seed,
            simulated_s=cycles * self._robot.period_ns * 1e-9,
            cycles=cycles,
            trip=watch.trip,
            max_tilt_rad=watch.max_tilt,
            max_velocity_error=watch.max_errors[0],
            max_yaw_rate_error=watch.max_errors[1],
            frames=bus.frames,
            lost=bus.lost,
            refused=_refused(self._robot) + self._simulated.refused_frames,
        )


def _ends(rig: LockstepRig, channel: str | None, bitrate: int) -> tuple[Link, Link]:
    """The ends of the bus for robot and plant."""
    if channel is None:
        return rig.bus.attach("node"), rig.bus.attach("plant")
    return kernel_ends(rig, (channel, channel), bitrate)


class _Both(NoRecorder):
    """Shows each cycle to the watch before it is kept; see `Recorder`."""

    def __init__(self, watch: Watch, recorder: Recorder) -> None:
        self._watch, self._recorder = watch, recorder

    def write(self, record: CycleRecord) -> None:
        """Look at one cycle, and keep it."""
        self._watch.write(record)
        self._recorder.write(record)

    def write_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Keep a set of diagnostics."""
        self._recorder.write_diagnostics(stamp_ns, statuses)

    def close(self) -> None:
        """Finish the log."""
        self._recorder.close()


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


class _Street(NoStage):
    """A driver who says the set-point anew in each cycle, and leaves where the robot has tripped; see `Stage`."""

    def __init__(self, driver: Driver, watch: Watch, period_s: float, on_progress: OnProgress) -> None:
        self._driver, self._watch, self._period_s, self._on_progress = driver, watch, period_s, on_progress
        self._cycle = 0
        self._tell_every = max(round(_TOLD_EVERY_S / period_s), 1)

    @property
    def over(self) -> str | None:  # type: ignore[override]  # here it follows from what was seen
        """Why it ended."""
        return None if self._watch.trip is None else self._watch.trip.reason

    def take_inbox(self) -> Inbox:
        """The set-point of this cycle."""
        time_s = self._cycle * self._period_s
        self._cycle += 1
        if self._cycle % self._tell_every == 0:
            self._on_progress(time_s)
        return Inbox(setpoints=[StampedSetpoint(self._driver.setpoint(time_s), None)])


def _with_seed(robot: SimulatedRobot, seed: int) -> SimulatedRobot:
    """Begin the plant anew with this seed, where it has chance in it."""
    if any(variable.name == _SEED for variable in robot.plant.parameters):
        robot.plant.write(_SEED, seed)
        robot.outputs = robot.plant.initialize(robot.inputs)
    return robot


def _refused(robot: Robot) -> int:
    return sum(int(count) for name, count in robot.hardware.health.items() if ".refused." in name)
