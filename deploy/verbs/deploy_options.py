# SPDX-License-Identifier: MIT
"""What the verbs that update a robot over ssh share: options, progress, and how an update ended."""

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from segway_ecc.deploy.release.agent.update import Rules
from segway_ecc.deploy.release.host import ROBOT_CONFIG, ROOT, Event, Host, UpdateFailedError
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.errors import ConfigurationError

_LONGEST_S: Final = 3600.0
_MOST_KEPT: Final = 1000
_ENDINGS: Final = {
    "already": "{release} is in use and healthy already",
    "healthy": "{release} is in use and healthy",
    "went-back": "{release} was not healthy: {reason}; the robot went back to {current}",
    "no-way-back": "{release} is not healthy: {reason}; it stays, since there is no healthy release to go back to",
}


def add_host(parser: argparse.ArgumentParser) -> None:
    """The robot, and the way to it."""
    parser.add_argument("host", help="the robot as ssh knows it: HOST, USER@HOST, or a name of ~/.ssh/config")
    parser.add_argument("--sudo", action="store_true", help="become root there by sudo, which must not ask")
    parser.add_argument("--ssh-config", type=Path, metavar="FILE", help="ssh configuration instead of ~/.ssh/config")
    parser.add_argument("--root", default=ROOT, help="where releases lie there (default: %(default)s)")
    parser.add_argument("--config", default=ROBOT_CONFIG, help="where robot.yaml lies there (default: %(default)s)")
    add_json(parser)


def add_trial(parser: argparse.ArgumentParser) -> None:
    """How a version proves healthy there."""
    parser.add_argument("--trial", type=float, default=10.0, metavar="S", help="must be healthy for so long (10)")
    parser.add_argument("--start", type=float, default=30.0, metavar="S", help="may take so long until it is (30)")
    parser.add_argument("--keep", type=int, default=3, metavar="N", help="how many of the newest releases stay (3)")
    parser.add_argument("--restart", default="", metavar="COMMAND", help="restarts the services instead of systemctl")


def connection(options: argparse.Namespace) -> Host:
    """The robot, to be used as a context manager."""
    return Host(
        options.host, config=options.ssh_config, sudo=options.sudo, root=options.root, robot_config=options.config
    )


def rules(options: argparse.Namespace) -> Rules:
    """How a version proves healthy; the command as words, since no shell will see it.

    Raises:
        ConfigurationError: A figure is out of its range, or the command cannot be split.
    """
    for name in ("trial", "start"):
        if not 0.0 < getattr(options, name) <= _LONGEST_S:
            raise ConfigurationError(f"--{name} must be more than 0 s and at most {_LONGEST_S:g} s")
    if not 1 <= options.keep <= _MOST_KEPT:
        raise ConfigurationError(f"--keep must be 1 to {_MOST_KEPT}")
    try:
        return Rules(options.trial, options.start, options.keep, shlex.split(options.restart))
    except ValueError as error:
        raise ConfigurationError(f"--restart: {error}") from None


def show_step(event: Event) -> None:
    """Print one step of an update as it begins."""
    if event["event"] == "step":
        sys.stderr.write(f"{event['step']}\n")


def run_update(options: argparse.Namespace, change: Callable[[Host, Rules], Event]) -> int:
    """Have the robot change its release, print how that ended, and return 0.

    Raises:
        UpdateFailedError: The version is not healthy.
    """
    with connection(options) as host:
        ended = change(host, rules(options))
    text = f"{options.host}: {_ENDINGS[ended['outcome']].format(**ended)}"
    if options.json:
        print_json({"host": options.host, **ended})
    if ended["outcome"] not in {"already", "healthy"}:
        raise UpdateFailedError(text)
    if not options.json:
        sys.stdout.write(f"{text}\n")
    return 0
