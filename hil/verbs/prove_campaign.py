# SPDX-License-Identifier: MIT
"""`segway-ecc prove campaign`: all scenarios with all their seeds and parameters, side by side, and a report."""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from segway_ecc.hil.campaign.failure_modes import failure_modes
from segway_ecc.hil.campaign.run import REPLAY, render, run_campaign, runs_of
from segway_ecc.hil.campaign.scenario import ScenarioResult, load_all, table
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.proofs import add_count, check_counts, claims_out, writing_to
from segway_ecc.node.cli.options import add_json, print_found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `campaign`."""
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenarios; those of the package where not given")
    add_count(parser, "jobs")
    parser.add_argument("--seeds", type=int, metavar="N", help="run seeds 0 to N-1 of each instead of its own")
    parser.add_argument(
        "--out", type=Path, metavar="FOLDER", help="write campaign.html, campaign.json and failure-modes.md there"
    )
    parser.add_argument(
        "--replay", action="store_true", help="record each run too, replay its log, and ask that it be identical"
    )
    add_json(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Run the campaign and print the table: 0 where all is as expected, 1 where anything is not."""
    check_counts(options, "jobs", "seeds")
    scenarios = list(load_all(options.files))
    trials = runs_of(scenarios, options.seeds)
    begun_s = time.monotonic()
    with show_progress("campaign", len(trials)) as on_progress:
        results = run_campaign(trials, min(options.jobs, len(trials)), on_progress, replayed=options.replay)
    took_s = time.monotonic() - begun_s
    runs = [{**msgspec.to_builtins(r), "as_expected": r.is_as_expected, "command": r.command} for r in results]
    document = {"as_expected": all(r.is_as_expected for r in results), "runs": runs}
    if options.out is not None:
        simulated_s = sum(result.simulated_s for result in results)
        facts = {
            "Runs": f"{_counted(results)}, of {len({result.scenario for result in results})} scenarios",
            "Time": f"{took_s:.1f} s for {simulated_s:.0f} s simulated, in {options.jobs} processes",
            "Robots": ", ".join(sorted({result.robot for result in results})),
        }
        with writing_to(options.out):
            (options.out / "campaign.html").write_text(render(results, facts), encoding="utf-8")
            modes = failure_modes((scenario for _, scenario in scenarios), results)
            (options.out / "failure-modes.md").write_text(modes, encoding="utf-8")
            (options.out / "campaign.json").write_bytes(msgspec.json.format(msgspec.json.encode(document)))
        sys.stderr.write(f"segway-ecc: report in {options.out / 'campaign.html'}\n")
    print_found(options, document, table(results))
    if options.replay:
        identical = sum(not any(why.startswith(REPLAY) for why in result.why_not) for result in results)
        sys.stderr.write(f"segway-ecc: {identical} of {len(results)} replays are identical to the last bit\n")
    sys.stderr.write(f"segway-ecc: {_counted(results)} in {took_s:.1f} s\n")
    return 0 if document["as_expected"] else 1


def _counted(results: Sequence[ScenarioResult]) -> str:
    """How many runs there are, and how many of them a seed changed nothing of."""
    different = {(result.scenario, result.robot, *result.parameters.items(), result.digest) for result in results}
    same = len(results) - len(different)
    return f"{len(results)} runs" + (f", {same} of them as with another seed" if same else "")
