# SPDX-License-Identifier: MIT
"""`segway-ecc prove floor`: a balancing robot on floors, slopes and obstacles, pushed, and unlike what it is told."""

import argparse
import sys
import time
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.floor.contact import on_floor
from segway_ecc.hil.floor.run import Ending, FloorRun, run_floor_trials
from segway_ecc.hil.floor.trials import FloorTrial, all_trials, listed_trials
from segway_ecc.hil.floor.trials_report import Before, as_document, as_text, before_of, draw
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.hil.verbs.design_gains import segway_parameters
from segway_ecc.hil.verbs.proofs import add_count, add_packaged_robot, check_counts, claims_out, write_report
from segway_ecc.node.cli.options import add_json, output_folder, print_found
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.errors import ConfigurationError

_ROBOT: Final = "segway"
_SEEDS: Final = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `floor`."""
    add_packaged_robot(parser, _ROBOT)
    add_count(parser, "jobs")
    parser.add_argument("--seeds", type=int, default=_SEEDS, metavar="N", help="of each trial (default: %(default)s)")
    parser.add_argument("--only", metavar="TEXT", default="", help="only trials with this in their name or kind")
    parser.add_argument("--listed", action="store_true", help="only those that the documentation lists")
    parser.add_argument(
        "--before", type=Path, metavar="FILE", help="the floor.json of an earlier run, to be shown beside this one"
    )
    parser.add_argument("--out", type=output_folder, metavar="FOLDER", help="write floor.json there, and floor.png")
    add_json(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Make the trials and print the tables: 0 where each run stands or ends safe, 1 where one is BROKEN."""
    check_counts(options, "jobs", "seeds")
    before = {} if options.before is None else _read(options.before)
    robot = load_robot(options.robot)
    file = on_floor(robot)
    trials = _selected(file, options)
    runs = [FloorRun(options.robot, trial, seed) for trial in trials for seed in range(1, options.seeds + 1)]
    begun_s = time.monotonic()
    with show_progress("trials", len(runs)) as on_progress:
        results = run_floor_trials(runs, min(options.jobs, len(runs)), on_progress)
    plant = simulated_plant(file).name
    document = {"plant": plant, "seeds": options.seeds, **as_document(results, before)}
    conditions = (
        f"plant {plant}: wheels slip; friction 0.8 where nothing else is given; {options.seeds} seeds of each\n"
    )
    print_found(options, msgspec.to_builtins(document), conditions + as_text(results, before))
    title = f"{robot.name} on a floor: {len(runs)} trials on {plant}"
    write_report(options.out, "floor", document, lambda: draw(results, title))
    broken = [result for result in results if result.ending is Ending.BROKEN]
    for result in broken:
        sys.stderr.write(f"segway-ecc: BROKEN: {result.trial}, seed {result.seed}: {result.reason}\n")
    sys.stderr.write(f"segway-ecc: {len(runs)} trials in {time.monotonic() - begun_s:.0f} s\n")
    return 1 if broken else 0


def _selected(file: RobotFile, options: argparse.Namespace) -> list[FloorTrial]:
    """The trials that are asked for.

    Raises:
        ConfigurationError: There is none.
    """
    body = segway_parameters(file)
    trials = listed_trials(body) if options.listed else all_trials(body)
    found = [trial for trial in trials if options.only in trial.name or options.only in trial.kind]
    if not found:
        kinds = ", ".join(dict.fromkeys(trial.kind for trial in trials))
        raise ConfigurationError(f"no trial has '{options.only}' in its name or kind; the kinds are {kinds}")
    return found


def _read(path: Path) -> Before:
    """An earlier run.

    Raises:
        ConfigurationError: It cannot be read, or is none.
    """
    try:
        return before_of(msgspec.json.decode(path.read_bytes(), type=dict[str, object]))
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror}") from error
    except (msgspec.DecodeError, KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(f"{path} is no floor.json of `segway-ecc prove floor --out`") from error
