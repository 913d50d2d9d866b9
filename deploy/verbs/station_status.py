# SPDX-License-Identifier: MIT
"""`segway-ecc station status`: how the robots on the ROS network are, on one screen.

Exit codes besides the general ones: 0 a robot was found and none is in FAULT; 6 none was found; 7 one fell silent while
it was looked at; 10 one is in FAULT.
"""

import argparse
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from segway_ecc.deploy.station.ros_bridge import ros_network
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import FleetView, RobotView
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, check_seconds, print_found, stopped_by_signals
from segway_ecc.node.cycle.report import state_text
from segway_ecc.node.errors import AbandonedError, NobodyListensError, RobotLostError
from segway_ecc.node.ros.runtime import discovery_text
from segway_ecc.node.safety.modes import STOPPED, Mode

FAULT: Final = 10
_LOOK_EVERY_S: Final = 0.05
_SETTLED_S: Final = 4.0
"""Without a new robot for this long all are taken to be found: what Fast DDS lost it repeats after 3 s."""
_LONGEST_S: Final = 3600.0
_NONE: Final = "-"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `station status`."""
    add_json(parser)
    parser.add_argument(
        "--wait", type=float, default=10.0, metavar="S", help="look for at most this long (default: 10)"
    )


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Look at the robots and show them."""
    check_seconds(options, "wait", _LONGEST_S)
    stop: list[str] = []
    with (
        stopped_by_signals(stop.append),
        Station("status", partial(ros_network, options.ros_arguments), is_watching=True) as station,
    ):
        fleet = _look(station.fleet, options.wait, stop)
    if not fleet.robots:
        raise NobodyListensError(
            f"no robot was found within {options.wait:g} s ({discovery_text()}); start one with: segway-ecc run ROBOT"
        )
    print_found(options, msgspec.to_builtins(fleet), "\n".join(screen(robot) for robot in fleet.robots))
    return exit_code(fleet)


def exit_code(fleet: FleetView) -> int:
    """What the robots amount to; a fault before a silence."""
    if any(robot.mode == Mode.FAULT for robot in fleet.robots):
        return FAULT
    return 0 if all(robot.is_alive for robot in fleet.robots) else RobotLostError.exit_code


def screen(robot: RobotView) -> str:
    """One robot as lines of text."""
    rows = {
        "mode": f"{state_text(robot.mode, robot.posture)}: {robot.reason}",
        **_way_back(robot),
        "received": f"{robot.age_s:.2f} s ago" + ("" if robot.is_alive else ", LOST: what it last was is shown"),
        "tilt": _number(robot.pitch, "deg", math.degrees),
        "velocity": _pair(robot.linear_velocity, robot.angular_velocity),
        "set-point": _pair(robot.linear_setpoint, robot.angular_setpoint),
        "drives": (robot.drives or _NONE) + {True: ", commands zero", False: ", commanded", None: ""}[robot.is_zero],
        "battery": _number(robot.supply_v, "V"),
        **{
            f"link {name}": ", ".join(f"{key} {text}" for key, text in values.items())
            for name, values in robot.links.items()
        },
        **{f"timing {name}": text for name, text in robot.timing.items()},
        **{f"check {name}": text for name, text in robot.checklist.items()},
    }
    width = max(map(len, rows))
    lines = [f"  {_shown(name):<{width}}  {_shown(text)}\n" for name, text in rows.items()]
    return f"{_shown(robot.robot)}  {_shown(robot.name)}\n{''.join(lines)}"


def _way_back(robot: RobotView) -> dict[str, str]:
    """The commands that bring back a robot that an operator stopped."""
    if robot.mode != Mode.FAULT or robot.reason != STOPPED:
        return {}
    return {"way back": f"clear_fault, then {'stand_up' if robot.posture else 'arm'}"}


def _look(fleet: Callable[[], FleetView], wait_s: float, stop: list[str]) -> FleetView:
    """The picture once nothing new is to be expected, or when the time is over."""
    deadline_s, count, since_s = time.monotonic() + wait_s, 0, time.monotonic()
    while time.monotonic() < deadline_s:
        picture = fleet()
        if len(picture.robots) != count:
            count, since_s = len(picture.robots), time.monotonic()
        if picture.is_settled and time.monotonic() - since_s > _SETTLED_S:
            return picture
        if stop:
            raise AbandonedError(f"abandoned by {stop[0]} while looking for robots")
        time.sleep(_LOOK_EVERY_S)
    return fleet()


def _pair(linear: float | None, angular: float | None) -> str:
    return _NONE if linear is None or angular is None else f"{linear:+.3f} m/s  {angular:+.3f} rad/s"


def _number(value: float | None, unit: str, into: Callable[[float], float] = float) -> str:
    return _NONE if value is None else f"{into(value):.2f} {unit}"


def _shown(text: str) -> str:
    """A text of the network without what would command a terminal."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
