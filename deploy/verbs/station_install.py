# SPDX-License-Identifier: MIT
"""`segway-ecc station install`: make this machine a base station, with one command.

It makes the service's user, settings, tokens and service, starts it, and waits until it serves. Run again it changes
what is different; what is not given has its default again. Tokens stay, unless new ones are asked for.
"""

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.installer.install import Plan, commands, install, plan, remove
from segway_ecc.deploy.station.installer.machine import ACCESS, USER, TargetMachine, has_tokens, is_the_service_s
from segway_ecc.deploy.station.installer.settings import DISCOVERY, InstallSettings
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.site_address import SiteAddress, url
from segway_ecc.deploy.verbs.station_serve import PLAIN_HTTP, add_listening, show_tokens
from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.errors import ConfigurationError

_THIS: Final = Path("/")
_DEFAULT: Final = InstallSettings()
_WIREGUARD: Final = "wg-robots"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `station install`."""
    add_json(parser)
    option = parser.add_argument
    option("--domain", type=int, default=_DEFAULT.domain, metavar="N", help="ROS domain (default: %(default)s)")
    option("--peer", action="append", default=[], metavar="NAME", help="a machine that ROS asks, by name or address")
    option("--discovery", choices=DISCOVERY, default="", help="whom ROS finds besides (default: subnet without peers)")
    option("--address", default=_DEFAULT.address, help="where the page is served (default: %(default)s)")
    option("--port", type=int, default=_DEFAULT.port, help="the same (default: %(default)s)")
    option(
        "--firewall",
        nargs="?",
        const=_WIREGUARD,
        metavar="INTERFACE",
        help=f"let ROS and the page be reached through this interface only (default: {_WIREGUARD})",
    )
    add_listening(parser)
    option("--command", metavar="PATH", help="the program that the service runs (default: that of this environment)")
    option("--root", type=Path, metavar="DIR", help="write into a root file system, as of an image; nothing is started")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--dry-run", action="store_true", help="print what would be written and run, and do nothing")
    what.add_argument("--remove", action="store_true", help="take it all away, but for the logs")


def run(options: argparse.Namespace) -> int:
    """Do it."""
    if options.root is not None and not options.root.is_dir():
        raise ConfigurationError(f"--root {options.root} is not a directory")
    machine = TargetMachine(_THIS) if options.root is None else TargetMachine(options.root.resolve(), is_live=False)
    if options.remove:
        _require_root(machine)
        names = remove(machine)
        text = "".join(f"removed {name}\n" for name in names) or "there was nothing\n"
        print_found(options, {"removed": names}, text)
        return 0
    settings = InstallSettings(
        options.domain,
        options.discovery,
        tuple(dict.fromkeys(options.peer)),
        options.address,
        options.port,
        tuple(dict.fromkeys(options.host)),
        _absolute(options.certificate),
        _absolute(options.key),
        options.firewall,
    )
    if not options.dry_run:
        _require_root(machine)
    made = plan(machine, settings, options.command)
    if options.dry_run:
        # Each file with its content, then the commands.
        parts = [f"# {name} (0644, root)\n{text}" for name, text in made.files.items()]
        if options.new_tokens or not has_tokens(machine):
            parts.append(f"# {ACCESS} (0600, {USER})\n# hashes of two new tokens\n")
        parts.append("".join(f"$ {' '.join(words)}\n" for words in commands(made)))
        sys.stdout.write("\n".join(filter(None, parts)))
        return 0
    _install(made, options)
    return 0


def _absolute(path: Path | None) -> Path | None:
    return None if path is None else path.absolute()


def _require_root(machine: TargetMachine) -> None:
    if machine.is_live and not _is_root():
        raise ConfigurationError(f"only root may do this: sudo {Path(sys.argv[0]).absolute()} station install ...")


def _is_root() -> bool:
    return os.geteuid() == 0


def _install(made: Plan, options: argparse.Namespace) -> None:
    kept: dict[Role, str] = {}

    def show(tokens: Mapping[Role, str]) -> None:
        kept.update(tokens)
        show_tokens(tokens)

    changed = install(made, new_tokens=options.new_tokens, show=show)
    place = SiteAddress(made.settings.scheme, made.settings.port)
    page = url(made.settings.address, place)
    if not made.settings.is_loopback and made.settings.certificate is None:
        sys.stderr.write(f"segway-ecc: {PLAIN_HTTP}\n")
    if not is_the_service_s(made.machine):
        sys.stderr.write(
            f"segway-ecc: {ACCESS} has to belong to {USER} there before the station starts: do this as root, with "
            "systemd-sysusers installed here, or chown it\n"
        )
    document = {"open": page, "tokens": {role.value: token for role, token in kept.items()}, "changed": changed}
    rows = {"open": page, "tokens": "new, shown above" if kept else "as before (see --new-tokens)"}
    print_found(options, document, rows)
