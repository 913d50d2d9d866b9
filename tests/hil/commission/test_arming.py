# SPDX-License-Identifier: MIT
"""Arming of a robot whose file requires a commissioning."""

import dataclasses
from pathlib import Path

import msgspec
import pytest

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.hil.design.balance import Balance
from segway_ecc.node.commissioning import STEPS, CommissioningReport, StepReport, digests_of
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode

PACKAGED = load_robot("segway")
REQUIRED = msgspec.structs.replace(PACKAGED, commissioned="required")


def test_robot_that_is_not_commissioned_is_refused_in_one_line() -> None:
    balance = Balance(REQUIRED, pitch=0.5)
    balance.robot = dataclasses.replace(balance.robot, not_commissioned="report.yaml of 2026 is stale")

    balance.run(2.0)

    assert set(balance.modes) == {Mode.DISARMED}
    refusal = balance.loop.arming_refusal
    assert refusal is not None
    assert "commissioned: report.yaml of 2026 is stale; run segway-ecc design commission" in refusal
    assert "\n" not in refusal


def test_run_in_lock_step_needs_no_commissioning() -> None:
    balance = Balance(REQUIRED, pitch=0.5)

    balance.run(2.0)

    assert balance.modes[-1] is Mode.ARMED


def test_robot_is_built_with_what_its_report_says(tmp_path: Path) -> None:
    path = tmp_path / "segway.commissioned.yaml"

    assert build_robot(PACKAGED, RealClock()).not_commissioned is None
    missing = build_robot(REQUIRED, RealClock(), report=path).not_commissioned
    assert missing is not None
    assert missing.startswith("there is no commissioning report")

    report = CommissioningReport(
        robot=REQUIRED.name,
        date="2026-01-01",
        version="0.2.0",
        is_simulated=False,
        digests=digests_of(REQUIRED),
        steps=tuple(StepReport(step=step, verdict="passed", text="good") for step in STEPS),
    )
    path.write_bytes(msgspec.yaml.encode(report))
    assert build_robot(REQUIRED, RealClock(), report=path).not_commissioned is None


@pytest.mark.parametrize("robot", ["segway", "segway-odrive"])
def test_packaged_robots_require_none(robot: str) -> None:
    assert load_robot(robot).commissioned == "optional"
