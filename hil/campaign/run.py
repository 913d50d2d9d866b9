"""One run of a scenario in lock step: node, bus, drives and plant in this process, on a simulated clock."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.firmware_io.build import HardwareSettings, make_link, serial_of, takes_serial, with_port
from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId
from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.imus.xsens_mti.frames import Message
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.hil.campaign.commander import Commander
from segway_ecc.hil.campaign.disk import FailingRecorder
from segway_ecc.hil.campaign.result import ScenarioResult, judged
from segway_ecc.hil.campaign.scenario import MODEL, PLANT, ScenarioRun
from segway_ecc.hil.campaign.watch import DriveWatch, NodeWatch, Place, apart
from segway_ecc.hil.faults.clock import DisturbedClock, ProcessKilledError
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.faults.injection import Injections
from segway_ecc.hil.faults.links import DisturbedBus, DisturbedDevicesLink, DisturbedLine
from segway_ecc.hil.faults.plant import DisturbedPlant
from segway_ecc.hil.rig.lockstep import LockstepRig
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import simulated_bus, simulated_robot
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder, Recorder
from segway_ecc.node.errors import ConfigurationError, NodeError
from segway_ecc.node.recording.cycle_log import CycleLog, layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import Robot, build_robot, clocks_of
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.manoeuvre import Manoeuvre

_ARMED_WITHIN_S: Final = 5.0
_OUTCOMES: Final = {Mode.ARMED: "drives_on", Mode.HOLD: "holds", Mode.FAULT: "faults", Mode.DISARMED: "disarmed"}
_IMU_MESSAGES: Final = (Message.GROUP_COUNTER, Message.SAMPLE_TIME, Message.RATE_OF_TURN, Message.ACCELERATION)


class _Job(msgspec.Struct, frozen=True, kw_only=True):
    """What is run: a scenario without what is expected of it."""

    robot: str
    manoeuvre: Manoeuvre
    faults: tuple[Fault, ...]
    fallback: bool
    seed: int
    parameters: tuple[tuple[str, float], ...]
    log: Path | None = None


@dataclass(frozen=True, slots=True)
class _Seen:
    """What was seen of a run."""

    injections: Injections
    drive: DriveWatch
    node: NodeWatch
    error: str | None
    is_killed: bool
    ended_ns: int


def run_scenario(trial: ScenarioRun, log: Path | None = None) -> ScenarioResult:
    """Run a scenario once, and judge it.

    Args:
        trial: What to run.
        log: Where to write the robot's log (MCAP); None for none.

    Raises:
        ConfigurationError: The robot or the parameters do not fit.
        ModelError: A parameter is unknown.
    """
    scenario = trial.scenario
    job = _Job(
        robot=trial.robot,
        manoeuvre=scenario.manoeuvre,
        faults=scenario.faults,
        fallback=scenario.fallback,
        seed=trial.seed,
        parameters=tuple(sorted(trial.parameters.items())),
        log=log,
    )
    seen = _Bench(job).run()
    way = _undisturbed(msgspec.structs.replace(job, faults=(), seed=0, log=None))
    return judged(_result(trial, job, seen, way), scenario.expect)


@functools.lru_cache(maxsize=32)
def _undisturbed(job: _Job) -> list[Place]:
    """Where the robot is without the faults."""
    return _Bench(job).run().drive.way


def _result(trial: ScenarioRun, job: _Job, seen: _Seen, way: list[Place]) -> ScenarioResult:
    fault_ns = seen.injections.first_ns or 0
    after = [change for change in seen.node.changes if change.at_ns >= fault_ns] if job.faults else []
    reasons = [change.reason for change in after if change.mode is not Mode.ARMED]
    quiet_ns = None if seen.drive.is_pushing else max(seen.drive.last_push_ns - fault_ns, 0)
    return ScenarioResult(
        source=trial.source,
        scenario=trial.scenario.name,
        robot=job.robot,
        seed=job.seed,
        parameters=dict(job.parameters),
        outcome=_outcome(seen, fault_ns),
        reason="; ".join([*reasons, *([seen.error] if seen.error else [])]),
        detection_s=(after[0].at_ns - fault_ns) * 1e-9 if after else None,
        safe_s=None if quiet_ns is None else quiet_ns * 1e-9,
        max_tilt_rad=seen.drive.max_tilt,
        max_distance_m=apart(seen.drive.way, way),
        switches=tuple(change.reason for change in seen.node.changes if change.mode is None),
        simulated_s=seen.ended_ns * 1e-9,
        digest=seen.drive.digest,
    )


def _outcome(seen: _Seen, fault_ns: int) -> str:
    if seen.injections.timeline.started_ns is None:
        return "never armed"
    if seen.error is not None:
        return "stopped"
    worst = Mode.FAULT if seen.is_killed else seen.node.worst_since(fault_ns)
    return "unsafe" if worst is Mode.FAULT and seen.drive.is_pushing else _OUTCOMES[worst]


class _Bench:
    """Everything of one run, joined."""

    def __init__(self, job: _Job) -> None:
        self._job = job
        self._file = _robot_file(job)
        self._rig = LockstepRig(simulated_bus(self._file).bitrate)
        self._injections = Injections(job.faults, job.seed, self._rig.now_ns)
        self._clock = DisturbedClock(self._rig, self._injections)
        self._clock.on_kill = self._kill
        self._bus = DisturbedBus(self._rig.bus.attach("node"), self._injections, self._rig.now_ns)
        self._wires = self._serial_wires()
        self._simulated = self._simulate()
        self._robot: Robot = build_robot(self._file, self._clock, self._robots_link())
        self._drive = DriveWatch(self._simulated, self._injections)
        self._attach()

    def run(self) -> _Seen:
        """Run it."""
        stage = Commander(self._job.manoeuvre, self._injections)
        recorder = FailingRecorder(self._recorder(), self._injections, self._clock)
        watch = NodeWatch(self._injections, self._robot.hardware, recorder)
        loop = self._robot.loop(stage, watch)
        watch.watch(loop)
        most_s = _ARMED_WITHIN_S + self._job.manoeuvre.duration_ns * 1e-9
        is_killed, error = False, None
        try:
            loop.run(round(most_s * 1e9 / self._robot.period_ns))
        except ProcessKilledError:
            is_killed = True
            self._live_on()
        except (NodeError, HardwareError) as raised:
            error = str(raised)
        return _Seen(self._injections, self._drive, watch, error, is_killed, self._rig.now_ns())

    def _kill(self) -> None:
        """Nothing that the node sends from now on arrives: not even the zeros on its way out."""
        self._bus.is_dead = True
        if self._wires is not None:
            self._wires.host.unplug()

    def _live_on(self) -> None:
        """Let the devices run to the end of the manoeuvre without the node."""
        rest_ns = self._job.manoeuvre.duration_ns - self._injections.timeline.elapsed_ns
        self._rig.sleep_until_ns(self._rig.now_ns() + rest_ns)

    def _serial_wires(self) -> SimulatedSerial | None:
        serial = serial_of(_hardware(self._file))
        return None if serial is None else SimulatedSerial(serial.baudrate, self._rig.now_ns)

    def _simulate(self) -> SimulatedRobot:
        link = DisturbedDevicesLink(self._rig.bus.attach("plant"), self._injections, _imu_frames(self._file))
        simulated = simulated_robot(self._file, link, None if self._wires is None else self._wires.device)
        for name, value in self._job.parameters:
            if name.startswith(PLANT):
                simulated.plant.write(name.removeprefix(PLANT), value)
        simulated.plant = DisturbedPlant(simulated.plant, self._injections)
        return simulated

    def _robots_link(self) -> Link:
        if self._wires is None:
            return self._bus
        return make_link(_hardware(self._file), clocks_of(self._rig), self._bus, self._wires.host.open)

    def _attach(self) -> None:
        line = None if self._wires is None else DisturbedLine(self._wires, self._injections, self._simulated.tick_ns)

        def observe(_wall_ns: int, outputs: Sequence[float]) -> None:
            self._drive.look(outputs)
            if line is not None:
                line.act()

        self._rig.attach(self._simulated, observe)

    def _recorder(self) -> Recorder:
        return (
            NoRecorder()
            if self._job.log is None
            else CycleLog(self._job.log, layout_of(self._robot), provenance_of(self._file))
        )


def _robot_file(job: _Job) -> RobotFile:
    """The robot's file with the model's parameters, a serial line where wanted, and armed at the start."""
    file = load_robot(job.robot)
    ours = {name.removeprefix(MODEL): value for name, value in job.parameters if name.startswith(MODEL)}
    model = msgspec.structs.replace(file.model, parameters={**file.model.parameters, **ours})
    file = msgspec.structs.replace(file, model=model, arming="at_start")
    if not job.fallback:
        return file
    hardware = _hardware(file)
    if not takes_serial(hardware):
        raise ConfigurationError(f"the drives of robot '{file.name}' have no serial line: leave fallback out")
    if serial_of(hardware) is None:
        hardware = with_port(hardware, "simulated")
    return msgspec.structs.replace(file, hardware=hardware)


def _hardware(file: RobotFile) -> HardwareSettings:
    if isinstance(file.hardware, NoHardwareSection):
        raise ConfigurationError(f"robot '{file.name}' has no hardware that could fail")
    return file.hardware


def _imu_frames(file: RobotFile) -> frozenset[tuple[int, bool]]:
    """Identifiers of the IMU's frames."""
    imu = _hardware(file).external_imu
    if imu is not None:
        return frozenset(imu.key(message) for message in _IMU_MESSAGES)
    return frozenset({(int(FrameId.IMU_GYRO), False), (int(FrameId.IMU_ACCELERATION), False)})
