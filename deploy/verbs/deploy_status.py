"""`segway-ecc deploy status HOST`: the releases on a robot, and how the last update ended."""

import argparse
import sys

from segway_ecc.deploy.release.requests import status
from segway_ecc.deploy.release.screen import screen
from segway_ecc.deploy.verbs.deploy_options import add_host, connection, paths, values
from segway_ecc.node.cli.options import print_json


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy status`."""
    add_host(parser)
    parser.add_argument("--verify", action="store_true", help="compare every file with its hash")


def run(options: argparse.Namespace) -> int:
    """Ask the robot, and print its answer."""
    with connection(options) as host:
        found = values(status(host, paths(options), verify=options.verify))
    if options.json:
        print_json({"host": host.address, **found})
    else:
        sys.stdout.write(screen(host.address, found))
    return 0
