# SPDX-License-Identifier: MIT
"""The replay of a robot that its commissioning kept from arming: it has no report to read, and refuses all the same."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.campaign import run
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioRun
from segway_ecc.node.replay.replay import replay
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.sequence.manoeuvre import Segment


def test_it_is_refused_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def uncommissioned(*args: Any) -> Robot:
        return replace(build_robot(*args), not_commissioned="there is no report")

    monkeypatch.setattr(run, "build_robot", uncommissioned)
    segments = (Segment(linear=0.5, duration=1.0),)
    scenario = Scenario(name="test", robot="cart-can", segments=segments, expect=Expectation(outcome="drives_on"))
    log = tmp_path / "run.mcap"
    result = run.run_scenario(ScenarioRun("test", scenario, "cart-can", 0, {}), log)
    outcome = replay(log)

    assert result.outcome == "never armed", result
    assert (outcome.difference, outcome.refusal) == (None, "")
