# SPDX-License-Identifier: MIT
"""Advice by rehearsal: who never turned is told to turn, and what cannot be told by driving is to be measured."""

import pytest

from segway_ecc.hil.design.balance import Balance
from segway_ecc.hil.identify.advice import advise
from segway_ecc.hil.identify.identify import identify
from segway_ecc.hil.identify.windows import run_of
from segway_ecc.hil.verbs.design_gains import segway_parameters
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.recording.layout import layout_of


@pytest.mark.proof
def test_a_robot_that_never_turned_is_told_to_turn() -> None:
    file = load_robot("segway")
    p = segway_parameters(file)
    balance = Balance(file, pitch=0.0)
    records: list[CycleRecord] = []
    balance.run(5.0, {1.0: lambda b: b.drive(0.4, 0.0), 3.0: lambda b: b.drive(-0.4, 0.0)}, keep=records.append)
    found = identify([run_of(records, layout_of(balance.robot), skip_s=1.0)], p, voltage=True)
    estimates = {e.name: e for e in found.estimates}
    assert estimates["Track"].is_wide

    advice = advise(found, file, p, voltage=True)
    driven = [one for one in advice if "drive" in one.what or "spin" in one.what]
    best = min(driven, key=lambda one: one.expected.get("Track", 1.0))
    assert "spin" in best.what or "curves" in best.what
    assert best.expected["Track"] < 0.05
    mass = min((one for one in advice if "BodyMass" in one.expected), key=lambda one: one.expected["BodyMass"])
    assert mass.what.startswith("weigh the body")
