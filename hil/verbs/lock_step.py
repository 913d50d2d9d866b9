# SPDX-License-Identifier: MIT
"""`segway-ecc lock-step ROBOT`: a simulated robot in ROS, on simulated time."""

import argparse
import contextlib
import logging
from typing import Final

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.hil.in_ros.run import simulated
from segway_ecc.hil.in_ros.stage import LockstepStage, Pace
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import (
    add_json,
    add_namespace,
    check_seconds,
    count_steps,
    output_file,
    print_found,
    stopped_by_signals,
)
from segway_ecc.node.config import load_robot, packaged_robots, read_text
from segway_ecc.node.cycle.interfaces import NoRecorder, Recorder
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.robot import Robot
from segway_ecc.node.ros.remote import RosBridge
from segway_ecc.node.ros.runtime import require_ros

_LONGEST_S: Final = 1e9
_LONGEST_TURN_S: Final = 60.0
_LARGEST_SPEED: Final = 1e6
_USUAL_SPEED: Final = 1.0
_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `lock-step`."""
    parser.add_argument("robot", help=f"a robot file, or one of {', '.join(packaged_robots())}")
    add_namespace(parser)
    add_json(parser)
    parser.add_argument(
        "--speed", type=float, metavar="F", help="simulated seconds in a second at most (default: 1; with --turn any)"
    )
    parser.add_argument("--turn", type=float, metavar="S", help="stand still after each S s until a client has sent")
    parser.add_argument(
        "--patience", type=float, default=10.0, metavar="S", help="for a client's turn, in real time (default: 10)"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="end after this long, in simulated time")
    parser.add_argument("--log", type=output_file, metavar="FILE", help="write the robot's log (MCAP)")


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Run the simulated robot until it is stopped."""
    for name, longest_s in (("duration", _LONGEST_S), ("turn", _LONGEST_TURN_S), ("patience", _LONGEST_S)):
        check_seconds(options, name, longest_s)
    if options.speed is not None and not 0.0 < options.speed <= _LARGEST_SPEED:
        raise ConfigurationError(f"--speed must be more than 0 and at most {_LARGEST_SPEED:g}, not {options.speed:g}")
    require_ros()
    file = load_robot(options.robot)
    with messages(), contextlib.ExitStack() as stack:
        bridge = stack.enter_context(contextlib.closing(RosBridge()))
        found = stack.enter_context(simulated(file))
        robot = found.robot
        cycles = _steps(options, "duration", robot)
        turn = _steps(options, "turn", robot)
        speed = _USUAL_SPEED if options.speed is None and turn is None else options.speed
        pace = Pace(speed, turn, options.patience)
        recorder: Recorder = NoRecorder()
        if options.log is not None:
            recorder = CycleLog(options.log, layout_of(robot), provenance_of(file, read_text(options.robot)))
        stage = LockstepStage(bridge, robot, pace, options.namespace, options.ros_arguments)
        loop = robot.loop(stage, recorder)
        stage.is_ending = lambda: loop.stop_reason is not None
        with stopped_by_signals(loop.stop):
            loop.run(cycles)
        _logger.info("stopped: %s", loop.stop_reason)
    count = loop.counters.cycles
    document = {
        "cycles": count,
        "simulated_s": count * robot.period_ns / NS_PER_S,
        "unanswered": stage.unanswered,
        "refused_frames": found.refused_frames(),
        "stop_reason": loop.stop_reason,
        "diagnostics": {s.name: dict(s.values) for s in loop.statuses()},
    }
    rows = {
        "cycles": f"{count}, {count * robot.period_ns / NS_PER_S:g} s",
        "unanswered": f"{stage.unanswered} turns",
    }
    print_found(options, document, rows)
    return 0


def _steps(options: argparse.Namespace, name: str, robot: Robot) -> int | None:
    seconds = getattr(options, name)
    return None if seconds is None else count_steps(name, seconds, robot.period_ns / NS_PER_S)
