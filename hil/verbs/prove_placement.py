# SPDX-License-Identifier: MIT
"""`segway-ecc prove placement`: sequence, balance and supervision, each on the robot or on the base station."""

import argparse
import os
import sys
import time
from pathlib import Path

import msgspec

from segway_ecc.hil.placement.grid import ROBOT, TORQUE_ROBOT, conduct, quick, whole
from segway_ecc.hil.placement.results import network_names, overall, recommended
from segway_ecc.hil.placement.table import text
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.design_gains import designed
from segway_ecc.hil.verbs.report_folder import make_folder, write_report
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `prove placement`."""
    cores = len(os.sched_getaffinity(0))
    parser.add_argument("--quick", action="store_true", help="a part of it, in some seconds")
    parser.add_argument(
        "--jobs",
        type=int,
        default=cores,
        metavar="N",
        help="processes at a time (default: cores)",
    )
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write the report there, and what was found as JSON")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Conduct the study, print its tables and write its report; 1 where no placement is fit."""
    if options.jobs < 1:
        raise ConfigurationError(f"--jobs must be at least 1, not {options.jobs}")
    if options.out is not None:
        make_folder(options.out)
    margins_s = {name: designed(load_robot(name)).balance.margins.delay_s for name in (ROBOT, TORQUE_ROBOT)}
    plan = (quick if options.quick else whole)(margins_s)
    begun_s = time.monotonic()
    with show_progress("study") as on_progress:
        found = conduct(plan, options.jobs, on_progress)
    took_s = time.monotonic() - begun_s
    chosen = {name: recommended(found, name) for name in network_names(found)}
    best = overall(found)
    document = {
        "recommended": None if best is None else best._asdict(),
        "recommended_by_network": {name: None if c is None else c._asdict() for name, c in chosen.items()},
        **msgspec.to_builtins(found),
    }

    def draw() -> dict[str, str | bytes]:
        from segway_ecc.hil.placement.report import render  # noqa: PLC0415 - an extra that the rest of this verb does without

        facts = {
            "Robot": f"{ROBOT}; the delay also with {TORQUE_ROBOT}",
            "Grid": f"{len(plan.placements)} placements on {len(plan.networks)} networks",
            "Time": f"{took_s:.1f} s in {options.jobs} processes",
        }
        return {"placement.html": render(found, facts)}

    if options.out is not None:
        write_report(options.out, "placement", document, draw)
    if options.json:
        print_json(document)
    else:
        sys.stdout.write(text(found))
    sys.stderr.write(f"segway-ecc: the study took {took_s:.1f} s in {options.jobs} processes\n")
    return 0 if best is not None else 1
