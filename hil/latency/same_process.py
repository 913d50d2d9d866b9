# SPDX-License-Identifier: MIT
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

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.hil.latency.setpoints import Timed, publish_all
from segway_ecc.node.cli.options import add_robot, real_time, robot_file
from segway_ecc.node.cycle.interfaces import Inbox, NoRecorder, NoStage, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.robot import build_robot

_ARMED_S: Final = 1.0


class ThreadStage(NoStage):
    """A stage that hands on the set-points of a thread of this process; see `Stage`."""

    def __init__(self) -> None:
        """Begin without any."""
        self.over: str | None = None
        self._sent: deque[float] = deque(maxlen=10)  # its ends are safe against each other without a lock

    def send(self, velocity: float) -> None:
        """Send a set-point, m/s; from any thread."""
        self._sent.append(velocity)

    def take_inbox(self) -> Inbox:
        """The set-points since the last cycle."""
        inbox = Inbox()
        while self._sent:
            inbox.setpoints.append(StampedSetpoint(Setpoint(self._sent.popleft(), 0.0), None))
        return inbox


def main() -> int:
    """Run the robot until all are sent."""
    parser = argparse.ArgumentParser()
    add_robot(parser)
    parser.add_argument("count", type=int)
    options = parser.parse_args()
    robot = build_robot(robot_file(options), RealClock())
    stage = ThreadStage()
    published: list[Timed] = []

    def publish() -> None:
        time.sleep(_ARMED_S)
        published.extend(publish_all(options.count, robot.model.step_size, stage.send))
        time.sleep(_ARMED_S)
        stage.over = "all set-points are sent"

    publishing = threading.Thread(target=publish)
    publishing.start()
    with real_time():
        robot.loop(stage, NoRecorder()).run()
    publishing.join()
    sys.stdout.write(msgspec.json.encode(published).decode() + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
