# SPDX-License-Identifier: MIT
"""The failure modes of the parts, from scenarios and what came of them."""

import msgspec

from segway_ecc.hil.campaign.failure_modes import failure_modes
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioResult
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.node.sequence.manoeuvre import Segment

CUT = Scenario(
    name="cut",
    robot=("cart-can", "segway"),
    segments=(Segment(linear=1.0, duration=2.0),),
    faults=(Fault(target="can", type="off", at_s=1.0),),
    expect=Expectation(outcome="faults"),
)
WEAK = Scenario(
    name="weak",
    robot="segway",
    segments=(Segment(linear=1.0, duration=2.0),),
    faults=(
        Fault(target="left_motor", type="wrong", at_s=1.0, for_s=0.5, amount=0.5),
        Fault(target="right_motor", type="off", at_s=1.0),
    ),
    expect=Expectation(outcome="drives_on"),
)
RESULT = ScenarioResult(
    source="cut",
    scenario="cut",
    robot="cart-can",
    seed=0,
    parameters={},
    outcome="faults",
    reason="too old",
    detection_s=0.0272,
    safe_s=0.0412,
    max_tilt_rad=None,
    max_distance_m=0.5,
    switches=(),
    simulated_s=2.0,
    digest="",
)


def row(text: str, scenario: str) -> list[str]:
    (line,) = [line for line in text.splitlines() if f"`{scenario}`" in line]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_a_row_has_the_worst_of_the_runs() -> None:
    other = msgspec.structs.replace(RESULT, robot="segway", safe_s=0.03, max_tilt_rad=0.25, max_distance_m=0.75)
    other = msgspec.structs.replace(other, posture="FALLEN")
    assert row(failure_modes([CUT], [RESULT, other]), "cut") == [
        "nothing passes either way, and nothing reports it: a cut cable",
        "",
        "`cut`",
        "cart-can, segway",
        "2",
        "faults, faults FALLEN",
        "27.2",
        "41.2",
        "0.750",
        "0.250",
    ]


def test_a_drive_that_goes_on_has_no_time_to_zero_and_what_is_not_as_expected_shows() -> None:
    changes = {"scenario": "weak", "outcome": "drives_on", "detection_s": None, "why_not": ("too far",)}
    text = failure_modes([WEAK], [msgspec.structs.replace(RESULT, **changes)])
    failure, amount, _, _, _, outcome, detected, zero, *_ = row(text, "weak")
    assert "## Left motor and right motor" in text
    assert failure == (
        "gives this times what the drive gives: -1 backwards, 0.5 weak; gives no torque: an open winding"
    )
    assert amount == "0.5 factor, for 0.5 s"
    assert (outcome, detected, zero) == ("drives_on, NOT AS EXPECTED", "", "")


def test_a_drive_that_never_stopped_shows_in_a_fault() -> None:
    never = msgspec.structs.replace(RESULT, safe_s=None)
    assert row(failure_modes([CUT], [RESULT, never]), "cut")[7] == "never"


def test_tables_stand_by_part_and_a_scenario_without_a_fault_has_no_row() -> None:
    sound = msgspec.structs.replace(CUT, name="sound", faults=())
    results = [RESULT, *(msgspec.structs.replace(RESULT, scenario=name) for name in ("weak", "sound"))]
    lines = failure_modes([WEAK, sound, CUT], results).splitlines()
    assert [line for line in lines if line.startswith("## ")] == ["## Can", "## Left motor and right motor"]
    assert not any("`sound`" in line for line in lines)


def test_amounts_of_one_failure_rise_and_its_text_stands_once() -> None:
    cases = [
        msgspec.structs.replace(
            CUT,
            name=f"late@{amount:g}",
            faults=(Fault(target="can", type="delayed", at_s=1.0, amount=amount, for_s=0.5, every_s=1.0),),
        )
        for amount in (0.5, 0.05, 10.0)
    ]
    text = failure_modes(cases, [msgspec.structs.replace(RESULT, scenario=case.name) for case in cases])
    cells = [[cell.strip() for cell in line.strip("|").split("|")][:3] for line in text.splitlines() if "`" in line]
    assert cells[1:] == [
        ["every frame arrives this much later", "0.05 s, for 0.5 s, every 1 s", "`late@0.05`"],
        ["", "0.5 s, for 0.5 s, every 1 s", "`late@0.5`"],
        ["", "10 s, for 0.5 s, every 1 s", "`late@10`"],
    ]


def test_the_runs_of_each_robot_are_counted_by_how_they_ended() -> None:
    other = msgspec.structs.replace(RESULT, robot="segway", outcome="holds")
    lines = failure_modes([CUT], [RESULT, other, other]).splitlines()
    start = lines.index("| Robot | Runs | faults | holds |")
    assert lines[start + 2 : start + 5] == ["| cart-can | 1 | 1 | 0 |", "| segway | 2 | 0 | 2 |", "| all | 3 | 1 | 2 |"]
