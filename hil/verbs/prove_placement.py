# SPDX-License-Identifier: MIT
"""`segway-ecc prove placement`: sequence, balance and supervision, each on the robot or on the base station."""

import argparse
import sys
import time

import msgspec

from segway_ecc.hil.placement.grid import ROBOT, TORQUE_ROBOT, conduct, quick, whole
from segway_ecc.hil.placement.report import render
from segway_ecc.hil.placement.results import network_names, overall, recommended, text
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.design_gains import designed
from segway_ecc.hil.verbs.proofs import add_count, add_study, check_counts, claims_out, write_report
from segway_ecc.node.cli.options import print_found
from segway_ecc.node.config import load_robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `prove placement`."""
    add_count(parser, "jobs")
    add_study(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Conduct the study, print its tables and write its report; 1 where no placement is fit."""
    check_counts(options, "jobs")
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
        facts = {
            "Robot": f"{ROBOT}; the delay also with {TORQUE_ROBOT}",
            "Grid": f"{len(plan.placements)} placements on {len(plan.networks)} networks",
            "Time": f"{took_s:.1f} s in {options.jobs} processes",
        }
        return {"placement.html": render(found, facts)}

    write_report(options.out, "placement", document, draw)
    print_found(options, document, text(found))
    sys.stderr.write(f"segway-ecc: the study took {took_s:.1f} s in {options.jobs} processes\n")
    return 0 if best is not None else 1
