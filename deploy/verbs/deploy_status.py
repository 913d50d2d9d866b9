# SPDX-License-Identifier: MIT
"""`segway-ecc deploy status HOST`: the releases there, how the last update ended; and what push shares."""

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from segway_ecc.deploy.release.agent.update import Rules
from segway_ecc.deploy.release.host import ROBOT_CONFIG, ROOT, Event, Host, UpdateFailedError
from segway_ecc.deploy.release.requests import status
from segway_ecc.node.cli.options import add_json, check_seconds, print_found, print_json
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
        check_seconds(options, name, _LONGEST_S)
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
        print_json(options, {"host": options.host, **ended})
    if ended["outcome"] not in {"already", "healthy"}:
        raise UpdateFailedError(text)
    if not options.json:
        sys.stdout.write(f"{text}\n")
    return 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy status`."""
    add_host(parser)
    parser.add_argument("--verify", action="store_true", help="compare every file with its hash")


def run(options: argparse.Namespace) -> int:
    """Ask the robot, and print its answer."""
    with connection(options) as host:
        found = status(host, verify=options.verify)
    print_found(options, {"host": host.address, **found}, screen(host.address, found))
    return 0


def screen(host: str, found: Mapping[str, Any]) -> str:
    """The answer to `status` for people; nothing of it can command a terminal."""
    rows = [f"{host}  {found['current'] or 'no release in use'}"]
    for release in found["releases"]:
        mark = "*" if release["is_current"] else " "
        text = f"  {mark} {release['name']}  {release['state']}  {release['created'][:19]}  {release['by']}"
        notes = [note for note in (release["reason"], release.get("changed", "")) if note]
        rows.append(f"{text}  {'; '.join(notes)}".rstrip())
    rows += [
        f"    {name}  incomplete: an interrupted push; the next push goes on with it" for name in found["incomplete"]
    ]
    node, status = found["node"], found["node"].get("status") or {}
    text = f"{node['active']} {node.get('reason', '')}".rstrip()
    if status:
        blocked = "; ".join(map(str, status.get("blocked_by", ()))) or "nothing"
        text = f"{node['active']}, {status.get('mode')}, {status.get('rate_hz')} Hz, kept from arming by {blocked}"
    rows += [
        f"  a rollback goes to  {found['rollback_to'] or 'nothing: there is no older healthy release'}",
        f"  update              {_update(found)}",
        f"  node                {text}",
    ]
    if found["free_mb"] is not None:
        rows += [f"  free                {found['free_mb']:.0f} MB"]
    return "".join("".join(c if c.isprintable() else "?" for c in row) + "\n" for row in rows)


def _update(found: Mapping[str, Any]) -> str:
    pending, last = found["pending"], found["last"]
    phase = f"{pending['kind']} of {pending['release']} in the phase '{pending['phase']}'" if pending else ""
    if found["is_updating"]:
        return f"under way: {phase or 'nothing is switched yet'}"
    if pending:
        return f"INTERRUPTED: {phase}; settled at the next boot, push or rollback"
    if last is None:
        return "none yet"
    return f"{last['kind']} of {last['release']} {last['ended'][:19]}: {last['outcome']} {last['reason']}".rstrip()
