# SPDX-License-Identifier: MIT
"""What can be done to a simulated robot, on its page; a real one's page has nothing of it."""

from typing import TYPE_CHECKING

import msgspec
import pytest

from segway_ecc.deploy.station.views import Act, TrialView
from tests.deploy.station.page.fake_station import HELLO, FakeStation
from tests.deploy.station.page.page_waits import gone, load_again, press_any, shows, there

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

CUT = TrialView(name="cut", title="Cut the cable", effect="nothing passes")
BACK = TrialView(name="recover", title="Bring it back", effect="everything is repaired")


def simulated(page: "Page", station: FakeStation, role: str = "operator") -> None:
    station.script.hello = msgspec.structs.replace(HELLO, role=role, trials=(CUT, BACK))
    load_again(page)
    there(page, "#trials")


def test_a_real_robot_has_none(page: "Page", station: FakeStation) -> None:
    gone(page, "#trials")
    assert station.commands == []


def test_a_trial_is_asked_for_and_its_outcome_shown(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.TRY] = (True, "zero torque after 38 ms; FAULT: the cable is cut")
    simulated(page, station)
    press_any(page, "[data-trial=cut]")
    station.wait(lambda: station.commands)
    assert [(c.robot, c.act, c.name) for c in station.commands] == [("/alice", Act.TRY, "cut")]
    shows(page, "#trial-results", "Cut the cable: zero torque after 38 ms; FAULT: the cable is cut")


def test_one_at_a_time(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.TRY] = None
    simulated(page, station)
    press_any(page, "[data-trial=cut]")
    shows(page, "#trial-state", "Cut the cable: nothing passes")
    there(page, "[data-trial=recover][aria-disabled=true]")
    press_any(page, "[data-trial=recover]")
    shows(page, "#command-failure", "Bring it back: Wait for what the last one led to")
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert [command.name for command in station.commands] == ["cut"]


def test_a_trial_that_failed_says_why(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.TRY] = (False, "it did not come back within 20 s")
    simulated(page, station)
    press_any(page, "[data-trial=recover]")
    shows(page, "#trial-results", "Bring it back: failed: it did not come back within 20 s")


def test_a_viewer_only_watches(page: "Page", station: FakeStation) -> None:
    simulated(page, station, role="viewer")
    press_any(page, "[data-trial=cut]")
    shows(page, "#command-failure", "You are signed in as a viewer")
    assert station.commands == []
