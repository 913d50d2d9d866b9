# SPDX-License-Identifier: MIT
"""The headline: what the robot is doing, its colour, the one thing to do next, and the one button back from a fault."""

from typing import TYPE_CHECKING

import pytest

from segway_ecc.deploy.station.views import Act
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import gone, press_any, shows, there
from tests.deploy.station.page.robot_states import CHECKS, lost

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

FALLEN: dict[str, object] = {"mode": "FAULT", "posture": "FALLEN", "reason": "left.angle is too old"}
STEPS: dict[str, tuple[dict[str, object], str]] = {
    "fallen": ({"posture": "FALLEN"}, "Press Stand up."),
    "resting": ({"posture": "RESTING"}, "Press Stand up."),
    "disarmed": ({"mode": "DISARMED", "posture": "RESTING"}, "Press Stand up."),
    "cart": ({"mode": "DISARMED", "posture": "", "can_stand": False}, "Press Arm."),
    "checks": ({"mode": "DISARMED", "checklist": CHECKS}, "2 pre-arm checks fail: see below."),
    "hold": ({"mode": "HOLD"}, "It holds its place until it is driven."),
    "fault": (FALLEN, "When the cause is gone, press Clear and stand up."),
    "lost": (lost(), "Nothing arrives from it: look at its power and its network, or dismiss it."),
}


@pytest.mark.variants(3)
@pytest.mark.parametrize("state", STEPS)
def test_the_next_step_is_told(page: "Page", station: FakeStation, state: str) -> None:
    fields, step = STEPS[state]
    station.robot(**fields)
    shows(page, "#next", step)


def test_one_that_balances_needs_nothing_and_is_green(page: "Page") -> None:
    shows(page, "#headline", "BALANCING")
    shows(page, "#mode", "ARMED")
    gone(page, "#next")
    there(page, "#mode-box[data-mode=armed]")


def test_one_that_fell_is_never_green(page: "Page", station: FakeStation) -> None:
    station.robot(posture="FALLEN")
    shows(page, "#headline", "FALLEN")
    there(page, "#mode-box[data-mode=fault]")
    shows(page, "#robots .chip", "FALLEN")
    there(page, "#robots .chip[data-mode=fault]")


@pytest.mark.parametrize(("can_stand", "last"), [(True, Act.STAND), (False, Act.ARM)])
def test_one_button_leads_back_from_a_fault(page: "Page", station: FakeStation, can_stand: bool, last: Act) -> None:  # noqa: FBT001 - pytest
    station.robot(**{**FALLEN, "can_stand": can_stand})
    there(page, "#way-back:not([aria-disabled])")
    press_any(page, "#way-back")
    station.wait(lambda: len(station.commands) > 1)
    assert [command.act for command in station.commands] == [Act.CLEAR_FAULT, last]


def test_where_it_is_refused_the_robot_stays_in_its_fault(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.CLEAR_FAULT] = (False, "the bus is still cut")
    station.robot(**FALLEN)
    there(page, "#way-back:not([aria-disabled])")
    press_any(page, "#way-back")
    shows(page, "#command-failure", "Clear fault Alice /alice failed: the bus is still cut")
    assert [command.act for command in station.commands] == [Act.CLEAR_FAULT]


def test_without_control_the_button_says_why(page: "Page", station: FakeStation) -> None:
    station.robot(**{**FALLEN, "controller": "bert"})
    there(page, "#way-back[aria-disabled=true]")
    press_any(page, "#way-back")
    shows(page, "#command-failure", "Clear and stand up: bert has control; take it first")
    assert station.commands == []
