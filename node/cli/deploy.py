"""`segway-ecc deploy push|rollback|status HOST`: versions of this software on a robot, over ssh.

Exit codes besides the general ones: 6 no connection; 7 the connection was lost, and `deploy status` tells how it ended;
11 the robot refused and runs what it ran; 12 the version was not healthy and the robot went back.
"""

import argparse
import sys
from pathlib import Path
from typing import Any, Final

import node
from deploy.release.errors import UpdateFailedError
from deploy.release.host import Event, Host
from deploy.release.requests import Content, Place, Trying, push, rollback, status
from deploy.release.robot_files import robot_files
from deploy.release.screen import screen
from node.cli.options import add_json, add_robot, print_json, robot_file
from node.config import packaged_robots
from node.cycle.clock import NS_PER_S, RealClock
from node.errors import ConfigurationError
from node.robot import build_robot

_PACKAGED: Final = Path(node.__file__).parent / "robots"
_LONGEST_S: Final = 3600.0
_MOST_KEPT: Final = 1000
_ENDINGS: Final = {
    "already": "{release} is in use and healthy already",
    "healthy": "{release} is in use and healthy",
    "went-back": "{release} was not healthy: {reason}; the robot went back to {current}",
    "no-way-back": "{release} is not healthy: {reason}; it stays, since there is no healthy release to go back to",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy`."""
    parser.epilog = __doc__.partition("\n\n")[2]
    tasks = parser.add_subparsers(dest="task", metavar="push|rollback|status|check", required=True)
    pushing = tasks.add_parser(
        "push", help="put a version onto a robot, try it there, and go back if it is not healthy"
    )
    _add_host(pushing)
    _add_content(pushing)
    _add_trying(pushing)
    back = tasks.add_parser("rollback", help="take a robot back to the newest older healthy release")
    _add_host(back)
    back.add_argument("--to", metavar="RELEASE", help="to this release instead; see status")
    _add_trying(back)
    looking = tasks.add_parser("status", help="the releases on a robot, and how the last update ended")
    _add_host(looking)
    looking.add_argument("--verify", action="store_true", help="compare every file with its hash")
    checking = tasks.add_parser("check", help="whether a robot file loads here, with its model; no bus is opened")
    add_robot(checking)
    add_json(checking)


def run(options: argparse.Namespace) -> int:
    """Do the task."""
    if options.task == "check":
        return _check(options)
    place = Place(options.root, options.config)
    with Host(options.host, config=options.ssh_config, sudo=options.sudo) as host:
        if options.task == "status":
            return _status(host, place, options)
        if options.task == "push":
            return _end(_push(host, place, options), options)
        return _end(rollback(host, place, _trying(options), options.to, _tell), options)


def _add_host(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("host", help="the robot as ssh knows it: HOST, USER@HOST, or a name of ~/.ssh/config")
    parser.add_argument("--sudo", action="store_true", help="become root there by sudo, which must not ask")
    parser.add_argument("--ssh-config", type=Path, metavar="FILE", help="ssh configuration instead of ~/.ssh/config")
    parser.add_argument("--root", default=Place().root, help="where releases lie there (default: %(default)s)")
    parser.add_argument("--config", default=Place().config, help="where robot.yaml lies there (default: %(default)s)")
    add_json(parser)


def _add_content(parser: argparse.ArgumentParser) -> None:
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


def _add_trying(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--trial", type=float, default=10.0, metavar="S", help="must be healthy for so long (10)")
    parser.add_argument("--start", type=float, default=30.0, metavar="S", help="may take so long until it is (30)")
    parser.add_argument("--keep", type=int, default=3, metavar="N", help="how many of the newest releases stay (3)")
    parser.add_argument("--restart", default="", metavar="COMMAND", help="restarts the services instead of systemctl")


def _trying(options: argparse.Namespace) -> Trying:
    for name in ("trial", "start"):
        if not 0.0 < getattr(options, name) <= _LONGEST_S:
            raise ConfigurationError(f"--{name} must be more than 0 s and at most {_LONGEST_S:g} s")
    if not 1 <= options.keep <= _MOST_KEPT:
        raise ConfigurationError(f"--keep must be 1 to {_MOST_KEPT}")
    return Trying(options.trial, options.start, options.keep, options.restart)


def _push(host: Host, place: Place, options: argparse.Namespace) -> Event:
    robot = None
    if options.robot is not None:
        loaded = argparse.Namespace(robot=options.robot, interface=None, channel=None, serial=None)
        build_robot(robot_file(loaded), RealClock())
        robot = robot_files(_path_of(options.robot), robot_file(loaded))
    content = Content(options.wheel, robot, options.extra, options.ros, options.refresh, options.again)
    return push(host, place, _trying(options), content, _tell)


def _path_of(robot: str) -> Path:
    return _PACKAGED / f"{robot}.yaml" if robot in packaged_robots() else Path(robot)


def _check(options: argparse.Namespace) -> int:
    file = robot_file(options)
    rate_hz = NS_PER_S / build_robot(file, RealClock()).period_ns
    if options.json:
        print_json({"robot": file.name, "rate_hz": rate_hz})
    else:
        sys.stdout.write(f"{file.name} loads, and runs at {rate_hz:g} Hz\n")
    return 0


def _status(host: Host, place: Place, options: argparse.Namespace) -> int:
    found = _plain(status(host, place, verify=options.verify))
    if options.json:
        print_json({"host": host.address, **found})
    else:
        sys.stdout.write(screen(host.address, found))
    return 0


def _end(event: Event, options: argparse.Namespace) -> int:
    ended = _plain(event)
    text = f"{options.host}: {_ENDINGS[ended['outcome']].format(**ended)}"
    if options.json:
        print_json({"host": options.host, **ended})
    if ended["outcome"] not in {"already", "healthy"}:
        raise UpdateFailedError(text)
    if not options.json:
        sys.stdout.write(f"{text}\n")
    return 0


def _plain(event: Event) -> dict[str, Any]:
    return {key: value for key, value in event.items() if key != "event"}


def _tell(event: Event) -> None:
    if event["event"] == "step":
        sys.stderr.write(f"{event['step']}\n")
