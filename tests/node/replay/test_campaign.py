# SPDX-License-Identifier: MIT
"""Runs of all kinds of the campaign, recorded and replayed: identical to the last bit.

All of them at once: `segway-ecc prove campaign --replay`.
"""

from pathlib import Path

import pytest

from segway_ecc.hil.campaign.run import run_scenario, runs_of
from segway_ecc.hil.campaign.scenario import ScenarioRun, load_all
from segway_ecc.node.replay.replay import replay

_ALL = runs_of(list(load_all([])), seeds=1)
SAMPLE = _ALL[:: (len(_ALL) // 20 - 1) | 1]
"""An odd number apart, since most scenarios have four robots."""


def named(trial: ScenarioRun) -> str:
    return f"{trial.scenario.name}-{trial.robot}"


@pytest.mark.variants(6)
@pytest.mark.parametrize("trial", SAMPLE, ids=named)
def test_the_replay_of_a_run_is_identical(trial: ScenarioRun, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    run_scenario(trial, log)
    outcome = replay(log)

    assert (outcome.difference, outcome.gap, outcome.is_cut, outcome.is_other_model) == (None, None, False, False)
    assert outcome.cycles > 20


def test_the_sample_holds_runs_of_many_kinds() -> None:
    assert len(SAMPLE) >= 20
    assert len({trial.robot for trial in SAMPLE}) >= 4
    assert len({fault.target for trial in SAMPLE for fault in trial.scenario.faults}) >= 6
