"""Every scenario with each of its seeds and sets of parameters, side by side on the cores."""

import contextlib
import logging
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.hil.campaign.result import ScenarioResult
from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Scenario, ScenarioRun
from segway_ecc.hil.progress import OnProgress
from segway_ecc.hil.spawning import spawning
from segway_ecc.node.replay.replay import replay

REPLAY: Final = "replay: "
"""How it begins when a result says that a replay was not identical."""
_CHUNK: Final = 4


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
    trials: Sequence[ScenarioRun], jobs: int, on_progress: OnProgress, *, replayed: bool = False
) -> list[ScenarioResult]:
    """Run trials; the results are in their order, and the same bits whatever `jobs` is.

    Args:
        trials: What to run.
        jobs: How many processes run at a time; 1 for this one alone.
        on_progress: Called after each run.
        replayed: Whether each run is also recorded and replayed, and has to be identical.

    Raises:
        ConfigurationError: A robot or a parameter does not fit.
        ModelError: A parameter is unknown.
    """
    results = []
    with _runs(run_and_replay if replayed else run_quietly, trials, jobs) as runs:
        for result in runs:
            results.append(result)
            on_progress(len(results), len(trials))
    return results


@contextlib.contextmanager
def _runs(
    run: Callable[[ScenarioRun], ScenarioResult], trials: Sequence[ScenarioRun], jobs: int
) -> Iterator[Iterator[ScenarioResult]]:
    if jobs == 1:
        yield map(run, trials)
        return
    with spawning() as processes, processes.Pool(jobs, _leave_ctrl_c_to_the_parent) as pool:
        yield pool.imap(run, trials, _CHUNK)


def _leave_ctrl_c_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_quietly(trial: ScenarioRun, log: Path | None = None) -> ScenarioResult:
    """Run one trial, with its log where one is wanted; what the node would tell people meanwhile is not told."""
    logger = logging.getLogger("segway_ecc.node")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        return run_scenario(trial, log)
    finally:
        logger.setLevel(level)


def run_and_replay(trial: ScenarioRun) -> ScenarioResult:
    """Run one trial, record it, and replay the log; a replay that is not identical is not as expected."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        result = run_quietly(trial, log)
        outcome = replay(log)
    if outcome.is_identical and outcome.gap is None:
        return result
    why = f"{REPLAY}{outcome.difference or outcome.gap or 'the log holds no cycle'}"
    return msgspec.structs.replace(result, why_not=(*result.why_not, why))
