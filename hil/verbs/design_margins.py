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
from segway_ecc.hil.text_table import aligned
from segway_ecc.hil.verbs.design_gains import segway_parameters
from segway_ecc.hil.verbs.proofs import add_packaged_robot
from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.config import load_robot

ROBOT: Final = "segway"
_SEEDS: Final = 3
_Named = TypeVar("_Named", DisturbanceKind, Step)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `margins`."""
    add_packaged_robot(parser, ROBOT)
    parser.add_argument(
        "--seeds", type=int, default=_SEEDS, help="runs with other sensor errors (default: %(default)s)"
    )
    parser.add_argument("--only", metavar="TEXT", default="", help="only disturbances whose name begins so")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Search one limit after the other, follow the steps, and print the tables; 1 where one is not enough."""
    file, seeds = load_robot(options.robot), range(1, options.seeds + 1)
    kinds = disturbances(segway_parameters(file))
    limits = [find_limit(file, kind, seeds) for kind in _selected(kinds, options.only)]
    tracked = [track(file, step, seeds) for step in _selected(STEPS, options.only)]
    document = {"limits": [_document(limit) for limit in limits], "tracking": [_document(t) for t in tracked]}
    rows = [("disturbance", "limit", "required", "", ""), *map(_row, limits)] if limits else []
    if tracked:
        rows += [("set-point", "steady error", "required", "", ""), *map(_tracking_row, tracked)]
    print_found(options, document, "".join(f"{line}\n" for line in aligned(rows)))
    found: list[Limit | Tracking] = [*limits, *tracked]
    return 0 if all(each.is_enough for each in found) else 1


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
    tolerated = f"{'more than ' if limit.is_beyond else ''}{limit.tolerated:.3g}"
    required = "-" if limit.required is None else f"{limit.required:.3g}"
    return limit.name, tolerated, required, limit.unit, "" if limit.is_enough else "NOT MET"


def _tracking_row(found: Tracking) -> tuple[str, ...]:
    settled = f"settled after {found.settled_s:.2f} s" if math.isfinite(found.settled_s) else "never settled"
    verdict = settled if found.is_enough else f"{settled}, NOT MET"
    return found.name, f"{found.steady_error:.3g}", f"{found.required:.3g}", found.unit, verdict
