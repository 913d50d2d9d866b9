# SPDX-License-Identifier: MIT
"""The same runs with and without slip: which are made, and which are listed to end otherwise."""

import pytest
from msgspec.structs import replace

from segway_ecc.hil.campaign.both_plants import differences, on_both, sampled, table_of, with_contact
from segway_ecc.hil.campaign.run import run_scenario, runs_of
from segway_ecc.hil.campaign.scenario import ScenarioResult, ScenarioRun, load_all, load_scenario
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.node.sequence.manoeuvre import Segment

RUNS = runs_of(list(load_all(["can-cut", "segway_can-cut"])), 2)
RESULT = ScenarioResult(
    source="s",
    scenario="s",
    robot="segway",
    seed=1,
    parameters={},
    outcome="drives_on",
    reason="",
    detection_s=None,
    safe_s=None,
    max_tilt_rad=0.1,
    max_distance_m=0.1,
    switches=(),
    simulated_s=1.0,
    digest="",
    posture="BALANCING",
)


def test_each_run_of_a_segway_is_made_on_both_plants() -> None:
    there = with_contact(RUNS)
    assert {run.robot for run in there} == {"segway", "segway-odrive"}
    both = on_both(there, 0.8)
    assert [run.floor for run in both] == [None, 0.8] * len(there)
    assert both[0]._replace(floor=0.8) == both[1]


@pytest.mark.parametrize(("count", "expected"), [(None, 12), (100, 12), (12, 12), (5, 5), (4, 4), (1, 1)])
def test_a_sample_is_at_even_distances(count: int | None, expected: int) -> None:
    runs = [RUNS[0]._replace(seed=seed) for seed in range(12)]
    found = sampled(runs, count)
    assert len({run.seed for run in found}) == len(found) == expected
    assert found[0] is runs[0]


def test_only_what_ends_otherwise_is_listed_with_the_reason_on_the_floor() -> None:
    same = replace(RESULT, floor=0.8, max_distance_m=0.3, reason="")
    falls = replace(
        RESULT, floor=0.8, outcome="faults", posture="FALLEN", reason="a wheel is too fast", has_fallen=True
    )
    lies = replace(RESULT, floor=0.8, has_fallen=True)
    found = list(differences([RESULT, same, RESULT, falls, RESULT, lies]))
    assert [difference.floor for difference in found] == [falls, lies]
    lines = table_of(found, 3, 0.8).splitlines()
    assert lines[1].split("  ")[-2:] == ["faults FALLEN", "a wheel is too fast"] or "a wheel is too fast" in lines[1]
    assert lines[2].endswith("drives_on BALANCING, lies  lies on the ground")
    assert lines[-1] == "2 of 3 runs end otherwise on a floor with a friction of 0.8"
    document = found[0].as_json()
    assert document["on_the_floor"]["command"].endswith("--seed 1 --floor 0.8")
    assert "--floor" not in document["without_slip"]["command"]


def test_nothing_that_ends_otherwise_is_one_line() -> None:
    assert table_of([], 2, 0.8) == "0 of 2 runs end otherwise on a floor with a friction of 0.8\n"


@pytest.mark.mujoco
def test_a_scenario_ends_otherwise_where_the_floor_gives_no_grip() -> None:
    """On ice of 0.01 it cannot balance; the fault is one that it withstands where wheels roll."""
    scenario = replace(load_scenario("segway_can-loses-some"), segments=(Segment(linear=0.3, duration=2.0),), cases=())
    scenario = replace(scenario, faults=(replace(scenario.faults[0], at_s=0.5),))
    assert isinstance(scenario.faults[0], Fault)
    both = on_both([ScenarioRun("test", scenario, "segway", 0, {})], 0.01)
    (difference,) = differences([run_scenario(run) for run in both])
    assert difference.rolling.outcome == "drives_on"
    assert difference.floor.outcome == "faults"
    assert difference.why
