# SPDX-License-Identifier: MIT
"""What the 3-D scene shows beside the robot: its tilt limits, and the way that a sequence leads."""

from typing import TYPE_CHECKING, Any

import pytest

from segway_ecc.deploy.station.views import SequenceView
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import gone, shows, there
from tests.deploy.station.page.robot_states import lost

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

LIMITS = {"tilt_limit_rad": 0.8, "down_rad": 0.4}


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        ({"pitch": 0.1}, [0.4, 0.8, 0.3, "ok"]),
        ({"pitch": -0.1}, [0.4, 0.8, 0.3, "ok"]),
        ({"pitch": 0.28}, [0.4, 0.8, 0.12, "near"]),
        ({"pitch": -0.5}, [0.4, 0.8, -0.1, "beyond"]),
        ({"pitch": 0.5, "posture": "STANDING UP"}, [0.8, 0.8, 0.3, "ok"]),
        ({"pitch": 0.5, "posture": "RESTING"}, [0.8, 0.8, 0.3, "ok"]),
        ({"pitch": 0.5, "posture": "RESTING", "mode": "DISARMED"}, [0.8, 0.8, 0.3, "off"]),
        ({"pitch": 0.5, "posture": "FALLEN", "mode": "FAULT"}, [0.4, 0.8, -0.1, "off"]),
        ({"pitch": 0.1, "mode": "HOLD", "down_rad": None}, [0.8, 0.8, 0.7, "ok"]),
        ({"pitch": None}, None),
        ({"pitch": 0.1, "down_rad": None, "tilt_limit_rad": None}, None),
    ],
)
def test_nearness_of_the_limit_is_that_of_the_nearer_one_in_force(
    page: "Page", robot: dict[str, Any], expected: list[object] | None
) -> None:
    found = page.evaluate(
        """async (robot) => {
        const { tiltLimits } = await import("/static/tilt_limits.js");
        const limits = tiltLimits(robot);
        return limits && [limits.first, limits.last, Number(limits.left.toFixed(9)), limits.kind]; }""",
        {"mode": "ARMED", "posture": "BALANCING", **LIMITS, **robot},
    )
    assert found == expected


def test_fan_around_the_robot_shows_how_near_its_limit_is(page: "Page", station: FakeStation) -> None:
    there(page, "#scene[data-tilt=ok]")
    shows(page, "#readouts", "To limit, \u00b0\n19.9")
    station.robot(pitch=0.35)
    there(page, "#scene[data-tilt=near]")
    station.robot(pitch=-0.45)
    there(page, "#scene[data-tilt=beyond]")
    shows(page, "#readouts", "To limit, \u00b0\n\u22122.9")
    station.robot(mode="DISARMED")
    there(page, "#scene[data-tilt=off]")
    station.robot(tilt_limit_rad=None, down_rad=None)
    there(page, "#scene[data-tilt='']")
    shows(page, "#readouts", "To limit, \u00b0\n\u2013")


def test_robot_that_is_lost_has_no_nearness(page: "Page", station: FakeStation) -> None:
    there(page, "#scene[data-tilt=ok]")
    station.robot(**lost())
    shows(page, "#readouts", "To limit, \u00b0\n\u2013")


def test_way_of_a_sequence_is_drawn_while_it_plays(page: "Page", station: FakeStation) -> None:
    there(page, "#scene[data-planned='0']")
    path = [(0.1 * number, 0.0) for number in range(21)]
    station.robot(sequence=SequenceView(name="line", fraction=0.1, state="running", path=path))
    there(page, "#scene[data-planned='20']")
    station.robot(sequence=SequenceView(name="line", fraction=1.0, state="done"))
    there(page, "#scene[data-planned='0']")


def test_view_from_above_and_from_behind(page: "Page") -> None:
    there(page, "#scene[data-tilt=ok]")
    page.click("#scene-top")
    there(page, "#scene-top[aria-pressed=true]")
    shows(page, "#scene-top", "View from behind")
    page.click("#scene-top")
    shows(page, "#scene-top", "View from above")


def test_robot_that_never_told_where_it_is_has_no_scene(page: "Page", station: FakeStation) -> None:
    station.robot("/bob", name="Bob", is_alive=True, mode="ARMED", x=None)
    page.click("#robots button:has-text('Bob')")
    shows(page, "#robot-name", "Bob")
    gone(page, "#scene-panel")
