# SPDX-License-Identifier: MIT
"""Scenarios are read whole or refused; those of the package cover every fault there is."""

from pathlib import Path

import pytest

from segway_ecc.hil.campaign.scenario import load_all, load_scenario, packaged_scenarios
from segway_ecc.hil.faults.fault import KINDS
from segway_ecc.node.config import load_robot, packaged_robots
from segway_ecc.node.errors import ConfigurationError

TEXT = """
name: mine
robot: cart-can
segments: [{linear: 1.0, duration: 1.5}, {angular: 0.5, duration: 0.5}]
faults: [{target: can, type: off, at_s: 1.0}]
expect: {outcome: faults}
"""


def write(folder: Path, text: str) -> str:
    path = folder / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_a_scenario_is_read(tmp_path: Path) -> None:
    scenario = load_scenario(write(tmp_path, TEXT))
    assert scenario.robots == ("cart-can",)
    assert scenario.duration_s == 2.0
    assert scenario.manoeuvre.duration_ns == 2_000_000_000
    assert scenario.faults[0].type == "off"  # which YAML itself takes for false
    assert (scenario.seeds, scenario.parameters) == ((0,), ({},))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("at_s: 1.0", "at_s: 2.0", "a fault at 2 s comes after the segments' 2 s"),
        ("target: can", "target: serial", "a fault of the serial line needs fallback: true"),
        ("target: can", "target: clock", "clock cannot be off; it can be stuck, wrong, slow"),
        ("outcome: faults", "outcome: explodes", "allowed is disarmed, drives_on, faults, holds"),
        ("outcome: faults", "outcome: faults, within_s: 0", "expect.within_s"),
        ("name: mine", "name: Not Mine", "name"),
        ("robot: cart-can", "robot: []", "robot"),
        ("name: mine", "name: mine\nseeds: [-1]", "seeds"),
        ("name: mine", "name: mine\nparameters: [{Inertia: 1.0}]", "must begin with model. or plant."),
        ("name: mine", "name: mine\nspeed: 1", "unknown field `speed`"),
    ],
)
def test_an_error_is_reported_in_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as raised:
        load_scenario(write(tmp_path, TEXT.replace(old, new)))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


CASES = TEXT.replace("type: off", "type: delayed").replace(
    "expect: {outcome: faults}",
    "expect: {outcome: drives_on}\ncases:\n  - {amount: 0.05, expect: {outcome: faults, reason: too old}}",
)


def test_a_case_is_the_scenario_with_another_amount_and_expectation(tmp_path: Path) -> None:
    path = write(tmp_path, CASES)
    (base, own), (source, case) = load_all([path])
    assert (base, source) == (path, f"{path}@0.05")
    assert (own.name, own.faults[0].amount, own.expect.outcome) == ("mine", None, "drives_on")
    assert (case.name, case.faults[0].amount, case.expect.outcome) == ("mine@0.05", 0.05, "faults")
    assert case.segments == own.segments
    assert load_scenario(source) == case
    assert load_scenario(path).name == "mine"
    with pytest.raises(ConfigurationError, match=r"no scenario '.*@7'; .* has mine, mine@0\.05"):
        load_scenario(f"{path}@7")


def test_a_case_may_be_longer_or_at_another_time_and_of_the_first_of_several_faults(tmp_path: Path) -> None:
    cases = "cases:\n  - {for_s: 0.25}\n  - {at_s: 0.125, expect: {outcome: holds}}"
    text = TEXT.replace("at_s: 1.0}", "at_s: 1.0}, {target: disk, type: off, at_s: 1.0}")
    scenarios = [scenario for _, scenario in load_all([write(tmp_path, f"{text.rstrip()}\n{cases}\n")])]
    assert [scenario.name for scenario in scenarios] == ["mine", "mine@0.25", "mine@0.125"]
    assert [scenario.faults[0].for_s for scenario in scenarios] == [None, 0.25, None]
    assert [scenario.faults[0].at_s for scenario in scenarios] == [1.0, 1.0, 0.125]
    assert len({scenario.faults[1:] for scenario in scenarios}) == 1
    assert [scenario.expect.outcome for scenario in scenarios] == ["faults", "faults", "holds"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("amount: 0.05", "amount: 0", "amount must be from 0.001 to 60 (s), not 0"),
        ("cases:\n", "cases:\n  - {amount: 0.05, expect: {outcome: holds}}\n", "different amounts of the first fault"),
        ("amount: 0.05,", "amount: 0.05, for_s: 0.1,", "a case has one of amount, for_s and at_s"),
        ("amount: 0.05,", "", "a case has one of amount, for_s and at_s"),
        ("type: delayed", "type: wrong", "amount has no meaning where can is wrong"),
    ],
)
def test_a_case_that_is_none_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as raised:
        load_scenario(write(tmp_path, CASES.replace(old, new)))
    assert message in str(raised.value)


def test_a_file_that_is_not_there_is_named_with_those_of_the_package(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"nowhere\.yaml': No such file .* the packaged ones are .*can-cut"):
        load_scenario(str(tmp_path / "nowhere.yaml"))
    (tmp_path / "latin.yaml").write_bytes(b"\xff")
    with pytest.raises(ConfigurationError, match="not UTF-8"):
        load_scenario(str(tmp_path / "latin.yaml"))


def test_every_scenario_of_the_package_is_sound() -> None:
    scenarios = dict(load_all([]))
    assert [name for name in scenarios if "@" not in name] == packaged_scenarios()
    for name, scenario in scenarios.items():
        assert scenario.name == name
        assert scenario.about
        for robot in scenario.robots:
            assert robot in packaged_robots()
            assert load_robot(robot).simulation is not None


def test_the_scenarios_of_the_package_make_every_fault_there_is() -> None:
    made = {(fault.target, fault.type) for _, scenario in load_all([]) for fault in scenario.faults}
    assert made == {(target, kind) for target, kinds in KINDS.items() for kind in kinds}
