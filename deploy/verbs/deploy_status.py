# SPDX-License-Identifier: MIT
"""`segway-ecc deploy status HOST`: the releases on a robot, and how the last update ended."""

import argparse
from collections.abc import Mapping
from typing import Any

from segway_ecc.deploy.release.requests import status
from segway_ecc.deploy.verbs.deploy_options import add_host, connection
from segway_ecc.node.cli.options import print_found


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
