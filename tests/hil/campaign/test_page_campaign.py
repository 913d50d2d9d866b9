# SPDX-License-Identifier: MIT
"""The report in a browser: what belongs to a run is read without scrolling."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from segway_ecc.hil.campaign.page import render
from segway_ecc.hil.campaign.scenario import ScenarioResult
from tests.chromium import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.browser
RESULT = ScenarioResult(
    source="/srv/robots/workshop/scenarios/wheel-speed-frozen-while-it-turns.yaml",
    scenario="wheel-speed-frozen-while-it-turns@0.25",
    robot="segway-odrive",
    seed=3,
    parameters={"plant.BodyMass": 9.123456, "model.TorqueLimit": 1.25, "plant.BodyHeightOfCentre": 0.2345678},
    outcome="drives_on",
    reason="the wheels turn and the body does not: left.velocity is frozen at 1.234 rad/s for more than 0.1 s",
    detection_s=1.2345,
    safe_s=None,
    max_tilt_rad=0.123,
    max_distance_m=12.345,
    switches=(),
    simulated_s=9.0,
    digest="d",
    floor=0.6,
    why_not=("outcome drives_on, not faults", "posture FALLEN, not BALANCING"),
)
WITHIN = """() => [...document.querySelectorAll("code, .again span")].map((each) => {
  const whole = document.createRange();
  whole.selectNodeContents(each);
  const box = whole.getBoundingClientRect();
  return box.left >= 0 && box.right <= document.documentElement.clientWidth;
})"""


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    with chromium() as found:
        yield found


@pytest.mark.parametrize("width", [1280, 800, 390])
def test_the_command_and_the_reasons_are_whole_on_every_screen(browser: "Browser", width: int) -> None:
    page = browser.new_page(viewport={"width": width, "height": 800})
    page.set_content(render([RESULT, RESULT], {"Runs": "2"}))
    assert page.evaluate(WITHIN) == [True] * 8
    assert page.locator("code").first.inner_text() == RESULT.command
    page.close()
