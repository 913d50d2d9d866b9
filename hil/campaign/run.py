# SPDX-License-Identifier: MIT
"""One run of a scenario in lock step: node, bus, drives and plant in this process, on a simulated clock."""

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from segway_ecc.firmware_io.build import HardwareSettings, make_link, serial_of, takes_serial, with_port
from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId
from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.imus.xsens_mti.frames import Message
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
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import simulated_bus, simulated_robot
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder
from segway_ecc.node.errors import ConfigurationError, NodeError
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import build_robot, clocks_of
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.manoeuvre import Manoeuvre

_ARMED_WITHIN_S: Final = 5.0
_OUTCOMES: Final = {Mode.ARMED: "drives_on", Mode.HOLD: "holds", Mode.FAULT: "faults", Mode.DISARMED: "disarmed"}
_IMU_MESSAGES: Final = (Message.GROUP_COUNTER, Message.SAMPLE_TIME, Message.RATE_OF_TURN, Message.ACCELERATION)


class _Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What is run: a scenario without what is expected of it."""

    robot: str
    manoeuvre: Manoeuvre
    faults: tuple[Fault, ...]
    fallback: bool
    seed: int
    parameters: tuple[tuple[str, float], ...]
    log: Path | None = None


class _Observed(NamedTuple):
    """What was observed of a run."""

    injections: Injections
    drive: DriveWatch
    node: NodeWatch
    error: str | None
    is_killed: bool
    ended_ns: int

    def outcome(self, fault_ns: int) -> str:
        """See `ScenarioResult.outcome`."""
        if self.injections.timeline.started_ns is None:
            return "never armed"
        if self.error is not None:
            return "stopped"
        worst = Mode.FAULT if self.is_killed else self.node.worst_since(fault_ns)
        return "unsafe" if worst is Mode.FAULT and self.drive.is_pushing else _OUTCOMES[worst]


def run_scenario(run: ScenarioRun, log: Path | None = None) -> ScenarioResult:
    """Run a scenario once, and judge it.

    Args:
        run: What to run.
        log: Where to write the robot's log (MCAP); None for none.

    Raises:
        ConfigurationError: The robot or the parameters do not fit.
        ModelError: A parameter is unknown.
    """
    scenario = run.scenario
    settings = _Settings(
        robot=run.robot,
        manoeuvre=scenario.manoeuvre,
        faults=scenario.faults,
        fallback=scenario.fallback,
        seed=run.seed,
        parameters=tuple(sorted(run.parameters.items())),
        log=log,
    )
    observed = _ScenarioBench(settings).run()
    fault_ns = observed.injections.first_ns or 0
    after = [change for change in observed.node.changes if change.at_ns >= fault_ns] if scenario.faults else []
    reasons = [change.reason for change in after if change.mode is not Mode.ARMED]
    drive = observed.drive
    result = ScenarioResult(
        source=run.source,
        scenario=scenario.name,
        robot=run.robot,
        seed=run.seed,
        parameters=dict(settings.parameters),
        outcome=observed.outcome(fault_ns),
        reason="; ".join([*reasons, *([observed.error] if observed.error else [])]),
        detection_s=(after[0].at_ns - fault_ns) * 1e-9 if after else None,
        safe_s=None if drive.is_pushing else max(drive.last_push_ns - fault_ns, 0) * 1e-9,
        max_tilt_rad=drive.max_tilt,
        max_distance_m=apart(drive.way, _undisturbed(msgspec.structs.replace(settings, faults=(), seed=0, log=None))),
        switches=tuple(change.reason for change in observed.node.changes if change.mode is None),
        simulated_s=observed.ended_ns * 1e-9,
        digest=drive.digest,
    )
    return judged(result, scenario.expect)


@functools.lru_cache(maxsize=32)
def _undisturbed(settings: _Settings) -> list[Place]:
    """Where the robot is without the faults."""
    return _ScenarioBench(settings).run().drive.way


class _ScenarioBench:
    """Everything of one run, joined."""

    def __init__(self, settings: _Settings) -> None:
        self._settings = settings
        self._file = file = _robot_file(settings)
        self._rig = rig = LockstepRig(simulated_bus(file).bitrate)
        self._injections = injections = Injections(settings.faults, settings.seed, rig.now_ns)
        self._clock = clock = DisturbedClock(rig, injections)
        clock.on_kill = self._kill
        self._bus = DisturbedBus(rig.bus.attach("node"), injections, rig.now_ns)
        hardware = _hardware(file)
        serial = serial_of(hardware)
        self._wires = wires = None if serial is None else SimulatedSerial(serial.baudrate, rig.now_ns)
        plant_end = DisturbedDevicesLink(rig.bus.attach("plant"), injections, _imu_frames(file))
        simulated = simulated_robot(file, plant_end, None if wires is None else wires.device)
        for name, value in settings.parameters:
            if name.startswith(PLANT):
                simulated.plant.write(name.removeprefix(PLANT), value)
        simulated.plant = DisturbedPlant(simulated.plant, injections)
        link = self._bus if wires is None else make_link(hardware, clocks_of(rig), self._bus, wires.host.open)
        self._robot = build_robot(file, clock, link)
        self._drive = DriveWatch(simulated, injections)
        line = None if wires is None else DisturbedLine(wires, injections, simulated.tick_ns)

        def observe(_wall_ns: int, outputs: Sequence[float]) -> None:
            self._drive.look(outputs)
            if line is not None:
                line.act()

        rig.attach(simulated, observe)

    def run(self) -> _Observed:
        """Run it."""
        manoeuvre, log, robot, injections = self._settings.manoeuvre, self._settings.log, self._robot, self._injections
        recorder = NoRecorder() if log is None else CycleLog(log, layout_of(robot), provenance_of(self._file))
        watch = NodeWatch(injections, robot.hardware, FailingRecorder(recorder, injections, self._clock))
        loop = robot.loop(Commander(manoeuvre, injections), watch)
        watch.modes = loop.modes
        most_s = _ARMED_WITHIN_S + manoeuvre.duration_ns * 1e-9
        is_killed, error = False, None
        try:
            loop.run(round(most_s * 1e9 / robot.period_ns))
        except ProcessKilledError:
            is_killed = True
            # The devices run to the end of the manoeuvre without the node.
            rest_ns = manoeuvre.duration_ns - injections.timeline.elapsed_ns
            self._rig.sleep_until_ns(self._rig.now_ns() + rest_ns)
        except (NodeError, HardwareError) as raised:
            error = str(raised)
        return _Observed(injections, self._drive, watch, error, is_killed, self._rig.now_ns())

    def _kill(self) -> None:
        """Nothing that the node sends from now on arrives: not even the zeros on its way out."""
        self._bus.is_dead = True
        if self._wires is not None:
            self._wires.host.unplug()


def _robot_file(settings: _Settings) -> RobotFile:
    """The robot's file with the model's parameters, a serial line where wanted, and armed at the start."""
    file = load_robot(settings.robot)
    ours = {name.removeprefix(MODEL): value for name, value in settings.parameters if name.startswith(MODEL)}
    model = msgspec.structs.replace(file.model, parameters={**file.model.parameters, **ours})
    file = msgspec.structs.replace(file, model=model, arming="at_start")
    if not settings.fallback:
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
