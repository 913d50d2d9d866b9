# SPDX-License-Identifier: MIT
"""A robot in real time, with ROS, that measures what it costs: arguments ROBOT --log FILE [OPTIONS].

It reads commands from its standard input and answers each with a line: `ready` once it runs; `begin`, from which on
cycles count; `end` what it cost since then, as JSON, whereupon it ends.
"""

import argparse
import contextlib
import os
import sys
import threading
import time
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.hil.growth.cost import Cost, MeteredClock, cost_of
from segway_ecc.hil.process_usage import cpu_s
from segway_ecc.node.cli.options import add_namespace, add_robot, real_time, robot_file
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.robot import build_robot
from segway_ecc.node.ros.remote import RemoteStage, RosBridge

_LOOK_S: Final = 0.02


class RobotCost(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot cost; `late` is the share of the cycles that began late.

    `cpu` is the share of one core that its process and the one that speaks ROS for it took, with all their threads.
    """

    cost: Cost
    cpu: float
    late: float


def _answer_lines(clock: MeteredClock, loop: Loop, pids: list[int]) -> None:
    """Answer standard input beside the loop, and stop that."""

    def now() -> tuple[int, float, float, int]:
        return len(clock.taken_ns), cpu_s(pids), time.monotonic(), loop.counters.late

    while not clock.taken_ns:
        time.sleep(_LOOK_S)
    begun = now()
    for line in sys.stdin:
        match line.strip():
            case "begin":
                begun = now()
            case "end":
                ended = now()
                cycles, used_s, clock_s, late = (after - before for after, before in zip(ended, begun, strict=True))
                cost = cost_of(clock.taken_ns[begun[0] : ended[0]])
                found = RobotCost(cost=cost, cpu=used_s / clock_s, late=late / cycles)
                _answer(msgspec.json.encode(found).decode())
                break
        _answer("yes")
    loop.stop("it was requested")


def main() -> int:
    """Run it until `end`."""
    parser = argparse.ArgumentParser()
    add_robot(parser)
    add_namespace(parser)
    parser.add_argument("--log", type=Path, required=True)
    options = parser.parse_args()
    clock = MeteredClock(RealClock())
    robot = build_robot(robot_file(options), clock)
    recorder = ProcessRecorder(options.log, layout_of(robot))
    with contextlib.closing(RosBridge()) as bridge:
        loop = robot.loop(RemoteStage(bridge, robot, options.namespace), recorder)
        beside = clock, loop, [os.getpid(), bridge.pid]
        threading.Thread(target=_answer_lines, args=beside, daemon=True).start()
        with real_time():
            loop.run()
    return 0


def _answer(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
