# SPDX-License-Identifier: MIT
"""`segway-ecc deploy rollback HOST`: take a robot back to an older release.

Exit codes besides the general ones: 6 no connection; 7 the connection was lost, and `deploy status` shows how it ended;
11 the robot refused and runs what it ran; 12 the version was not healthy and the robot went back.
"""

import argparse

from segway_ecc.deploy.release.requests import rollback
from segway_ecc.deploy.verbs.deploy_status import add_host, add_trial, run_update, show_step


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy rollback`."""
    add_host(parser)
    parser.add_argument("--to", metavar="RELEASE", help="to this release instead; see deploy status")
    add_trial(parser)


def run(options: argparse.Namespace) -> int:
    """Go back, and wait until the release is healthy."""
    return run_update(options, lambda host, rules: rollback(host, rules, options.to, show_step))
