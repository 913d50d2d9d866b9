# SPDX-License-Identifier: MIT
"""`segway-ecc prove campaign`: all scenarios with all their seeds and parameters, side by side, and a report."""

import argparse
import sys
import time
from collections.abc import Sequence

import msgspec

from segway_ecc.hil.campaign.both_plants import differences, on_both, sampled, table_of, with_contact
from segway_ecc.hil.campaign.failure_modes import failure_modes
from segway_ecc.hil.campaign.page import render
from segway_ecc.hil.campaign.run import REPLAY, run_campaign, runs_of
from segway_ecc.hil.campaign.scenario import Scenario, ScenarioResult, ScenarioRun, load_all, table
from segway_ecc.hil.floor.contact import lacks_mujoco
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.proofs import add_count, add_floor, check_counts, check_floor, claims_out, writing_to
from segway_ecc.node.cli.options import add_json, output_folder, print_found
from segway_ecc.node.errors import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `campaign`."""
    parser.add_argument("files", nargs="*", metavar="FILE", help="scenarios; those of the package where not given")
    add_count(parser, "jobs")
    parser.add_argument("--seeds", type=int, metavar="N", help="run seeds 0 to N-1 of each instead of its own")
    parser.add_argument(
        "--out",
        type=output_folder,
        metavar="FOLDER",
        help="write campaign.html, campaign.json and failure-modes.md there",
    )
    parser.add_argument(
        "--replay", action="store_true", help="record each run too, replay its log, and ask that it be identical"
    )
    add_floor(parser, "each run of a segway also on a floor of this friction, and list what ends otherwise there")
    parser.add_argument("--sample", type=int, metavar="N", help="only N of the runs, at even distances")
    add_json(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Run the campaign and print the table: 0 where all is as expected, 1 where anything is not."""
    check_counts(options, "jobs", "seeds", "sample")
    check_floor(options)
    scenarios = list(load_all(options.files))
    trials = _trials(runs_of(scenarios, options.seeds), options.floor, options.sample)
    begun_s = time.monotonic()
    with show_progress("campaign", len(trials)) as on_progress:
        results = run_campaign(trials, min(options.jobs, len(trials)), on_progress, replayed=options.replay)
    took_s = time.monotonic() - begun_s
    runs = [{**msgspec.to_builtins(r), "as_expected": r.is_as_expected, "command": r.command} for r in results]
    found = [] if options.floor is None else list(differences(results))
    document = {"as_expected": all(r.is_as_expected for r in results), "runs": runs}
    if options.floor is not None:
        document["differences"] = [difference.as_json() for difference in found]
    if options.out is not None:
        simulated_s = sum(result.simulated_s for result in results)
        facts = {
            "Runs": f"{_counted(results)}, of {len({result.scenario for result in results})} scenarios",
            "Time": f"{took_s:.1f} s for {simulated_s:.0f} s simulated, in {options.jobs} processes",
            "Robots": ", ".join(sorted({result.robot for result in results})),
        }
        with writing_to(options.out):
            (options.out / "campaign.html").write_text(render(results, facts), encoding="utf-8")
            modes = _failure_modes([scenario for _, scenario in scenarios], results)
            (options.out / "failure-modes.md").write_text(modes, encoding="utf-8")
            (options.out / "campaign.json").write_bytes(msgspec.json.format(msgspec.json.encode(document)))
        sys.stderr.write(f"segway-ecc: report in {options.out / 'campaign.html'}\n")
    text = "" if options.floor is None else "\n" + table_of(found, len(results) // 2, options.floor)
    print_found(options, document, table(results) + text)
    if options.replay:
        identical = sum(not any(why.startswith(REPLAY) for why in result.why_not) for result in results)
        sys.stderr.write(f"segway-ecc: {identical} of {len(results)} replays are identical to the last bit\n")
    sys.stderr.write(f"segway-ecc: {_counted(results)} in {took_s:.1f} s\n")
    return 0 if document["as_expected"] else 1


def _trials(runs: list[ScenarioRun], floor: float | None, sample: int | None) -> list[ScenarioRun]:
    """A sample of the runs, on both plants where there is a floor.

    Raises:
        ConfigurationError: No run is of a robot that can be put on a floor, or MuJoCo is not installed.
    """
    if floor is None:
        return sampled(runs, sample)
    if lacks_mujoco():
        raise ConfigurationError(f"--floor needs MuJoCo: {lacks_mujoco()}")
    there = with_contact(runs)
    if not there:
        raise ConfigurationError("--floor: none of these scenarios is of a segway: name one, such as segway_wheel-off")
    return on_both(sampled(there, sample), floor)


def _failure_modes(scenarios: Sequence[Scenario], results: Sequence[ScenarioResult]) -> str:
    """The table of what was run, where wheels never slip: what is expected there holds for no floor."""
    own = [result for result in results if result.floor is None]
    names = {result.scenario for result in own}
    return failure_modes((scenario for scenario in scenarios if scenario.name in names), own)


def _counted(results: Sequence[ScenarioResult]) -> str:
    """How many runs there are, and how many of them a seed changed nothing of."""
    different = {
        (result.scenario, result.robot, result.floor, *result.parameters.items(), result.digest) for result in results
    }
    same = len(results) - len(different)
    return f"{len(results)} runs" + (f", {same} of them as with another seed" if same else "")
