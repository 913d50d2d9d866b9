# SPDX-License-Identifier: MIT
"""Every scenario with each of its seeds and sets of parameters, side by side on the cores; and as a web page."""

import tempfile
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.campaign.result import HEAD, ScenarioResult, cells, verdict
from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Scenario, ScenarioRun
from segway_ecc.hil.page import page, pairs, section, table
from segway_ecc.hil.parallel import results_of
from segway_ecc.hil.progress import OnProgress
from segway_ecc.node.replay.replay import replay

REPLAY: Final = "replay: "
"""How the reason begins where a replay was not identical."""
_CHUNK: Final = 4
_TITLE: Final = "Campaign: declared faults, in lock step"
_INTRODUCTION: Final = (
    "Each row is one run of node, bus, drives and plant on a simulated clock. Times count from the fault: to the "
    "change of mode or line, and to the last torque or voltage that a drive gave. The distance is from where the "
    "robot without the fault is at the same time. The command in a row runs it again, bit-identical."
)


def runs_of(scenarios: Sequence[tuple[str, Scenario]], seeds: int | None = None) -> list[ScenarioRun]:
    """Every run of some scenarios.

    Args:
        scenarios: Each with its source.
        seeds: How many seeds to run of each, from 0 on; None for the scenarios' own.
    """
    return [
        ScenarioRun(source, scenario, robot, seed, parameters)
        for source, scenario in scenarios
        for robot in scenario.robots
        for parameters in scenario.parameters
        for seed in (scenario.seeds if seeds is None else range(seeds))
    ]


def run_campaign(
    runs: Sequence[ScenarioRun], jobs: int, on_progress: OnProgress, *, replayed: bool = False
) -> list[ScenarioResult]:
    """Run scenarios; the results are in their order, and bit-identical whatever `jobs` is.

    Args:
        runs: What to run.
        jobs: How many processes run at a time; 1 for this one alone.
        on_progress: Called after each run.
        replayed: Whether each run is also recorded and replayed, and has to be identical.

    Raises:
        ConfigurationError: A robot or a parameter does not fit.
        ModelError: A parameter is unknown.
    """
    results = []
    with results_of(run_and_replay if replayed else run_scenario, runs, jobs, _CHUNK) as finished:
        for result in finished:
            results.append(result)
            on_progress(len(results), len(runs))
    return results


def run_and_replay(run: ScenarioRun) -> ScenarioResult:
    """Run a scenario, record it, and replay the log; a replay that is not identical is not as expected."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        result = run_scenario(run, log)
        outcome = replay(log)
    if outcome.is_identical and outcome.is_whole:
        return result
    why = f"{REPLAY}{outcome.difference or outcome.gap or 'the log holds no cycle, or is not whole'}"
    return msgspec.structs.replace(result, why_not=(*result.why_not, why))


def render(results: Sequence[ScenarioResult], facts: Mapping[str, str]) -> str:
    """The results and named facts of a campaign as a complete HTML page, what is not as expected first."""
    bad = [result for result in results if not result.is_as_expected]
    good = [result for result in results if result.is_as_expected]
    sections = (
        section("Verdict", f"<p>{escape(verdict(results))}.</p>\n"),
        section("Not as expected", _table(bad)) if bad else "",
        section("As expected", _table(good)) if good else "",
        section("Facts of this campaign", pairs(facts)),
    )
    return page(_TITLE, _INTRODUCTION, sections)


def _table(results: Sequence[ScenarioResult]) -> str:
    rows = []
    for result in results:
        name, *others = cells(result)
        data = "".join(f"<td>{escape(text)}</td>" for text in others)
        reasons = "".join(f"<span>{escape(part)}</span><br>" for part in (*result.why_not, result.reason) if part)
        last = f"<td>{reasons}<code>{escape(result.command)}</code></td>"
        kind = "" if result.is_as_expected else ' class="bad"'
        rows.append(f'<tr{kind}><th scope="row">{escape(name)}</th>{data}{last}</tr>\n')
    return table("Runs", (*HEAD, "reason, and how to run it again"), rows)
