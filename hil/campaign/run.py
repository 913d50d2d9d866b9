# SPDX-License-Identifier: MIT
"""One run of a scenario in lock step: node, bus, drives and plant in this process, on a simulated clock.

And a campaign: every scenario with each of its seeds and sets of parameters, side by side on the cores.
"""

import dataclasses
import functools
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, cast

import msgspec

from segway_ecc.firmware_io.build import make_link, serial_of, takes_serial, with_port
from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId
from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.firmware_io.guard.guard import stopper_of
from segway_ecc.hil.campaign.branches import Branch, Branches
from segway_ecc.hil.campaign.commander import Commander
from segway_ecc.hil.campaign.scenario import MODEL, PLANT, Scenario, ScenarioResult, ScenarioRun, judged
from segway_ecc.hil.campaign.watch import DriveWatch, NodeWatch, Place, apart
from segway_ecc.hil.devices.family import simulated_drives, simulated_imu
from segway_ecc.hil.faults.computer import DisturbedClock, FailingRecorder, ProcessKilledError
from segway_ecc.hil.faults.drives import FailingDrives
from segway_ecc.hil.faults.fault import Fault, Injections
from segway_ecc.hil.faults.links import CutOnlyLine, DisturbedBus, DisturbedDevicesLink, DisturbedLine
from segway_ecc.hil.faults.models import SlowModel, misbehaves, misbehaving
from segway_ecc.hil.faults.plant import DisturbedPlant
from segway_ecc.hil.faults.stranger import Stranger
from segway_ecc.hil.floor.contact import on_floor, tyres
from segway_ecc.hil.processes import quiet, results_of
from segway_ecc.hil.progress import OnProgress
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial
from segway_ecc.hil.rig.simulation import LockstepRig, RigEnds, hardware_of, simulated_robot
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder
from segway_ecc.node.errors import ConfigurationError, NodeError
from segway_ecc.node.model.model import Model
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.replay.replay import replay
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.manoeuvre import Manoeuvre

REPLAY: Final = "replay: "
"""How the reason begins where a replay was not identical."""
_AT_ONCE: Final = 32
"""Runs of one trunk, at most: what that costs is little beside them, and the cores end at about the same time."""
_ARMED_WITHIN_S: Final = 5.0
_OUTCOMES: Final = {Mode.ARMED: "drives_on", Mode.HOLD: "holds", Mode.FAULT: "faults", Mode.DISARMED: "disarmed"}


class _Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What is run: a scenario without what is expected of it."""

    robot: str
    manoeuvre: Manoeuvre
    faults: tuple[Fault, ...]
    fallback: bool
    seed: int
    parameters: tuple[tuple[str, float], ...]
    floor: float | None = None
    log: Path | None = None


@quiet("segway_ecc.node")
def run_scenario(run: ScenarioRun, log: Path | None = None) -> ScenarioResult:
    """Run a scenario once, without the node's messages, and judge it; with `log`, write the robot's log there (MCAP).

    Raises:
        ConfigurationError: The robot or the parameters do not fit.
        ModelError: A parameter is unknown.
    """
    bench = _ScenarioBench(_settings_of(run, log))
    bench.run()
    return _result_of(run, bench)


@quiet("segway_ecc.node")
def run_alike(runs: Sequence[ScenarioRun]) -> list[ScenarioResult]:
    """Run scenarios that differ in their faults alone, by forks of this process; see `branches` and `run_scenario`."""
    if len(runs) == 1:
        return [run_scenario(runs[0])]
    trunk = _without_faults(runs[0])
    _undisturbed(trunk)  # before the forks, each of which compares with it
    bench = _ScenarioBench(trunk)
    branches = Branches[ScenarioResult](bench.injections, [_branch_of(run) for run in runs])
    bench.rig.add(branches)
    found = branches.run(bench.run, lambda place: _result_of(runs[place], bench))
    # A robot that is never armed has no fault either.
    return [found[place] if place in found else run_scenario(run) for place, run in enumerate(runs)]


def _settings_of(run: ScenarioRun, log: Path | None = None) -> _Settings:
    return _Settings(
        robot=run.robot,
        manoeuvre=run.scenario.manoeuvre,
        faults=run.scenario.faults,
        fallback=run.scenario.fallback,
        seed=run.seed,
        parameters=tuple(sorted(run.parameters.items())),
        floor=run.floor,
        log=log,
    )


def _without_faults(run: ScenarioRun) -> _Settings:
    return msgspec.structs.replace(_settings_of(run), faults=(), seed=0)


def _branch_of(run: ScenarioRun) -> Branch:
    return Branch(run.scenario.faults, run.seed)


def _result_of(run: ScenarioRun, bench: "_ScenarioBench") -> ScenarioResult:
    """What came of a run, judged."""
    scenario = run.scenario
    fault_ns = bench.injections.first_ns or 0
    changes = bench.node.changes[1:]  # the first is to be armed
    after = [change for change in changes if change.at_ns >= fault_ns]
    reasons = [change.reason for change in after if change.mode is not Mode.ARMED]
    reasons += [*bench.commander.refusals, bench.error or bench.arming_refusal or ""]
    drive = bench.drive
    result = ScenarioResult(
        source=run.source,
        scenario=scenario.name,
        robot=run.robot,
        seed=run.seed,
        parameters=dict(sorted(run.parameters.items())),
        outcome=bench.outcome(fault_ns),
        reason="; ".join(filter(None, reasons)),
        detection_s=(after[0].at_ns - fault_ns) * 1e-9 if after else None,
        safe_s=None if drive.is_pushing else max(drive.last_push_ns - fault_ns, 0) * 1e-9,
        max_tilt_rad=drive.max_tilt,
        has_fallen=drive.has_fallen,
        max_distance_m=apart(drive.way, _undisturbed(_without_faults(run))),
        switches=tuple(change.reason for change in bench.node.changes if change.mode is None),
        simulated_s=bench.rig.now_ns() * 1e-9,
        digest=drive.digest,
        posture=bench.posture,
        floor=run.floor,
    )
    return judged(result, scenario.expect)


@functools.lru_cache(maxsize=32)
def _undisturbed(settings: _Settings) -> list[Place]:
    """Where the robot is without the faults."""
    bench = _ScenarioBench(settings)
    bench.run()
    return bench.drive.way


def runs_of(scenarios: Sequence[tuple[str, Scenario]], seeds: int | None = None) -> list[ScenarioRun]:
    """Every run of some scenarios, each with its source; `seeds` of each, from 0 on, or the scenarios' own."""
    return [
        ScenarioRun(source, scenario, robot, seed, parameters)
        for source, scenario in scenarios
        for robot in scenario.robots
        for parameters in scenario.parameters
        for seed in (scenario.seeds if seeds is None else range(seeds))
    ]


def run_campaign(
    runs: Sequence[ScenarioRun], jobs: int, on_progress: OnProgress, *, replayed: bool = False
) -> list[ScenarioResult]:
    """Run scenarios; the results are in their order, and bit-identical whatever `jobs` is.

    So many processes run at a time, 1 for this one alone, one run after the other; several make what is common to many
    runs once. `on_progress` is called for each run. With `replayed` each run is also recorded and replayed, and has to
    be identical.

    Raises:
        ConfigurationError: A robot or a parameter does not fit.
        ModelError: A parameter is unknown.
    """
    tasks = [[place] for place in range(len(runs))] if replayed or jobs == 1 else _alike(runs)
    results: dict[int, ScenarioResult] = {}
    todo = [[runs[place] for place in places] for places in tasks]
    with results_of(_run_and_replay_each if replayed else run_alike, todo, jobs) as finished:
        for places, found in zip(tasks, finished, strict=True):
            for place, result in zip(places, found, strict=True):
                results[place] = result
                on_progress(len(results), len(runs))
    return [results[place] for place in range(len(runs))]


def _alike(runs: Sequence[ScenarioRun]) -> list[list[int]]:
    """The places of runs that can be made together, the most first, so that all cores are busy to the end."""
    groups: dict[_Settings, list[int]] = {}
    alone = []
    for place, run in enumerate(runs):
        if _branch_of(run).begins_ns is None:
            alone.append([place])
        else:
            groups.setdefault(_without_faults(run), []).append(place)
    together = [places[at : at + _AT_ONCE] for places in groups.values() for at in range(0, len(places), _AT_ONCE)]
    return sorted([*together, *alone], key=len, reverse=True)


def _run_and_replay_each(runs: Sequence[ScenarioRun]) -> list[ScenarioResult]:
    return [run_and_replay(run) for run in runs]


def run_and_replay(run: ScenarioRun) -> ScenarioResult:
    """Run a scenario, record it, and replay the log; a replay that is not identical is not as expected."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        result = run_scenario(run, log)
        outcome = replay(log)
    if outcome.is_identical and outcome.is_whole:
        return result
    why = f"{REPLAY}{outcome.difference or outcome.gap or 'the log holds no cycle, or is not whole'}"
    return msgspec.structs.replace(result, why_not=(*result.why_not, why))


class _ScenarioBench:
    """Everything of one run, joined, and what was observed of it."""

    def __init__(self, settings: _Settings) -> None:
        self.error: str | None = None
        self.arming_refusal: str | None = None
        self._settings = settings
        self._file = file = _robot_file(settings)
        self.rig = rig = LockstepRig.of(hardware_of(file))
        self.injections = injections = Injections(settings.faults, settings.seed, rig.now_ns)
        self._clock = clock = DisturbedClock(rig, injections)
        clock.on_kill = self._kill
        hardware = hardware_of(file)
        ends = rig.ends(hardware)
        self._bus = DisturbedBus(ends.node, injections, rig.now_ns)
        serial = serial_of(hardware)
        self._wires = wires = None if serial is None else SimulatedSerial(serial.baudrate, rig.now_ns)
        plant_end = DisturbedDevicesLink(ends.devices, injections, _imu_frames(file))
        simulated = simulated_robot(file, plant_end, ends.port if wires is None else wires.device, ends.imu_port)
        for name, value in settings.parameters:
            if name.startswith(PLANT):
                simulated.plant.write(name.removeprefix(PLANT), value)
        for name, value in ({} if settings.floor is None else tyres(settings.floor)).items():
            simulated.plant.write(name, value)
        simulated.plant = DisturbedPlant(simulated.plant, injections)
        link = self._bus if wires is None else make_link(hardware, rig, self._bus, wires.host.open)
        robot = build_robot(file, clock, link)
        if any(injection.fault.type == "slow" for injection in injections.of("model")):
            # A model but for what mypy does not see: it passes all else on to the one behind it.
            model = cast("Model", SlowModel(robot.model, injections, clock.spend))
            robot = dataclasses.replace(robot, model=model)
        self._robot = robot
        self.drive = DriveWatch(simulated, injections)
        lines = _serial_lines(wires, ends, injections, simulated.tick_ns)
        failing = FailingDrives(simulated.devices[0], simulated_drives(hardware).fail, injections)

        def observe(_wall_ns: int, outputs: Sequence[float]) -> None:
            self.drive.look(outputs)
            failing.act()
            for line in lines:
                line.act()

        rig.attach(simulated, observe)
        if injections.of("stranger"):
            stranger = Stranger(rig.bus.attach("stranger"), stopper_of(hardware), injections, rig.now_ns)
            plant_end.on_send = stranger.overhear
            rig.add(stranger)

    def run(self) -> None:
        """Run it."""
        manoeuvre, log, robot, injections = self._settings.manoeuvre, self._settings.log, self._robot, self.injections
        recorder = NoRecorder() if log is None else CycleLog(log, layout_of(robot), provenance_of(self._file))
        self.node = NodeWatch(injections, robot.hardware, FailingRecorder(recorder, injections, self._clock))
        self.commander = Commander(manoeuvre, injections, robot.wiring.set_names)
        loop = robot.loop(self.commander, self.node)
        self.node.modes = loop.modes
        most_s = _ARMED_WITHIN_S + manoeuvre.duration_ns * 1e-9
        try:
            loop.run(round(most_s * 1e9 / robot.period_ns))
        except ProcessKilledError:
            self._run_on()
        except (NodeError, HardwareError) as raised:
            self.error = str(raised)
            self._run_on()
        if injections.timeline.started_ns is None:
            self.arming_refusal = loop.arming_refusal

    @property
    def posture(self) -> str:
        """What the node has the robot doing at the end; empty where it is dead, or has none."""
        return "" if self._bus.is_dead else self.node.posture

    def _run_on(self) -> None:
        """Let the devices run to the end of the manoeuvre without the node."""
        timeline = self.injections.timeline
        if timeline.started_ns is not None:
            rest_ns = self._settings.manoeuvre.duration_ns - timeline.elapsed_ns
            self.rig.sleep_until_ns(self.rig.now_ns() + rest_ns)

    def outcome(self, fault_ns: int) -> str:
        """See `ScenarioResult.outcome`."""
        if self.injections.timeline.started_ns is None:
            return "never armed"
        if self.error is not None:
            return "unsafe" if self.drive.is_pushing else "stopped"
        worst = Mode.FAULT if self._bus.is_dead else self.node.worst_since(fault_ns)
        return "unsafe" if worst is Mode.FAULT and self.drive.is_pushing else _OUTCOMES[worst]

    def _kill(self) -> None:
        """Nothing that the node sends from now on arrives: not even the zeros on its way out."""
        self._bus.is_dead = True
        if self._wires is not None:
            self._wires.host.unplug()


def _serial_lines(
    wires: SimulatedSerial | None, ends: RigEnds, injections: Injections, tick_ns: int
) -> Sequence[CutOnlyLine | DisturbedLine]:
    """What disturbs serial lines: that beside a bus, that in place of one, and that of an IMU."""
    lines: list[CutOnlyLine | DisturbedLine] = []
    if wires is not None:
        lines.append(DisturbedLine(wires, injections, tick_ns))
    elif ends.wires is not None:
        lines.append(CutOnlyLine(ends.wires, injections, "can", "battery"))
    if ends.imu_wires is not None:
        lines.append(CutOnlyLine(ends.imu_wires, injections, "imu", "battery"))
    return lines


_robot = functools.lru_cache(maxsize=32)(load_robot)


def _robot_file(settings: _Settings) -> RobotFile:
    """The robot's file with the model's parameters, a serial line where wanted, and armed at the start."""
    file = _robot(settings.robot)
    if settings.floor is not None:
        file = on_floor(file)
    ours = {name.removeprefix(MODEL): value for name, value in settings.parameters if name.startswith(MODEL)}
    model = msgspec.structs.replace(file.model, parameters={**file.model.parameters, **ours})
    file = msgspec.structs.replace(file, model=model, arming="at_start")
    if any(misbehaves(fault) for fault in settings.faults):
        file = misbehaving(file)
    if not settings.fallback:
        return file
    hardware = file.hardware
    if isinstance(hardware, NoHardwareSection) or not takes_serial(hardware):
        raise ConfigurationError(f"the drives of robot '{file.name}' have no serial line: leave fallback out")
    if serial_of(hardware) is None:
        hardware = with_port(hardware, "simulated")
    return msgspec.structs.replace(file, hardware=hardware)


def _imu_frames(file: RobotFile) -> frozenset[tuple[int, bool]]:
    imu = hardware_of(file).external_imu
    if imu is not None:
        return frozenset(simulated_imu(imu).frames(imu))
    return frozenset({(int(FrameId.IMU_GYRO), False), (int(FrameId.IMU_ACCELERATION), False)})
