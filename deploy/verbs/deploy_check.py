# SPDX-License-Identifier: MIT
"""`segway-ecc deploy check ROBOT`: whether a robot file loads here, with its model, and is safe; no bus is opened.

Exit codes besides the general ones: 0 it may run, warnings or not; 2 it must not.
"""

import argparse
import dataclasses
import sys

from segway_ecc.deploy.doctor.check import Verdict, is_fit
from segway_ecc.deploy.doctor.robot_file import examine_file
from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.node.cli.options import add_json, add_robot, model_failures, print_found, robot_file
from segway_ecc.node.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy check`."""
    add_robot(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Load the robot file and its model, and look for what is unsafe in it."""
    file = robot_file(options)
    with model_failures(file.model.source):
        robot, findings = examine_file(file)
    for finding in findings:
        what = "refused" if finding.verdict is Verdict.BAD else "warning"
        line = f"{what}: {finding.name}: {finding.found}; so: {finding.effect}; do: {finding.remedy}"
        sys.stderr.write(f"segway-ecc: {line}\n")
    rate_hz, may_run = NS_PER_S / robot.period_ns, is_fit(findings)
    text = f"{file.name} loads, and runs at {rate_hz:g} Hz\n" if may_run else f"{file.name} must not run\n"
    listed = [dataclasses.asdict(finding) for finding in findings]
    print_found(options, {"robot": file.name, "rate_hz": rate_hz, "findings": listed}, text)
    return 0 if may_run else ConfigurationError.exit_code
