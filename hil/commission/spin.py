# SPDX-License-Identifier: MIT
"""A process that turns the left wheel slowly, to be killed: arguments as `run` has them; it prints once it turns."""

import argparse
import sys

from segway_ecc.hil.commission.person import Answer, Task
from segway_ecc.hil.commission.safety_steps import turn
from segway_ecc.hil.commission.site import RealSite
from segway_ecc.node.cli.options import add_robot, robot_file

_TURNS_S = 20.0


class _Nobody:
    """Is asked nothing; see `Person`."""

    def begin(self, task: Task) -> None:
        """Nobody is told."""

    def answer(self) -> Answer:
        """Nothing can be done."""
        return Answer.CANNOT

    def read(self, line: str) -> None:
        """Nobody reads."""


def main() -> int:
    """Turn the wheel until killed, for 20 s at the most."""
    parser = argparse.ArgumentParser()
    add_robot(parser)
    site = RealSite(robot_file(parser.parse_args()), _Nobody(), ())
    with site.session() as session, session.driving():
        wanted = turn(session, "left")
        sys.stdout.write("turns\n")
        sys.stdout.flush()
        session.record(_TURNS_S, wanted, lambda sensors: bool(sensors.faults) or session.too_fast())
    return 0


if __name__ == "__main__":
    sys.exit(main())
