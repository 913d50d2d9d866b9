"""`segway-ecc design margins`: how much the balancing robot bears, against what is required of it."""

import argparse
import dataclasses
import math
import sys
from typing import Final

from segway_ecc.hil.design.balance_margins import STEPS, Limit, Tracking, disturbances, find_limit, track
from segway_ecc.hil.verbs.design_gains import segway_parameters
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.config import load_robot

ROBOT: Final = "segway"
_SEEDS: Final = 3
_WIDTHS: Final = (28, 12, 12, 6, 8)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `margins`."""
    parser.add_argument("robot", nargs="?", default=ROBOT, help="a robot file, or the name of a packaged robot")
    parser.add_argument(
        "--seeds", type=int, default=_SEEDS, help="runs with other sensor errors (default: %(default)s)"
    )
    parser.add_argument("--only", metavar="TEXT", default="", help="only disturbances whose name begins so")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Search one limit after the other, follow the steps, and print the tables; 1 where one is not enough."""
    file, seeds = load_robot(options.robot), range(1, options.seeds + 1)
    kinds = disturbances(segway_parameters(file))
    limits = [find_limit(file, kind, seeds) for kind in kinds if _is_wanted(kind.name, options.only)]
    tracked = [track(file, step, seeds) for step in STEPS if _is_wanted(step.name, options.only)]
    if options.json:
        print_json({"limits": [_document(limit) for limit in limits], "tracking": [_document(t) for t in tracked]})
    else:
        _print(limits, tracked)
    found: list[Limit | Tracking] = [*limits, *tracked]
    return 0 if all(each.is_enough for each in found) else 1


def _is_wanted(name: str, only: str) -> bool:
    """Whether a name begins as it should; says so."""
    if not name.startswith(only):
        return False
    sys.stderr.write(f"segway-ecc: {name}\n")
    return True


def _document(found: Limit | Tracking) -> dict[str, object]:
    """As JSON has it, which knows no infinity."""
    values = {name: None if value == math.inf else value for name, value in dataclasses.asdict(found).items()}
    return {**values, "is_enough": found.is_enough}


def _print(limits: list[Limit], tracked: list[Tracking]) -> None:
    rows = [("disturbance", "borne", "required", "", ""), *map(_row, limits)] if limits else []
    if tracked:
        rows += [("set-point", "steady error", "required", "", ""), *map(_tracking_row, tracked)]
    sys.stdout.write("".join(map(_line, rows)))


def _row(limit: Limit) -> tuple[str, ...]:
    borne = f"{'more than ' if limit.is_beyond else ''}{limit.borne:.3g}"
    required = "-" if limit.required is None else f"{limit.required:.3g}"
    return limit.name, borne, required, limit.unit, "" if limit.is_enough else "NOT MET"


def _tracking_row(found: Tracking) -> tuple[str, ...]:
    settled = f"settled after {found.settled_s:.2f} s" if math.isfinite(found.settled_s) else "never settled"
    verdict = settled if found.is_enough else f"{settled}, NOT MET"
    return found.name, f"{found.steady_error:.3g}", f"{found.required:.3g}", found.unit, verdict


def _line(row: tuple[str, ...]) -> str:
    return "  ".join(f"{text:<{width}}" for text, width in zip(row, _WIDTHS, strict=True)).rstrip() + "\n"
