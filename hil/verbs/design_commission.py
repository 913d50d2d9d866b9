# SPDX-License-Identifier: MIT
"""`segway-ecc design commission ROBOT`: the first hour with a real robot, step by step, and the report of it."""

import argparse
import sys
from pathlib import Path

import msgspec

from segway_ecc.hil.commission.commission import commission, passes, write_report
from segway_ecc.hil.commission.miswiring import ERRORS
from segway_ecc.hil.commission.person import TerminalPerson
from segway_ecc.hil.commission.simulated import SimulatedSite
from segway_ecc.hil.commission.site import RealSite, Workplace
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.cli.options import (
    add_json,
    add_robot,
    lines_of,
    output_file,
    print_found,
    real_time,
    robot_file,
    stopped_by_signals,
)
from segway_ecc.node.commissioning import CommissioningReport, report_path
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `commission`."""
    add_robot(parser)
    parser.add_argument("--out", metavar="FILE", help="the report (default: beside the robot file, where run looks)")
    parser.add_argument("--simulated", action="store_true", help="a simulated robot and person, in lock step")
    parser.add_argument("--error", metavar="NAME", help="with --simulated: wire or mount it wrongly; 'list' names them")
    parser.add_argument(
        "--kill", action="store_true", help="with --simulated: run its node too, in real time, and kill that"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Go through the steps and write the report; 1 where it does not pass."""
    if options.error == "list":
        print_found(options, list(ERRORS), "".join(f"{name}\n" for name in ERRORS))
        return 0
    file = load_robot(options.robot)  # the report holds for the file, on whichever bus the command line names
    site = _site(options)
    path = None
    if options.out is not None or not options.simulated:
        path = output_file(str(options.out or report_path(options.robot)))
    with messages():
        if options.simulated:
            report = commission(file, site)
        else:
            with stopped_by_signals(_Interrupt()), real_time():
                report = commission(file, site)
    if path is not None:
        write_report(report, path)
    print_found(options, msgspec.to_builtins(report), _text(report, path))
    return 0 if passes(report) else 1


def _site(options: argparse.Namespace) -> Workplace:
    if options.simulated:
        if options.error is not None and options.error not in ERRORS:
            raise ConfigurationError(f"--error: there is no '{options.error}'; --error list names them")
        error = None if options.error is None else ERRORS[options.error]
        killed = options.robot if options.kill else None
        return SimulatedSite(robot_file(options), error, lambda line: print(line, file=sys.stderr, flush=True), killed)
    for name in ("error", "kill"):
        if getattr(options, name):
            raise ConfigurationError(f"--{name} is of a simulated robot: add --simulated")
    words = [options.robot, *lines_of(options)]
    return RealSite(robot_file(options), TerminalPerson(sys.stdin.fileno(), sys.stderr), words)


class _Interrupt:
    """Ends what runs at once, by way of all that sends zero and switches off, which a second signal does not end."""

    def __init__(self) -> None:
        self._came = False

    def __call__(self, reason: str) -> None:
        """Called on a signal."""
        if not self._came:
            self._came = True
            raise KeyboardInterrupt(reason)


def _text(report: CommissioningReport, path: Path | None) -> str:
    lines = aligned([("step", "verdict", "found"), *((s.step, s.verdict, s.text) for s in report.steps)])
    lines.append(f"{'commissioned' if passes(report) else 'NOT commissioned'}" + (f": {path}" if path else ""))
    return "".join(f"{line}\n" for line in lines)
