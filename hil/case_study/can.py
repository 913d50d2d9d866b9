# SPDX-License-Identifier: MIT
"""The CAN seat: the controller at one end of a bus, the plant at the other, whose truth is where the cart went."""

import contextlib
import csv
import math
import os
import signal
import time
from bisect import bisect_left
from collections.abc import Sequence
from itertools import starmap
from operator import itemgetter
from pathlib import Path
from typing import Any, Final, TypeGuard

import msgspec

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.firmware_io.links.can_interfaces import socketcan_interfaces
from segway_ecc.firmware_io.links.link import Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.settings import SerialOnlySettings
from segway_ecc.hil.case_study.seats import TRIES, Repeats, SeatRun, trajectory
from segway_ecc.hil.case_study.study import LoopTiming, RealTimeRun, Seat, Trajectory
from segway_ecc.hil.errors import RigError, RunFailedError, SpoiledRunError
from segway_ecc.hil.processes import Command, ProcessFailedError, command
from segway_ecc.hil.rig.fronts import kernel_ends
from segway_ecc.hil.rig.simulation import LockstepRig, can_of, hardware_of, simulated_robot
from segway_ecc.hil.witness import IDLE_S, STALL_S, Stalls, Witness, witness
from segway_ecc.node.config import load_robot, read_text
from segway_ecc.node.cycle.interfaces import NoRecorder, Recorder
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.errors import NodeError, RobotLostError, SequenceError
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import ACTIVE
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, ManoeuvreStage, Odometry, Player, single_segment

ROBOT: Final = "cart-can"
IN_REAL_TIME: Final = "can in real time"
"""The name of its one run in real time, in messages."""
_REAL_TIME_RUN: Final = (1.0, 0.5, 5.0)
"""m/s, rad/s, s."""
_MARGIN_S: Final = 30.0
"""In which a robot is armed; and in which it starts and ends."""
_TRUTH: Final = ("truth.x", "truth.y", "truth.heading", "truth.linear_velocity", "truth.angular_velocity")
_POINT_NS: Final = 10_000_000
_POLL_S: Final = 0.02


class RealTimeCanSeat:
    """Two processes in real time. On a virtual bus each run of each study has its own; on a real one they take turns.

    Attributes:
        timings: How each run that succeeded met its deadlines, by its name.
    """

    seat = Seat.CAN
    tries = TRIES

    def __init__(
        self, folder: Path, logs: Path, robot: str = ROBOT, channels: tuple[str | None, str | None] = (None, None)
    ) -> None:
        """Run a robot; keep messages in `folder` and the robot's logs in `logs`.

        `channels` are the CAN interfaces of robot and plant, which may be two controllers on one bus; None for the
        first interface of this machine, and for the robot's own.
        """
        self._folder = folder
        self._logs = logs
        self._robot = robot
        present = socketcan_interfaces()
        first = channels[0] or (present[0] if present else None)
        self._channels = (first, channels[1] or first)
        self.jobs = 4 if first is None else 1
        self.timings: dict[str, LoopTiming] = {}

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Play a manoeuvre over the bus; see `SeatRunner.run`.

        Raises:
            SpoiledRunError: The robot gave it up while the machine stalled, and does not in lock step.
            RigError: It failed.
        """
        with witness(self._folder / f"can_{name}.witness.txt") as seen:
            try:
                found, played = self._play(name, manoeuvre, seen)
            except RigError as error:
                stalls = seen.stalls()
                own = _own_rest(error, stalls)
                error.args = ("; ".join(filter(None, (str(error), stalls.text, own))),)
                if stalls.text and not own and self._is_spoiled(error, manoeuvre):
                    raise SpoiledRunError(str(error)) from error
                raise
            lateness, stall_s = played["timing"]["lateness"], seen.stalls().stall_s
            self.timings[name] = LoopTiming(lateness["p99_s"], lateness["max_s"], played["skipped"], stall_s)
        return SeatRun(found)

    def _lines(self, name: str) -> tuple[list[str], list[str]]:
        """The options that name the line of robot and of plant: a bus, or a serial line of this run's own."""
        if isinstance(hardware_of(load_robot(self._robot)), SerialOnlySettings):
            line = ["--serial", str(self._folder / f"can_{name}.serial")]
            return line, line
        robot, plant = (channel or f"case_study_{os.getpid()}_{name}" for channel in self._channels)
        return ["--channel", robot], ["--channel", plant]

    def _is_spoiled(self, error: RigError, manoeuvre: Manoeuvre) -> bool:
        """Whether the robot gave up or never armed, as where drives or deadlines are late, and not so in lock step."""
        if not _gave_up(error):
            return False
        try:
            LockstepCanSeat(None, self._robot).run("", manoeuvre)
        except (NodeError, RigError):
            return False
        return True

    def worst(self) -> RealTimeRun:
        """What was worst in all of the runs, of which there was one at least; skipped deadlines are added up."""
        p99s, latest, skipped, stalls = zip(*self.timings.values(), strict=True)
        return RealTimeRun(f"{len(stalls)} runs", LoopTiming(max(p99s), max(latest), sum(skipped), max(stalls)))

    def _play(self, name: str, manoeuvre: Manoeuvre, seen: Witness) -> tuple[Trajectory, dict[str, Any]]:
        """The cart's way, and what the controller printed."""
        file, truth = self._folder / f"can_{name}.yaml", self._folder / f"can_{name}.truth.csv"
        file.write_bytes(msgspec.yaml.encode(manoeuvre))
        robot_line, plant_line = self._lines(name)
        plant = ["plant", self._robot, *plant_line, "--truth", str(truth)]
        node = ["run", self._robot, *robot_line, "--no-ros", "--sequence", str(file), "--json"]
        node += ["--log", str(self._logs / f"can_{name}.mcap")]
        # A robot that the machine is too busy to arm ends by itself, and reports that.
        length_s = manoeuvre.duration_ns * 1e-9 + _MARGIN_S
        node += ["--duration", f"{length_s:g}"]
        guard = ["guard", self._robot, *robot_line]
        hardware = hardware_of(load_robot(self._robot))
        with contextlib.ExitStack() as processes:
            simulated = processes.enter_context(command(plant, self._folder / f"can_{name}.plant.txt"))
            if isinstance(hardware, SerialOnlySettings):
                _wait_for(Path(robot_line[-1]), simulated)
            if hardware.guard == "required":
                processes.enter_context(command(guard, self._folder / f"can_{name}.guard.txt"))
            controller = processes.enter_context(command(node, self._folder / f"can_{name}.node.txt"))
            seen.watch(simulated.process.pid, controller.process.pid)
            try:
                played = controller.result(length_s + _MARGIN_S, simulated)
            except ProcessFailedError as error:
                if simulated.process.poll() is not None:
                    simulated.result(_MARGIN_S)  # then it is the plant that failed
                if error.ended_with == SequenceError.exit_code:
                    raise SequenceError(str(error)) from error  # refused, and so it will be again
                raise
        if played["stop_reason"] in signal.Signals.__members__:
            raise KeyboardInterrupt
        # The plant has ended too by now, so its file is whole.
        points = resample(read_truth(truth), played["sequence"]["started_wall_ns"], manoeuvre.duration_ns)
        return trajectory(Seat.CAN, points), played


def _gave_up(error: RigError) -> TypeGuard[ProcessFailedError]:
    """Whether the robot gave the manoeuvre up, or was never armed."""
    return isinstance(error, ProcessFailedError) and error.ended_with == RobotLostError.exit_code


def _own_rest(error: RigError, stalls: Stalls) -> str:
    """Whether a process did nothing although nothing kept it from it, as text: no stall of the machine excuses that.

    The robot also rests before its loop begins and after it ends: there its loop is not as late.
    """
    plant_s, robot_s = stalls.idle_s or (0.0, 0.0)
    late_s = 0.0
    if _gave_up(error) and error.printed:
        late_s = error.printed["timing"]["lateness"]["max_s"]
    for who, idle_s in (("plant", plant_s), ("robot", min(robot_s, late_s + STALL_S))):
        if idle_s > IDLE_S:
            return f"the {who}'s process was stopped, or hung, for {idle_s * 1e3:.0f} ms"
    return ""


class LockstepCanSeat:
    """Controller, bus and plant in this process, on a simulated clock: the same bits every time.

    The bus is a simulated one; or it is the kernel's own, and time stands still while a frame is on its way through it.
    """

    seat = Seat.CAN
    jobs = 1
    tries = 1

    def __init__(self, logs: Path | None, robot: str = ROBOT, channels: tuple[str, str] | None = None) -> None:
        """Run a robot; its logs go to `logs`, None for none.

        `channels` are the CAN interfaces of robot and plant, which may be two controllers on one bus; None for the
        simulated bus.
        """
        self._logs = logs
        self._robot = robot
        self._channels = channels

    def run(self, name: str, manoeuvre: Manoeuvre) -> SeatRun:
        """Play a manoeuvre in lock step; see `SeatRunner.run`.

        Raises:
            SequenceError, RobotLostError: The robot refused it, or did not play it to its end.
        """
        file = load_robot(self._robot)
        hardware = hardware_of(file)
        rig = LockstepRig.of(hardware)
        ports: Sequence[Port | None] = ()
        robot_link: Link
        plant_link: Link
        if self._channels is None:
            ends = rig.ends(hardware)
            robot_link, plant_link, ports = ends.node, ends.devices, (ends.port, ends.imu_port)
        else:
            robot_link, plant_link = kernel_ends(rig, self._channels, can_of(hardware))
        plant = simulated_robot(file, plant_link, *ports)
        truth = _truth_in(plant.output_names)
        points: list[Odometry] = []
        rig.attach(plant, lambda wall_ns, outputs: points.append(Odometry(wall_ns, *truth(outputs))))
        robot = build_robot(file, rig, robot_link)
        stage = ManoeuvreStage(Player(manoeuvre), list(robot.wiring.published), rig)
        recorder: Recorder = NoRecorder()
        if self._logs:
            provenance = provenance_of(file, read_text(self._robot))
            recorder = CycleLog(self._logs / f"can_{name}.mcap", layout_of(robot), provenance)
        with contextlib.closing(plant_link):
            plant_link.open()
            loop = robot.loop(stage, recorder)
            loop.run(round((manoeuvre.duration_ns * 1e-9 + _MARGIN_S) * NS_PER_S / robot.period_ns))
        started_ns = start_of(stage, loop)
        if stage.is_broken_off or not stage.player.has_reached_end:
            raise _not_played(stage, loop)
        return SeatRun(trajectory(Seat.CAN, resample(points, started_ns, manoeuvre.duration_ns)))


def _wait_for(line: Path, plant: Command) -> None:
    """Wait until a plant has made its serial line: the robot does not wait for it.

    Raises:
        ProcessFailedError: It ended, or makes none.
    """
    deadline = time.monotonic() + _MARGIN_S
    while not line.exists():
        if plant.process.poll() is not None or time.monotonic() > deadline:
            plant.end()
            raise ProcessFailedError(f"the plant made no serial line at {line}")
        time.sleep(_POLL_S)


def start_of(stage: ManoeuvreStage, loop: Loop) -> int:
    """The wall clock at the manoeuvre's start, ns since the Unix epoch, once the loop has ended.

    Raises:
        SequenceError: The robot refused it.
        RobotLostError: The robot was not armed, and never began.
    """
    if stage.started_wall_ns is None:
        raise _not_played(stage, loop)
    return stage.started_wall_ns


def _not_played(stage: ManoeuvreStage, loop: Loop) -> NodeError:
    why = stage.over or loop.stop_reason
    if loop.modes.mode in ACTIVE:
        return SequenceError(why)
    return RobotLostError(f"{why}; {loop.modes.mode}: {loop.modes.reason}")


def run_in_real_time(real: RealTimeCanSeat, lockstep: LockstepCanSeat, repeats: Repeats) -> RealTimeRun:
    """Play a manoeuvre of a few seconds in real time, and compare it with the same in lock step."""
    linear, angular, duration = _REAL_TIME_RUN
    what, manoeuvre = f"{linear:g} m/s, {angular:g} rad/s, {duration:g} s", single_segment(*_REAL_TIME_RUN)

    def once(suffix: str) -> tuple[Trajectory, LoopTiming]:
        name = f"real_time{suffix}"
        return real.run(name, manoeuvre).trajectory, real.timings[name]

    try:
        found, timing = repeats.run(IN_REAL_TIME, real.tries, once)
    except (NodeError, RigError) as error:
        is_spoiled = isinstance(error, RunFailedError) and error.is_spoiled
        return RealTimeRun(what, failure=str(error), is_spoiled=is_spoiled)
    expected = lockstep.run("lock_step", manoeuvre).trajectory
    ways = (zip(way.x, way.y, strict=True) for way in (found, expected))
    return RealTimeRun(what, timing, max(starmap(math.dist, zip(*ways, strict=True))))


def read_truth(path: Path) -> list[Odometry]:
    """Where the cart really was at each tick, from the file that `segway-ecc plant --truth` writes."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(file)
        truth = _truth_in(next(rows)[1:])
        return [Odometry(int(wall_ns), *map(float, truth(values))) for wall_ns, *values in rows]


def _truth_in(output_names: Sequence[str]) -> "itemgetter[tuple[Any, ...]]":
    """Finds where the cart really is among the plant's outputs."""
    return itemgetter(*(output_names.index(name) for name in _TRUTH))


def resample(points: Sequence[Odometry], start_ns: int, duration_ns: int) -> list[Odometry]:
    """The truth at regular times from the start on, on the wall clock, each between the two ticks around it.

    Raises:
        RigError: The ticks end before that.
    """
    stamps, found = [point.stamp_ns for point in points], []
    if not stamps[1:] or 2 * stamps[-1] - stamps[-2] < start_ns + duration_ns:
        raise RigError("the plant's ticks end before the manoeuvre does")
    for stamp_ns in range(start_ns, start_ns + duration_ns + 1, _POINT_NS):
        after = min(max(bisect_left(stamps, stamp_ns), 1), len(points) - 1)
        a, b = points[after - 1], points[after]
        share = (stamp_ns - a.stamp_ns) / (b.stamp_ns - a.stamp_ns)
        found.append(Odometry(stamp_ns, *(p + share * (q - p) for p, q in zip(a[1:], b[1:], strict=True))))
    return found
