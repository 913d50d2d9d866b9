"""`segway-ecc margins`: how much the balancing robot bears, against what is required of it."""

import argparse
import dataclasses
import sys
from typing import Final

from node.case_study.balance_margins import Limit, disturbances, find_limit
from node.cli.design import segway_parameters
from node.cli.options import add_json, print_json
from node.config import load_robot

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
    """Search one limit after the other, and print the table; 1 where one is not enough."""
    file = load_robot(options.robot)
    kinds = [kind for kind in disturbances(segway_parameters(file)) if kind.name.startswith(options.only)]
    limits = []
    for kind in kinds:
        sys.stderr.write(f"segway-ecc: {kind.name}\n")
        limits.append(find_limit(file, kind, range(1, options.seeds + 1)))
    if options.json:
        print_json({"limits": [{**dataclasses.asdict(limit), "is_enough": limit.is_enough} for limit in limits]})
    else:
        sys.stdout.write("".join(map(_line, [("disturbance", "borne", "required", "", ""), *map(_row, limits)])))
    return 0 if all(limit.is_enough for limit in limits) else 1


def _row(limit: Limit) -> tuple[str, ...]:
    borne = f"{'more than ' if limit.is_beyond else ''}{limit.borne:.3g}"
    required = "-" if limit.required is None else f"{limit.required:.3g}"
    return limit.name, borne, required, limit.unit, "" if limit.is_enough else "NOT MET"


def _line(row: tuple[str, ...]) -> str:
    return "  ".join(f"{text:<{width}}" for text, width in zip(row, _WIDTHS, strict=True)).rstrip() + "\n"
