"""`segway-ecc prove placement`: sequence, balance and supervision, each on the robot or on the base station."""

import argparse
import os
import sys
import time
from pathlib import Path

import msgspec

from segway_ecc.hil.placement.grid import ROBOT, TORQUE_ROBOT, StudyPlan, quick, whole
from segway_ecc.hil.placement.results import StudyResult
from segway_ecc.hil.placement.study import conduct
from segway_ecc.hil.placement.table import text
from segway_ecc.hil.placement.verdict import network_names, overall, recommended
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.design_gains import designed
from segway_ecc.hil.verbs.report_folder import has_figures, make_folder, writing_to
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `prove placement`."""
    parser.add_argument("--quick", action="store_true", help="a part of it, in some seconds")
    parser.add_argument("--jobs", type=int, default=_cores(), metavar="N", help="processes at a time (default: cores)")
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
    document = _document(found)
    if options.out is not None:
        _write(options.out, found, document, _facts(plan, took_s, options.jobs))
    if options.json:
        print_json(document)
    else:
        sys.stdout.write(text(found))
    sys.stderr.write(f"segway-ecc: the study took {took_s:.1f} s in {options.jobs} processes\n")
    return 0 if overall(found) is not None else 1


def _document(found: StudyResult) -> dict[str, object]:
    chosen = {name: recommended(found, name) for name in network_names(found)}
    best = overall(found)
    return {
        "recommended": None if best is None else best._asdict(),
        "recommended_by_network": {name: None if c is None else c._asdict() for name, c in chosen.items()},
        **msgspec.to_builtins(found),
    }


def _facts(plan: StudyPlan, took_s: float, jobs: int) -> dict[str, str]:
    return {
        "Robot": f"{ROBOT}; the delay also with {TORQUE_ROBOT}",
        "Grid": f"{len(plan.placements)} placements on {len(plan.networks)} networks",
        "Time": f"{took_s:.1f} s in {jobs} processes",
    }


def _write(folder: Path, found: StudyResult, document: object, facts: dict[str, str]) -> None:
    with writing_to(folder):
        (folder / "placement.json").write_bytes(msgspec.json.format(msgspec.json.encode(document)))
        if not has_figures():
            return
        from segway_ecc.hil.placement.report import render  # noqa: PLC0415 - an extra that the rest of this verb does without

        (folder / "placement.html").write_text(render(found, facts), encoding="utf-8")
    sys.stderr.write(f"segway-ecc: report: {folder / 'placement.html'}\n")


def _cores() -> int:
    return len(os.sched_getaffinity(0))
