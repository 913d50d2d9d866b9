# SPDX-License-Identifier: MIT
"""`segway-ecc deploy doctor [ROBOT]`: is this machine fit to run the robot, and how to fix what is not.

Exit codes besides the general ones: 0 fit, warnings or not; 1 not fit.
"""

import argparse
import contextlib
import dataclasses
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.deploy.doctor.check import Finding, Probes, System, Verdict, Workload, is_fit
from segway_ecc.deploy.doctor.doctor import examine
from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.node.cli.options import add_json, add_lines, default_log, model_failures, print_found, robot_file
from segway_ecc.node.config import ModelSection, packaged_robots
from segway_ecc.node.models.load import load_model
from segway_ecc.node.recording.log_quota import LogQuota
from segway_ecc.node.watchdog.apart import EndedError, run_apart
from segway_ecc.node.watchdog.watchdog import model_watchdog

NOT_FIT: Final = 1
_INSTALLED_ROBOT: Final = Path("/etc/segway-ecc/robot.yaml")
_INSTALLED_LOGS: Final = Path("/var/log/segway-ecc")
_WIDTH: Final = 120


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy doctor`."""
    names = ", ".join(packaged_robots())
    parser.add_argument(
        "robot", nargs="?", help=f"a robot file, or one of {names} (default: {_INSTALLED_ROBOT}, where it is there)"
    )
    add_lines(parser)
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="where logs go, instead of the usual folder")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Look at the machine, and print what was found."""
    if options.robot is None and _INSTALLED_ROBOT.exists():
        options.robot = str(_INSTALLED_ROBOT)
    file = None if options.robot is None else robot_file(options)
    # Logs go where the service writes them, where that folder is there.
    usual = _INSTALLED_LOGS if _INSTALLED_LOGS.is_dir() else default_log("").parent
    workload = Workload((options.logs or usual).absolute(), LogQuota().total_bytes, file)
    if file is not None:
        with contextlib.suppress(EndedError):  # which the check of the robot file finds
            period_ns = run_apart(lambda: _period_ns(file.model))
            workload = dataclasses.replace(workload, period_ns=period_ns)
    findings = examine(System(Probes(_show_progress)), workload)
    _show_progress(1.0)
    name = None if file is None else file.name
    document = {"robot": name, "fit": is_fit(findings), "findings": [dataclasses.asdict(f) for f in findings]}
    print_found(options, document, report(name, findings))
    return 0 if is_fit(findings) else NOT_FIT


def _period_ns(model: ModelSection) -> int:
    with model_failures(model.source), model_watchdog(model.source):
        loaded = load_model(model.source, model.parameters, method=model.method, step_size=model.step_size)
    return round(loaded.step_size * NS_PER_S)


def report(robot: str | None, findings: Sequence[Finding]) -> str:
    """The findings for people, and the sum of them in the last line."""
    width = max(len(finding.name) for finding in findings)
    margin = " " * (len("warning") + 2 + width + 2)
    lines = []
    for finding in findings:
        # Commands are not broken, so that they can be copied.
        found = textwrap.wrap(finding.found, max(_WIDTH - len(margin), 40), break_long_words=False) or [""]
        if finding.verdict is not Verdict.GOOD:
            found += [f"so: {finding.effect}", f"do: {finding.remedy}"]
        lines.append(f"{finding.verdict:<7}  {finding.name:<{width}}  {found[0]}")
        lines += [margin + line for line in found[1:]]
    counts = {verdict: sum(finding.verdict is verdict for finding in findings) for verdict in Verdict}
    fit = "fit" if is_fit(findings) else "not fit"
    what = "a robot" if robot is None else f"'{robot}'"
    total = ", ".join(f"{counts[verdict]} {verdict}" for verdict in (Verdict.BAD, Verdict.WARNING, Verdict.GOOD))
    return "\n".join([*lines, f"{fit} to run {what}: {total}", ""])


def _show_progress(fraction: float) -> None:
    """On a terminal only, in one line that is wiped in the end."""
    if sys.stderr.isatty():
        text = f"segway-ecc: measuring wake-ups, {fraction:.0%}" if fraction < 1.0 else ""
        sys.stderr.write(f"\r{text:<40}" + ("" if text else "\r"))
        sys.stderr.flush()
