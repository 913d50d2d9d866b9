# SPDX-License-Identifier: MIT
"""What the page shows of what the station tells."""

import re
import time
from typing import TYPE_CHECKING

import pytest

from segway_ecc.deploy.station.views import EventView, SequenceView
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import drawn, gone, load_again, shows, shows_like, tells, there
from tests.deploy.station.page.robot_states import CHECKS, armed, lost
from tests.patience import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

HOSTILE = "<img src=x onerror=\"document.title='owned'\"><b>bold</b>"


def _figures(page: "Page") -> dict[str, str]:
    entries = page.locator(".readouts div").all()
    return {entry.locator("dt").inner_text(): entry.locator("dd").inner_text() for entry in entries}


@pytest.mark.variants(1)
@pytest.mark.parametrize("mode", ["DISARMED", "ARMED", "HOLD", "FAULT"])
def test_mode_is_shown_with_colour_and_reason(page: "Page", station: FakeStation, mode: str) -> None:
    station.robot(mode=mode, reason=f"why {mode}")
    shows(page, "#mode", mode)
    shows(page, "#reason", f"why {mode}")
    shows(page, "#robots .chip", mode)
    assert page.get_attribute("#mode-box", "data-mode") == mode.lower()


def test_the_modes_have_colours_of_their_own(page: "Page", station: FakeStation) -> None:
    colours = set()
    for mode in ("DISARMED", "ARMED", "HOLD", "FAULT"):
        station.robot(mode=mode)
        there(page, f"#mode-box[data-mode={mode.lower()}]")
        colours.add(page.eval_on_selector("#mode-box", "element => getComputedStyle(element).backgroundColor"))
    station.robot(**lost())
    shows(page, "#mode", "LOST")
    colours.add(page.eval_on_selector("#mode-box", "element => getComputedStyle(element).backgroundColor"))
    assert len(colours) == 5


def test_the_figures_are_those_of_the_picture(page: "Page") -> None:
    figures = _figures(page)
    assert figures["Tilt, °"] == "3.0"  # 0.0524 rad
    assert figures["Speed, m/s"] == "0.41"
    assert figures["Turn, rad/s"] == "\u22120.20"
    assert figures["Battery, V"] == "24.9"
    assert figures["Round trip"] == "4.2 ms"
    assert figures["Drives"] == "on"
    assert figures["Control"] == "ann"
    assert figures["Position, m"] == "1.3, \u22120.5"
    assert figures["Heading, °"] == "45"


def test_unreported_value_is_shown_as_dash(page: "Page", station: FakeStation) -> None:
    station.robot("/cart", is_alive=True, name="Cart", mode="ARMED")
    page.click("#robots button:has-text('Cart')")
    shows(page, "#robot-name", "Cart")
    figures = _figures(page)
    assert {figures[name] for name in ("Tilt, °", "Speed, m/s", "Battery, V", "Round trip", "Position, m")} == {
        "\u2013"
    }
    gone(page, "#attitude")


@pytest.mark.parametrize(("pitch", "turned"), [(0.1745, "rotate(10.0)"), (-0.0873, "rotate(-5.0)")])
def test_the_drawing_leans_as_the_robot_does(page: "Page", station: FakeStation, pitch: float, turned: str) -> None:
    """Forward is to the right, so a lean forward turns the body clockwise: a positive angle in SVG."""
    station.robot(pitch=pitch)
    page.wait_for_selector(f"#attitude-body[transform='{turned}']", state="attached")


def test_lost_robot_is_shown_with_growing_age_and_no_figures(page: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob"))
    station.robot(**lost())
    shows(page, "#mode", "LOST")
    shows_like(page, "#reason", r"^No message for \d+\.\d s, since .+\. It was ARMED: armed by ann$")
    shows_like(page, "#robots li:first-child .robot-age", r"^for \d+\.\d s$")
    station.robot(age_s=65.0)
    shows_like(page, "#reason", r"^No message for 1 min \d+ s, since ")
    assert _figures(page)["Tilt, °"] == "\u2013"
    assert _figures(page)["Drives"] == "\u2013", "nobody knows whether its motors are live"
    shows(page, "#plots-state", "stopped")
    assert page.get_attribute("#plots", "data-live") == "false"
    shows(page, "#summary", "2 robots \u00b7 1 lost")
    tells(page, "#alarm", "Alice /alice: LOST")


def test_of_what_is_lost_is_shown_since_when(page: "Page", station: FakeStation) -> None:
    station.robot(**{**lost(), "age_s": 3600.0})
    for element in ("#reason", "#plots-state"):
        shows(page, element, "1 h 0 min")
        hour, minute, second = map(int, re.findall(r"\d\d(?=:)|(?<=:)\d\d", page.inner_text(element)))
        now = time.localtime()
        ago_s = (now.tm_hour - hour) * 3600 + (now.tm_min - minute) * 60 + now.tm_sec - second
        assert 3595 <= ago_s % 86400 <= 3600 + PATIENCE_S


def test_plots_of_a_lost_robot_stand_still_and_are_grey(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest] canvas")
    station.robot(**lost())
    shows(page, "#plots-state", "stopped")
    drawn(page)
    newest = page.get_attribute("#plots", "data-newest")
    station.wait_frames(10)
    assert page.get_attribute("#plots", "data-newest") == newest
    assert "grayscale(1)" in str(page.eval_on_selector("#plots .plot", "element => getComputedStyle(element).filter"))


def test_plots_follow_the_pictures(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest]")
    newest = float(page.get_attribute("#plots", "data-newest") or "nan")
    page.wait_for_function("old => Number(document.querySelector('#plots').dataset.newest) > old + 1", arg=newest)
    assert page.locator("#plots figure:visible").count() == 3
    assert page.get_attribute("#plots", "data-live") == "true"
    assert station.frames > 0


def test_failing_pre_arm_checks_come_first_with_their_fix(page: "Page", station: FakeStation) -> None:
    station.robot(checklist=CHECKS, mode="DISARMED")
    shows(page, "#checklist-summary", "2 checks fail")
    rows = page.locator("#checklist li").all_inner_texts()
    assert [row.split("\n")[0] for row in rows] == ["Fails", "Fails", "Warning", "Passes", "Passes", "Passes"]
    assert "0.31 rad from upright, allowed is 0.1 rad\nTo do: hold the robot upright" in rows[1]
    station.robot(checklist=dict.fromkeys(CHECKS, "ok"))
    shows(page, "#checklist-summary", "All checks pass")
    station.robot(mode="HOLD")
    shows(page, "#checklist-summary", "Armed already")


def test_both_links_and_the_one_in_use(page: "Page") -> None:
    shows(page, "#links", "the line to fall back on")
    whole, can, serial = (link.inner_text().split("\n") for link in page.locator(".link").all())
    assert whole[0] == "link"
    assert can[:3] == ["can", "active", "in use"]
    assert "received 800.2/s \u00b7 sent 400.0/s \u00b7 errors 0.0/s \u00b7 load 18.4 %" in can
    assert serial[:2] == ["serial", "gone"]
    assert "the port is gone" in serial
    assert "in use" not in serial
    page.click("summary:text-is('All of can')")
    shows(page, ".link .rest", "120031")


def test_the_timing_of_the_loop(page: "Page") -> None:
    shows(page, "#timing-rate", "200.00 Hz of 200 Hz")
    shows(page, "#timing-rate", "skipped 1")
    rows = [row.split() for row in page.locator("#timing tr").all_inner_texts()]
    assert ["exchange", "61.3", "92.0", "140.5", "311.7"] in rows


def test_events_come_newest_first_and_once(page: "Page", station: FakeStation) -> None:
    for number in (1, 2):
        station.tell(EventView(number=number, wall_ns=number, robot="/alice", text=f"number {number}", level="error"))
    shows(page, "#events", "number 2")
    station.reconnect()
    station.tell(EventView(number=3, wall_ns=3, robot="", text="number 3", who="bert"))
    shows(page, "#events", "number 3 (bert)")
    assert [text.split("number ")[1][0] for text in page.locator("#events li").all_inner_texts()] == ["3", "2", "1"]


def test_a_sequence_with_its_progress(page: "Page", station: FakeStation) -> None:
    station.robot(sequence=SequenceView(name="eight", fraction=0.426, state="running"))
    shows(page, "#sequence-state", "eight: running, 42 %")
    assert page.eval_on_selector("#sequence-progress", "element => element.value") == 0.426
    station.robot(sequence=SequenceView(name="eight", fraction=0.5, state="failed", reason="HOLD"))
    shows(page, "#sequence-state", "eight: failed: HOLD, 50 %")


def test_text_of_robots_and_people_is_never_html(page: "Page", station: FakeStation) -> None:
    hostile = {"name": HOSTILE, "reason": HOSTILE, "controller": HOSTILE, "mode": HOSTILE}
    health = {"checklist": {HOSTILE: HOSTILE}, "links": {HOSTILE: {"state": HOSTILE, HOSTILE: HOSTILE}}}
    sequence = SequenceView(name=HOSTILE, fraction=0.0, state=HOSTILE, reason=HOSTILE)
    station.robot(**hostile, **health, timing={HOSTILE: HOSTILE}, sequence=sequence)
    station.robot(f"/{HOSTILE}", **lost(name=HOSTILE))
    station.tell(EventView(number=1, wall_ns=1, robot=HOSTILE, text=HOSTILE, who=HOSTILE, level=HOSTILE))
    shows(page, "#events", "<b>bold</b>")
    shows(page, "#reason", "<b>bold</b>")
    shows(page, "#checklist", "<b>bold</b>")
    station.wait_frames(3)
    assert page.locator("img, main b").count() == 0
    assert page.title() == "Base station"


def test_robots_come_by_themselves_and_one_is_selected(page: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob", mode="HOLD", reason="quiet"))
    page.click("#robots button:has-text('Bob')")
    shows(page, "#robot-name", "Bob")
    assert page.get_attribute("#robots button[aria-current=true]", "aria-current") == "true"
    load_again(page)
    shows(page, "#robot-name", "Bob")


def test_the_selection_never_moves_by_itself(page: "Page", station: FakeStation) -> None:
    """STOP goes to the robot that the operator looks at, whoever else appears or goes."""
    shows(page, "#robot-name", "Alice")
    station.robot("/aaron", **armed(name="Aaron"))
    shows(page, "#summary", "2 robots")
    station.wait_frames(3)
    assert page.inner_text("#robot-name") == "Alice /alice"
    del station.script.robots["/alice"]
    shows(page, "#no-robots", "/alice was not found. Choose a robot.")
    gone(page, "#robot")
    assert page.inner_text("#stop-robot") == ""


def test_screen_reader_announces_modes_and_not_numbers(page: "Page", station: FakeStation) -> None:
    station.robot(mode="HOLD", reason="set-points fell silent")
    tells(page, "#announcer", "Alice /alice: HOLD, set-points fell silent")
    station.robot(mode="FAULT", reason="tilt")
    tells(page, "#alarm", "Alice /alice: FAULT, tilt")
    live = page.locator("[aria-live]:not([aria-live=off]), [role=status], [role=alert]")
    assert live.locator(".readouts, table, .plots, #stale-age").count() == 0


def test_identical_picture_leaves_dom_unchanged(page: "Page", station: FakeStation) -> None:
    """So that many robots cost a phone little."""
    for index in range(20):
        station.robot(f"/robot{index:02}", **armed(name=f"Robot {index}"))
    shows(page, "#summary", "21 robots")
    page.evaluate(
        """() => { window.touched = 0;
        const observer = new MutationObserver((changes) => { window.touched += changes.length; });
        for (const id of ["robots", "checklist", "links", "timing", "command-buttons", "mode-box", "bar"]) {
          observer.observe(document.getElementById(id),
            {subtree: true, childList: true, characterData: true, attributes: true});
        } }"""
    )
    station.wait_frames(20)
    assert page.evaluate("window.touched") == 0
    station.robot("/robot07", mode="HOLD")
    page.wait_for_function("() => window.touched > 0")
