# SPDX-License-Identifier: MIT
"""A phone that lies on its side shows what drives a robot, and what stops it, in one view without scrolling."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from segway_ecc.deploy.station.views import Act
from tests.deploy.station.page.conftest import Tab
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import loaded, shows, there
from tests.deploy.station.page.robot_states import CHECKS, armed

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

SIZES = [(844, 390), (740, 360), (667, 375), (932, 430)]
"""Of phones on their side: Pixel and iPhone, small and large."""
STATES: dict[str, dict[str, object]] = {
    "armed": armed(),
    "disarmed": armed(mode="DISARMED", posture="RESTING", reason="just started", controller="", checklist=CHECKS),
    "fallen": armed(mode="FAULT", posture="FALLEN", reason="the body leans 0.81 rad, beyond 0.8 rad", drives="off"),
    "stopped": armed(mode="FAULT", posture="FALLEN", reason="stopped by ann", stop="confirmed", stop_after_s=0.0123),
}
IN_SIGHT = """(selectors) => {
    const top = document.querySelector("#bar").getBoundingClientRect().top;
    return selectors.filter((selector) => {
      const { left, right, top: above, bottom } = document.querySelector(selector).getBoundingClientRect();
      const end = document.querySelector("#bar").contains(document.querySelector(selector)) ? innerHeight : top;
      return left < 0 || right > innerWidth || above < 0 || bottom > end || right - left === 0; }); }"""
"""Which of some elements are not whole in sight, as the page is when it was opened."""
COCKPIT = ["#stop", "#headline", "#mode", "#attitude", "#readouts", "#joystick", "#speed"]


@pytest.fixture(params=SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def cockpit(request: pytest.FixtureRequest, desktop: Tab, station: FakeStation) -> "Iterator[Page]":
    desktop.clean()
    width, height = request.param
    desktop.page.set_viewport_size({"width": width, "height": height})
    desktop.page.goto(station.url)
    loaded(desktop.page)
    yield desktop.page
    desktop.page.goto("about:blank")
    assert desktop.complaints == []


def middle_of(page: "Page", selector: str) -> tuple[float, float]:
    box = page.locator(selector).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_stop_posture_tilt_and_joystick_are_in_one_view(cockpit: "Page", station: FakeStation, pictures: Path) -> None:
    size = "x".join(str(value) for value in (cockpit.viewport_size or {}).values())
    for name, state in STATES.items():
        station.robot("/alice", **state)
        shows(cockpit, "#headline", str(state["posture"]))
        station.wait_seen(3)
        if state.get("stop"):
            shows(cockpit, "#stop-state", "confirmed")
        cockpit.screenshot(path=pictures / f"cockpit-{name}-landscape-{size}.png")
        assert cockpit.evaluate("() => scrollY") == 0
        assert cockpit.evaluate(IN_SIGHT, COCKPIT) == [], name
        assert cockpit.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0, name


def test_stop_is_as_wide_as_a_hand(cockpit: "Page") -> None:
    box = cockpit.locator("#stop").bounding_box()
    assert box is not None
    assert box["width"] >= 200
    assert box["height"] >= 48


def test_joystick_drives_and_stop_stops_without_scrolling(cockpit: "Page", station: FakeStation) -> None:
    x, y = middle_of(cockpit, "#joystick")
    cockpit.mouse.move(x, y)
    cockpit.mouse.down()
    cockpit.mouse.move(x, y - 50, steps=3)
    station.wait(lambda: any(drive.linear > 0 for drive in station.drives))
    cockpit.mouse.up()
    station.wait(lambda: station.drives[-1].linear == 0)
    cockpit.mouse.click(*middle_of(cockpit, "#stop"))
    station.wait(lambda: any(command.act is Act.STOP for command in station.commands))
    assert cockpit.evaluate("() => scrollY") == 0


def test_what_a_stop_came_to_and_what_stops_all_have_room_beside_it(cockpit: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob"))
    station.robot("/alice", **STATES["stopped"])
    shows(cockpit, "#stop-state", "confirmed")
    assert cockpit.evaluate(IN_SIGHT, ["#stop", "#stop-state", "#stop-clear", "#stop-all"]) == []
    assert cockpit.evaluate("() => document.documentElement.scrollWidth - innerWidth") <= 0


def test_all_else_is_below_and_the_robots_too(cockpit: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob"))
    shows(cockpit, "#robots", "Bob")
    cockpit.locator("#robots button:has-text('Bob')").scroll_into_view_if_needed()
    cockpit.click("#robots button:has-text('Bob')")
    shows(cockpit, "#robot-name", "Bob")
    for selector in ("#command-buttons", "#scene", "#plots", ".events"):
        there(cockpit, selector)
