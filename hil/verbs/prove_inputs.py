# SPDX-License-Identifier: MIT
"""`segway-ecc prove inputs`: every kind of input to a robot that runs, its outcome, and the time to zero torque."""

import argparse
import contextlib
import dataclasses
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.hil.inputs import table, trial
from segway_ecc.hil.inputs.rig import Place, Starter
from segway_ecc.hil.inputs.trial import InputResult
from segway_ecc.hil.processes import inherited, own_ros_domain
from segway_ecc.hil.progress import show_all_progress
from segway_ecc.hil.text_table import aligned
from segway_ecc.hil.witness import witness
from segway_ecc.node.cli.options import add_json, print_found

OnAllProgress = Callable[[str, int, int | None], None]
"""See `show_all_progress`."""
ROBOTS: Final = ("segway", "segway-odrive")
_HEAD: Final = ("item", "input", "declared", "outcome", "zero, ms", "limit, ms", "verdict")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `inputs`."""
    parser.add_argument("--robot", action="append", choices=ROBOTS, help="only this one (default: both)")
    items = "; ".join(f"{number}: {text}" for number, text in table.ITEMS.items())
    parser.add_argument(
        "--item",
        action="append",
        type=int,
        choices=list(table.ITEMS),
        metavar="N",
        help=f"only these inputs, and may be given again; {items}",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Try every input, and print the table; 1 where an outcome was not as declared, or nothing could be tried."""
    robots = options.robot or ROBOTS
    rows: dict[str, list[InputResult]] = {}
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="segway-ecc-inputs-")))
        for name, value in {**own_ros_domain(), "ROS_LOG_DIR": str(folder), "XDG_STATE_HOME": str(folder)}.items():
            stack.enter_context(inherited(name, value))
        show = stack.enter_context(show_all_progress(lines=True))
        for robot in robots:
            rows[robot] = _try_all(robot, options.item, folder / robot, show)
    results = [result for found in rows.values() for result in found]
    counts = {
        "tried": sum(not result.not_run for result in results),
        "as_declared": sum(result.is_as_declared for result in results),
        "not_run": sum(bool(result.not_run) for result in results),
    }
    document = {
        **counts,
        "robots": {robot: [_document(result) for result in found] for robot, found in rows.items()},
    }
    print_found(options, document, _text(rows, counts))
    return 0 if counts["as_declared"] == counts["tried"] > 0 else 1


def _try_all(robot: str, items: Sequence[int] | None, folder: Path, show: OnAllProgress) -> list[InputResult]:
    chosen = [each for each in table.all_trials() if not items or each.item in items]
    folder.mkdir()
    start = Starter(Place(robot, folder, f"inputs_{os.getpid()}_{robot}"))
    found: list[InputResult] = []
    with witness(folder / "witness.txt") as beside:
        for outcome in trial.run_all(chosen, start):
            result = dataclasses.replace(outcome, stall=beside.stalls().text)
            found.append(result)
            show(robot, len(found), len(chosen))
            if not result.is_as_declared:
                sys.stderr.write(f"segway-ecc: {robot}: {result.item}: {result.name}: {_verdict(result)}\n")
    return found


def _document(result: InputResult) -> dict[str, object]:
    torque = None if result.torque is None else result.torque._asdict()
    return {**dataclasses.asdict(result), "torque": torque, "as_declared": result.is_as_declared}


def _text(rows: Mapping[str, Sequence[InputResult]], counts: Mapping[str, int]) -> str:
    text = ""
    for robot, found in rows.items():
        head, *lines = aligned([_HEAD, *map(_row, found)])
        text += f"{robot}\n{head}\n"
        for line, result in zip(lines, found, strict=True):
            text += f"{line}\n    {result.reason or '-'}\n"
        text += "\n"
    left = f"; {counts['not_run']} not run" if counts["not_run"] else ""
    return f"{text}{counts['as_declared']} of {counts['tried']} inputs as declared{left}\n"


def _row(result: InputResult) -> tuple[str, ...]:
    torque, limit_s = result.torque, result.limit_s
    zero = "-" if torque is None else "goes on" if torque.zero_s is None else f"{torque.last_s * 1e3:.1f}"
    limit = "-" if limit_s is None else f"{limit_s * 1e3:g}"
    return str(result.item), result.name, result.declared, result.outcome or "-", zero, limit, _verdict(result)


def _verdict(result: InputResult) -> str:
    if result.not_run:
        return f"not run: {result.not_run}"
    if result.is_as_declared:
        return "as declared"
    meanwhile = f"; meanwhile {result.stall}" if result.stall else ""
    return f"NOT as declared: {'; '.join(result.wrong)}{meanwhile}"
