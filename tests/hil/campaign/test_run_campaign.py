# SPDX-License-Identifier: MIT
"""Many runs side by side are the runs one by one, to the bit; and what is shown of them."""

from html.parser import HTMLParser

import msgspec
import pytest

from segway_ecc.hil.campaign.page import render
from segway_ecc.hil.campaign.run import run_campaign, runs_of
from segway_ecc.hil.campaign.scenario import (
    Expectation,
    Scenario,
    ScenarioResult,
    ScenarioRun,
    details,
    load_scenario,
    table,
)
from segway_ecc.hil.faults.fault import KINDS, Fault
from segway_ecc.node.sequence.manoeuvre import Segment

SEGMENTS = (Segment(linear=1.0, duration=1.05), Segment(linear=0.2, angular=1.0, duration=0.5))


def short(name: str, seeds: tuple[int, ...] = (0,)) -> Scenario:
    return msgspec.structs.replace(
        load_scenario(name), segments=SEGMENTS, robot="cart-can", parameters=({},), seeds=seeds
    )


def test_trials_are_each_robot_with_each_parameter_set_and_each_seed() -> None:
    scenario = msgspec.structs.replace(
        short("can-cut"), robot=("cart-can", "cart-vesc"), seeds=(4, 2), parameters=({}, {"plant.Inertia": 0.003})
    )
    found = runs_of([("a.yaml", scenario)])
    assert [(t.robot, dict(t.parameters), t.seed) for t in found] == [
        (robot, parameters, seed)
        for robot in ("cart-can", "cart-vesc")
        for parameters in ({}, {"plant.Inertia": 0.003})
        for seed in (4, 2)
    ]
    assert {t.source for t in found} == {"a.yaml"}
    assert [t.seed for t in runs_of([("a.yaml", scenario)], seeds=3)][:3] == [0, 1, 2]


def test_two_processes_give_the_same_bits_as_one() -> None:
    trials = runs_of([("l", short("can-loses-some", seeds=(1, 2, 3))), ("c", short("can-cut", seeds=(0, 7)))])
    done: list[tuple[int, int]] = []
    alone = run_campaign(trials, 1, lambda *progress: done.append(progress))
    both = run_campaign(trials, 2, lambda *_progress: None)

    assert alone == both
    assert [result.digest for result in alone] == [result.digest for result in both]
    assert done == [(n, 5) for n in range(1, 6)]
    assert len({result.digest for result in alone[:3]}) == 3
    assert [(result.scenario, result.seed) for result in alone] == [
        ("can-loses-some", 1),
        ("can-loses-some", 2),
        ("can-loses-some", 3),
        ("can-cut", 0),
        ("can-cut", 7),
    ]


_LATE: tuple[Fault, ...] = tuple(
    Fault(target=target, type=kind, at_s=0.3, name="left" if target == "motor" else None)
    for target, kinds in KINDS.items()
    for kind in kinds
    if target not in {"serial", "parameter", "odometry"}
)


@pytest.mark.variants(1)
@pytest.mark.parametrize("robot", ["cart-can", "cart-odrive"])
def test_each_fault_gives_the_same_bits_where_its_run_has_branched_off(robot: str) -> None:
    """Of every kind, and of those that come again or pass."""
    again = Fault(target="imu", type="garbage", at_s=0.3, for_s=0.02, every_s=0.1)
    scenarios = [
        msgspec.structs.replace(
            short("can-cut"), segments=(Segment(linear=1.0, duration=0.6),), name=f"n{place}", faults=(fault,)
        )
        for place, fault in enumerate([*_LATE, again])
    ]
    trials = [ScenarioRun("test", each, robot, 5, {}) for each in scenarios]
    alone = run_campaign(trials, 1, lambda *_progress: None)
    assert run_campaign(trials, 2, lambda *_progress: None) == alone
    assert len({result.digest for result in alone}) > 25  # which many of the faults of a node leave as it is


def two_results() -> list[ScenarioResult]:
    bad = msgspec.structs.replace(
        short("can-cut"), name="bad", about="", expect=Expectation(outcome="holds", reason="<nothing>")
    )
    trials = [ScenarioRun("can-cut", short("can-cut"), "cart-can", 0, {}), ScenarioRun("b", bad, "cart-can", 0, {})]
    return run_campaign(trials, 1, lambda *_progress: None)


class Page(HTMLParser):
    """Collects what a page loads, its open tags and its texts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.rows = 0
        self.texts: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.loads += [f"{tag} {name}" for name, _ in attributes if name in {"src", "href"}]
        self.rows += tag == "tr"

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_the_report_is_one_page_that_loads_nothing_and_shows_what_is_wrong_first() -> None:
    results = two_results()
    text = render(results, {"Runs": "2 & more"})
    page = Page(text)
    assert page.loads == []
    assert "url(" not in text
    assert "@import" not in text
    assert page.rows == 6  # two tables, each with a head and two rows of a run
    assert "1 of 2 runs as expected." in page.texts
    assert page.texts.index("Not as expected") < page.texts.index("bad") < page.texts.index("As expected")
    assert page.texts.index("As expected") < page.texts.index("can-cut")
    assert results[0].command in page.texts
    assert "2 & more" in page.texts
    assert any("has no '<nothing>'" in text for text in page.texts)


def test_a_report_of_what_is_all_right_has_no_table_of_what_is_not() -> None:
    assert "Not as expected" not in Page(render(two_results()[:1], {})).texts


def test_the_table_names_what_is_wrong_and_the_command_to_repeat_it() -> None:
    lines = table(two_results()).splitlines()
    head = "scenario robot seed outcome detected, ms safe, ms tilt, rad distance, m verdict"
    assert lines[0].split() == head.split()
    assert lines[1].split()[:4] == ["can-cut", "cart-can", "0", "faults"]
    assert lines[1].endswith("as expected")
    assert lines[2].endswith("NOT AS EXPECTED")
    assert lines[3].strip() == "outcome faults, not holds"
    assert lines[5].strip() == "segway-ecc prove fault b --robot cart-can --seed 0"
    assert lines[6] == "1 of 2 runs as expected"


def test_one_result_is_listed_name_by_name() -> None:
    good, bad = map(details, two_results())
    assert (good["outcome"], good["verdict"], good["parameters"]) == ("faults", "as expected", "its own")
    assert "why not" not in good
    assert bad["why not"].startswith("outcome faults, not holds; ")
    assert "tilt, rad" not in good
