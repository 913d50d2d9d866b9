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
    """What a robot cost.

    Attributes:
        cost: Of a cycle.
        cpu: Share of one core that its process and the one that speaks ROS for it took, with all their threads.
        late: Share of the cycles that began late.
    """

    cost: Cost
    cpu: float
    late: float


class _CommandThread(threading.Thread):
    """Answers lines beside the loop."""

    def __init__(self, clock: MeteredClock, loop: Loop, pids: list[int]) -> None:
        super().__init__(daemon=True)
        self._clock, self._loop, self._pids = clock, loop, pids

    def run(self) -> None:
        while not self._clock.taken_ns:
            time.sleep(_LOOK_S)
        begun = self._now()
        for line in sys.stdin:
            match line.strip():
                case "begin":
                    begun = self._now()
                case "end":
                    _answer(msgspec.json.encode(self._cost_since(begun)).decode())
                    break
            _answer("yes")
        self._loop.stop("it was requested")

    def _now(self) -> tuple[int, float, float, int]:
        return len(self._clock.taken_ns), cpu_s(self._pids), time.monotonic(), self._loop.counters.late

    def _cost_since(self, begun: tuple[int, float, float, int]) -> RobotCost:
        ended = self._now()
        cycles, cpu_s, clock_s, late = (after - before for after, before in zip(ended, begun, strict=True))
        cost = cost_of(self._clock.taken_ns[begun[0] : ended[0]])
        return RobotCost(cost=cost, cpu=cpu_s / clock_s, late=late / cycles)


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
        _CommandThread(clock, loop, [os.getpid(), bridge.pid]).start()
        with real_time():
            loop.run()
    return 0


def _answer(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
