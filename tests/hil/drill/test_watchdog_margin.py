# SPDX-License-Identifier: MIT
"""A watchdog of 40 ms ends the torque 10 ms before it must, and outlasts a loop that is preempted for a moment."""

import importlib.resources
import re
from pathlib import Path

import msgspec
import pytest

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import ScenarioRun, load_scenario

WATCHDOG_S = 0.04


def robot_with_watchdog(robot: str, folder: Path) -> str:
    text = importlib.resources.files("segway_ecc.node").joinpath(f"robots/{robot}.yaml").read_text("utf-8")
    text, count = re.subn(r"watchdog_s: [0-9.]+", f"watchdog_s: {WATCHDOG_S}", text)
    assert count == 1
    path = folder / "robot.yaml"
    path.write_text(text, "utf-8")
    return str(path)


# A CiA 402 drive counts its telemetry too old before its watchdog matters, whatever that is set to.
@pytest.mark.parametrize(
    ("robot", "stall_s", "outcome"),
    [
        ("cart-can", 0.03, "drives_on"),
        ("cart-odrive", 0.03, "drives_on"),
        ("cart-cia402", 0.02, "drives_on"),
        ("cart-can", 0.06, "faults"),
    ],
)
def test_a_loop_that_is_preempted_for_a_moment_drives_on(
    tmp_path: Path, robot: str, stall_s: float, outcome: str
) -> None:
    scenario = load_scenario("node-stalls-briefly")
    (stall,) = scenario.faults
    scenario = msgspec.structs.replace(scenario, faults=[msgspec.structs.replace(stall, amount=stall_s)])
    result = run_scenario(ScenarioRun("stall", scenario, robot_with_watchdog(robot, tmp_path), 0, {}))

    assert result.outcome == outcome, result
