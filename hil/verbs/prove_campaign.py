"""`segway-ecc prove campaign`: all scenarios with all their seeds and parameters, side by side, and a report."""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from segway_ecc.hil.campaign.campaign import REPLAY, run_campaign, runs_of
from segway_ecc.hil.campaign.report import render
from segway_ecc.hil.campaign.result import ScenarioResult
from segway_ecc.hil.campaign.scenario import load_all
from segway_ecc.hil.campaign.table import table
from segway_ecc.hil.progress import show_progress
from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.errors import ConfigurationError

_NOT_AS_EXPECTED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `campaign`."""
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenarios; those of the package where not given")
    parser.add_argument("--jobs", type=int, default=_cores(), metavar="N", help="processes at a time (default: cores)")
    parser.add_argument("--seeds", type=int, metavar="N", help="run seeds 0 to N-1 of each instead of its own")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="write campaign.html and campaign.json there")
    parser.add_argument(
        "--replay", action="store_true", help="record each run too, replay its log, and ask that it be identical"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Run the campaign and print the table: 0 where all is as expected, 1 where anything is not."""
    for name in ("jobs", "seeds"):
        value = getattr(options, name)
        if value is not None and value < 1:
            raise ConfigurationError(f"--{name} must be at least 1, not {value}")
    trials = runs_of(list(load_all(options.files)), options.seeds)
    begun_s = time.monotonic()
    with show_progress("campaign", len(trials)) as on_progress:
        results = run_campaign(trials, min(options.jobs, len(trials)), on_progress, replayed=options.replay)
    took_s = time.monotonic() - begun_s
    document = {"as_expected": all(r.is_as_expected for r in results), "runs": [_row(result) for result in results]}
    if options.out is not None:
        _write(options.out, render(results, _facts(results, options.jobs, took_s)), document)
    if options.json:
        print_json(document)
    else:
        sys.stdout.write(table(results))
    if options.replay:
        sys.stderr.write(f"segway-ecc: {_identical(results)} of {len(results)} replays are identical to the last bit\n")
    sys.stderr.write(f"segway-ecc: {len(results)} runs in {took_s:.1f} s\n")
    return 0 if document["as_expected"] else _NOT_AS_EXPECTED


def _identical(results: Sequence[ScenarioResult]) -> int:
    return sum(not any(why.startswith(REPLAY) for why in result.why_not) for result in results)


def _row(result: ScenarioResult) -> dict[str, object]:
    return {**msgspec.to_builtins(result), "as_expected": result.is_as_expected, "command": result.command}


def _write(folder: Path, page: str, document: object) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "campaign.html").write_text(page, encoding="utf-8")
        (folder / "campaign.json").write_bytes(msgspec.json.format(msgspec.json.encode(document)))
    except OSError as error:
        raise ConfigurationError(
            f"cannot write the report to {folder}: {error.strerror}; choose another --out"
        ) from error
    sys.stderr.write(f"segway-ecc: report in {folder / 'campaign.html'}\n")


def _facts(results: Sequence[ScenarioResult], jobs: int, took_s: float) -> dict[str, str]:
    simulated_s = sum(result.simulated_s for result in results)
    return {
        "Runs": f"{len(results)} of {len({result.scenario for result in results})} scenarios",
        "Time": f"{took_s:.1f} s for {simulated_s:.0f} s simulated, in {jobs} processes",
        "Robots": ", ".join(sorted({result.robot for result in results})),
    }


def _cores() -> int:
    return len(os.sched_getaffinity(0))
