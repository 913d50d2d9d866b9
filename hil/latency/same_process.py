"""A robot and its publisher in one process: arguments ROBOT COUNT [CHANNEL OPTIONS].

A thread puts the set-points into the loop's own stage; prints when each was put there, as JSON.
"""

import argparse
import sys
import threading
import time
from collections import deque
from typing import Final

import msgspec

from segway_ecc.hil.latency.result import Timed
from segway_ecc.hil.latency.saying import say_all
from segway_ecc.node.cli.options import add_robot, real_time, robot_file
from segway_ecc.node.cycle.clock import RealClock
from segway_ecc.node.cycle.interfaces import Inbox, NoRecorder, NoStage, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.robot import build_robot

_ARMED_S: Final = 1.0


class HandedStage(NoStage):
    """A world that hands on what a thread of this process says; see `Stage`."""

    def __init__(self) -> None:
        """Nothing was said yet."""
        self.over: str | None = None
        self._said: deque[float] = deque(maxlen=10)  # its ends are safe against each other without a lock

    def say(self, velocity: float) -> None:
        """Say a set-point, m/s; from any thread."""
        self._said.append(velocity)

    def take_inbox(self) -> Inbox:
        """What was said since the last cycle."""
        inbox = Inbox()
        while self._said:
            inbox.setpoints.append(StampedSetpoint(Setpoint(self._said.popleft(), 0.0), None))
        return inbox


def main() -> int:
    """Run the robot until all is said."""
    parser = argparse.ArgumentParser()
    add_robot(parser)
    parser.add_argument("count", type=int)
    options = parser.parse_args()
    robot = build_robot(robot_file(options), RealClock())
    stage = HandedStage()
    said: list[Timed] = []

    def speak() -> None:
        time.sleep(_ARMED_S)
        said.extend(say_all(options.count, robot.model.step_size, stage.say))
        time.sleep(_ARMED_S)
        stage.over = "all is said"

    speaking = threading.Thread(target=speak)
    speaking.start()
    with real_time():
        robot.loop(stage, NoRecorder()).run()
    speaking.join()
    sys.stdout.write(msgspec.json.encode(said).decode() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
