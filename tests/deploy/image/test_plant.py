# SPDX-License-Identifier: MIT
"""The robot's own software against its plant over the guest's own CAN: the case study, and the segway that balances.

In lock step, so that the guest's slow processor disturbs nothing: what is proven is the way over the kernel's bus.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.case_study.seats import OfflineSeat, conduct
from tests.deploy.image.robot import Robot, SwitchOn
from tests.deploy.image.uml_machine import Machine

pytestmark = pytest.mark.image
WITHIN_M = 0.05
CASE_STUDY = "segway-ecc case-study --seat can --no-real-time --robot cart-can --channel vcan0 --out /run/study --json"
SEGWAY = "segway-ecc prove endurance segway --channel vcan0 --hours 0.005 --frame-loss 0 --seeds 1 --json"
CYCLES = 3600
BOTH_WHEELS_BOTH_WAYS = 4


def test_the_case_study_and_the_segway_run_against_their_plants_over_the_guests_bus(
    switch_on: SwitchOn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with switch_on(tmp_path / "machine") as machine:
        Robot(machine).wait_until_up()
        machine.run("systemctl stop segway-ecc-node segway-ecc-guard", 240)  # the bus is for the two that follow
        cells = output(machine, CASE_STUDY)["cells"]
        frames = [sent(machine)]
        driven = output(machine, SEGWAY)
        frames.append(sent(machine) - frames[0])
    offline = conduct([OfflineSeat(tmp_path)], {}, lambda *_: None).cells
    assert [(cell["linear"], cell["angular"]) for cell in cells] == [(cell.linear, cell.angular) for cell in offline]
    for cell, same in zip(cells, offline, strict=True):
        assert cell["can"] == pytest.approx(list(next(iter(same.positions.values()))), abs=WITHIN_M)
    assert (driven["trips"], driven["cycles"], driven["frames_lost"]) == (0, CYCLES, 0)
    assert driven["max_tilt_rad"] > 0.0
    assert frames[1] >= driven["frames"] > BOTH_WHEELS_BOTH_WAYS * CYCLES
    with capsys.disabled():
        print(f"\nover the guest's bus: {frames[0]} frames of the case study, {frames[1]} of the segway")  # noqa: T201


def output(machine: Machine, words: str) -> dict[str, Any]:
    machine.run(f"cd /run && {words} > /run/share/output 2> /run/share/errors < /dev/null", 600)
    return dict(json.loads((machine.share / "output").read_text("utf-8")))


def sent(machine: Machine) -> int:
    return int(machine.run("cat /sys/class/net/vcan0/statistics/tx_packets"))
