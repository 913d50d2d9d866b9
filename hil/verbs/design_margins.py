# SPDX-License-Identifier: MIT
"""`segway-ecc design margins`: the disturbance limits of the balancing robot, against what is required."""

import argparse
import dataclasses
import math
import sys
from collections.abc import Iterator, Sequence
from typing import Final, TypeVar

from segway_ecc.hil.design.balance_margins import (
    STEPS,
    DisturbanceKind,
    Limit,
    Step,
    Tracking,
    disturbances,
    find_limit,
    track,
)
from segway_ecc.hil.floor.contact import LEAST_FRICTION, MOST_FRICTION, is_on_floor, lacks_mujoco, on_floor
from segway_ecc.hil.floor.least_friction import rising_limit
from segway_ecc.hil.floor.margins import FloorLimit, find_floor_limits, searches_of
from segway_ecc.hil.floor.margins_report import beyond_hardware, draw, table
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.rig.simulation import simulated_plant
from segway_ecc.hil.text_table import aligned
from segway_ecc.hil.verbs.design_gains import segway_parameters
from segway_ecc.hil.verbs.proofs import add_count, add_packaged_robot, check_counts, claims_out, write_report
from segway_ecc.node.cli.options import add_json, output_folder, print_found
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.segway_parameters import SegwayParameters
from segway_ecc.node.readable import short

ROBOT: Final = "segway"
_SEEDS: Final = 3
_NO_ERROR: Final = 1e-6
"""Of the error that is allowed: a steady one that is less is rounding."""
_NEVER_SLIPS: Final = "wheels never slip"
_ITS_OWN: Final = "wheels slip, by the friction that the plant has at its start"
_EACH_COLUMN: Final = "wheels slip, by the friction of each column"
_Named = TypeVar("_Named", DisturbanceKind, Step)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `margins`."""
    add_packaged_robot(parser, ROBOT)
    parser.add_argument(
        "--seeds", type=int, default=_SEEDS, help="runs with other sensor errors (default: %(default)s)"
    )
    parser.add_argument("--only", metavar="TEXT", default="", help="only disturbances whose name begins so")
    parser.add_argument(
        "--friction",
        type=float,
        nargs="+",
        default=[],
        metavar="MU",
        help="also on floors of these frictions, such as 0.5 0.6 0.8 1.2, on the plant whose wheels slip",
    )
    add_count(parser, "jobs")
    parser.add_argument("--out", type=output_folder, metavar="FOLDER", help="write margins.json there, and margins.png")
    add_json(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Search one limit after the other, follow the steps, and print the tables; 1 where one is not enough."""
    check_counts(options, "seeds", "jobs")
    file, seeds = load_robot(options.robot), range(1, options.seeds + 1)
    body = segway_parameters(file)
    floor = _floor_limits(file, options, body, seeds)
    limits = [find_limit(file, kind, seeds) for kind in _selected(disturbances(body), options.only)]
    tracked = [track(file, step, seeds) for step in _selected(STEPS, options.only)]
    rising = rising_limit(body)
    document = {
        "plant": simulated_plant(file).name,
        "seeds": options.seeds,
        "limits": [_document(limit) for limit in limits],
        "tracking": [_document(t) for t in tracked],
        "rising": rising._asdict(),
        "floor": [limit._asdict() for limit in floor],
    }
    own = _ITS_OWN if is_on_floor(file) else _NEVER_SLIPS
    rows = [("disturbance", "limit", "required", "", ""), *map(_row, limits)] if limits else []
    if tracked:
        rows += [("set-point", "steady error", "required", "", ""), *map(_tracking_row, tracked)]
    lines = [_conditions(file, own, options.seeds), *(aligned(rows) if rows else [])]
    if floor:
        lines += [
            "",
            _conditions(on_floor(file), _EACH_COLUMN, options.seeds),
            *aligned(table(floor, options.friction)),
        ]
    lines.append(beyond_hardware(rising, body.torque_limit))
    print_found(options, document, "".join(f"{line}\n" for line in lines))
    title = f"Limits of {file.name} against friction, least of {options.seeds} seeds"
    write_report(options.out, "margins", document, lambda: draw(floor, rising.friction, title))
    found: list[Limit | Tracking | FloorLimit] = [*limits, *tracked, *floor]
    return 0 if all(each.is_enough for each in found) else 1


def _floor_limits(
    file: RobotFile, options: argparse.Namespace, body: SegwayParameters, seeds: Sequence[int]
) -> list[FloorLimit]:
    """The limits on floors; none where none are asked for, or MuJoCo is not installed, of which a message tells."""
    wrong = [friction for friction in options.friction if not LEAST_FRICTION <= friction <= MOST_FRICTION]
    if wrong:
        text = f"--friction must be within {LEAST_FRICTION:g} to {MOST_FRICTION:g}, not {wrong[0]:g}"
        raise ConfigurationError(text)
    if options.friction and lacks_mujoco():
        sys.stderr.write(f"segway-ecc: no limits against friction: {lacks_mujoco()}\n")
        return []
    if not options.friction:
        return []
    on_floor(file)
    searches = list(searches_of(options.robot, body, options.friction, seeds, options.only))
    if not searches:
        return []
    with show_progress("limits on floors", len(searches)) as on_progress:
        return find_floor_limits(searches, min(options.jobs, len(searches)), on_progress)


def _conditions(file: RobotFile, wheels: str, seeds: int) -> str:
    """For what the limits below hold."""
    return f"plant {simulated_plant(file).name}: {wheels}; least of {seeds} seeds"


def _selected(kinds: Sequence[_Named], beginning: str) -> Iterator[_Named]:
    for kind in kinds:
        if kind.name.startswith(beginning):
            sys.stderr.write(f"segway-ecc: {kind.name}\n")
            yield kind


def _document(found: Limit | Tracking) -> dict[str, object]:
    """As JSON has it, which knows no infinity."""
    values = {name: None if value == math.inf else value for name, value in dataclasses.asdict(found).items()}
    return {**values, "is_enough": found.is_enough}


def _row(limit: Limit) -> tuple[str, ...]:
    tolerated = f"{'more than ' if limit.is_beyond else ''}{short(limit.tolerated)}"
    required = "-" if limit.required is None else short(limit.required)
    return limit.name, tolerated, required, limit.unit, "" if limit.is_enough else "NOT MET"


def _tracking_row(found: Tracking) -> tuple[str, ...]:
    settled = f"settled after {found.settled_s:.2f} s" if math.isfinite(found.settled_s) else "never settled"
    verdict = settled if found.is_enough else f"{settled}, NOT MET"
    error = short(found.steady_error, _NO_ERROR * found.required)
    return found.name, error, short(found.required), found.unit, verdict
