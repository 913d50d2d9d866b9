# SPDX-License-Identifier: MIT
"""`segway-ecc run ROBOT`: the model node."""

import argparse
import contextlib
import dataclasses
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

from segway_ecc.firmware_io.clock import NS_PER_S, RealClock
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import (
    add_json,
    add_namespace,
    add_robot,
    check_seconds,
    count_steps,
    default_log,
    print_found,
    real_time,
    robot_file,
    stopped_by_signals,
)
from segway_ecc.node.commissioning import report_path
from segway_ecc.node.config import read_text
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage, Recorder, Stage
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.cycle.service import service_of
from segway_ecc.node.errors import (
    ConfigurationError,
    ModelFailedError,
    RecordingError,
    RobotLostError,
    SequenceError,
)
from segway_ecc.node.logs import messages
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.log_quota import MB, LogQuota
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.modes import ACTIVE
from segway_ecc.node.sequence.manoeuvre import ManoeuvreStage, Player, load_manoeuvre
from segway_ecc.node.watchdog.watchdog import model_watchdog, step_limit_s

if TYPE_CHECKING:  # a robot without ROS starts without it
    from segway_ecc.node.ros.remote import RosBridge

_LONGEST_S: Final = 1e9
_SMALLEST_LOG_MB: Final = 1.0
_LARGEST_LOG_MB: Final = 1e7
_FILES_AT_LEAST: Final = 4
_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `run`."""
    add_robot(parser)
    add_namespace(parser)
    add_json(parser)
    parser.add_argument("--ros", action=argparse.BooleanOptionalAction, help="with or without ROS (default: if there)")
    parser.add_argument("--sequence", metavar="FILE", help="without ROS: play this sequence once armed, then end")
    parser.add_argument("--duration", type=float, metavar="S", help="end after this long")
    log = parser.add_mutually_exclusive_group()
    log.add_argument("--log", type=Path, metavar="FILE", help="where the MCAP log goes")
    log.add_argument("--no-log", action="store_true", help="keep no log")
    parser.add_argument(
        "--log-limit",
        type=float,
        default=LogQuota().total_bytes / MB,
        metavar="MB",
        help="room for logs; the oldest is removed first (default: %(default)g)",
    )
    parser.add_argument(
        "--log-file-size",
        type=float,
        metavar="MB",
        help=f"size at which a log's next file begins (default: {LogQuota().file_bytes / MB:g}; a quarter at most)",
    )


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Run the robot until it is stopped."""
    check_seconds(options, "duration", _LONGEST_S)
    file = robot_file(options)
    with messages(), contextlib.ExitStack() as stack:
        bridge = _bridge(stack, options)
        watchdog = stack.enter_context(model_watchdog(file.model.source))
        robot = build_robot(file, RealClock(), report=report_path(options.robot))
        length = options.duration
        cycles = None if length is None else count_steps("duration", length, robot.period_ns / NS_PER_S)
        limit_s = step_limit_s(file.model.step_limit_s, robot.model.step_size)
        watched = watchdog.watch(robot.model, round(limit_s * NS_PER_S))
        robot = dataclasses.replace(robot, model=watched)
        recorder = _recorder(options, robot)
        stage = _stage(options, robot, bridge)
        loop = robot.loop(stage, recorder)
        watched.counter = loop.modes
        loop.sits_down_first = True
        loop.service = service_of(os.environ, robot.period_ns)
        with stopped_by_signals(loop.stop), real_time(lock=True):
            try:
                loop.run(cycles)
            except ModelFailedError:  # whose text has all but this
                _logger.warning("model '%s': %s", watched.name, watched.inputs_text)
                raise
        _logger.info("stopped: %s", loop.stop_reason)
    with contextlib.suppress(BrokenPipeError):  # nobody reads it, and how the run ended counts all the same
        _report(options, loop, stage)
    if isinstance(stage, ManoeuvreStage):
        _check_played(stage, loop, cycles)
    if isinstance(recorder, ProcessRecorder) and recorder.dropped:
        raise RecordingError(f"the robot ran to its end, and its log lacks at least {recorder.dropped} records of it")
    return 0


def _check_played(stage: ManoeuvreStage, loop: Loop, cycles: int | None) -> None:
    """Fail where the sequence was broken off, or was not over when the duration was.

    Raises:
        SequenceError: It was refused, or the duration is too short.
        RobotLostError: The robot left it, or was never armed.
    """
    modes = loop.modes
    if stage.is_broken_off:
        if modes.mode in ACTIVE:
            raise SequenceError(str(stage.over))
        raise RobotLostError(f"the robot went to {modes.mode}: {modes.reason}")
    if cycles is None or loop.counters.cycles < cycles or stage.player.has_reached_end:
        return
    if modes.mode not in ACTIVE:
        raise RobotLostError(f"the sequence never began: {modes.mode}: {loop.arming_refusal or modes.reason}")
    raise SequenceError("the sequence was not over when --duration was: allow more time")


def _bridge(stack: contextlib.ExitStack, options: argparse.Namespace) -> "RosBridge | None":
    """What speaks ROS for the robot; None where it is not to be in ROS, or was not asked to be and ROS is missing."""
    if options.sequence is not None or options.ros is False:
        return None
    from segway_ecc.node.ros.runtime import missing_packages, require_packages  # noqa: PLC0415 - only with ROS

    if options.ros:
        require_packages()  # all else the process of ROS checks
    missing = missing_packages()
    if missing:
        _logger.warning("ROS 2 is not available here (no %s): running without it", ", ".join(missing))
        return None
    from segway_ecc.node.ros.remote import RosBridge  # noqa: PLC0415 - only with ROS

    return stack.enter_context(contextlib.closing(RosBridge()))


def _stage(options: argparse.Namespace, robot: Robot, bridge: "RosBridge | None") -> Stage:
    if options.sequence is not None:
        return ManoeuvreStage(Player(load_manoeuvre(options.sequence)), list(robot.wiring.published), robot.clock)
    if bridge is None:
        return NoStage()
    from segway_ecc.node.ros.remote import RemoteStage  # noqa: PLC0415 - only with ROS

    return RemoteStage(bridge, robot, options.namespace, options.ros_arguments)


def _recorder(options: argparse.Namespace, robot: Robot) -> Recorder:
    if options.no_log:
        return NoRecorder()
    path = options.log or default_log(robot.file.name)
    total, one = options.log_limit, options.log_file_size
    if one is None:  # so that removing the oldest file never takes nearly all there is
        one = max(min(LogQuota().file_bytes / MB, total / _FILES_AT_LEAST), _SMALLEST_LOG_MB)
    if not _SMALLEST_LOG_MB <= one <= total <= _LARGEST_LOG_MB:
        raise ConfigurationError(
            f"--log-file-size must be {_SMALLEST_LOG_MB:g} MB at least and --log-limit no less, "
            f"not {one:g} MB and {total:g} MB"
        )
    # Every log in the folder that is ours may go; beside a file that the user named, only parts of this run may.
    quota = LogQuota(round(total * MB), round(one * MB), is_own_folder=options.log is None)
    _logger.info("log: %s", path)
    return ProcessRecorder(path, layout_of(robot), provenance_of(robot.file, read_text(options.robot)), quota)


def _report(options: argparse.Namespace, loop: Loop, stage: Stage) -> None:
    counters, timing, played = loop.counters, loop.timing(), None
    if isinstance(stage, ManoeuvreStage):
        player, started_ns = stage.player, stage.started_wall_ns
        played = {"start_ns": player.start_ns, "end_ns": player.end_ns, "started_wall_ns": started_ns}
    document = {
        "cycles": counters.cycles,
        "late": counters.late,
        "overrun": counters.overrun,
        "skipped": counters.skipped,
        "mean_rate_hz": counters.mean_rate_hz,
        "stop_reason": loop.stop_reason,
        "timing": {name: dataclasses.asdict(summary) for name, summary in timing.items()},
        "sequence": played,
        "diagnostics": {s.name: dict(s.values) for s in loop.statuses()},
    }
    rows = {
        "cycles": f"{counters.cycles} at {counters.mean_rate_hz:.4f} Hz",
        "late": f"{counters.late} started late, {counters.overrun} ended late, {counters.skipped} skipped",
        "lateness": timing["lateness"].as_text(),
    }
    print_found(options, document, rows)
