# SPDX-License-Identifier: MIT
"""Usable by keyboard and screen reader: names, headings, landmarks, focus, and targets that a finger hits."""

import itertools
from typing import TYPE_CHECKING

import pytest

from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import shows, there
from tests.deploy.station.page.robot_states import CHECKS, armed, lost

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

OPERABLE = "button, input, textarea, select, summary, a:not(.skip)"
NAMES = """(selector) => [...document.querySelectorAll(selector)].filter((e) => e.checkVisibility()).map((e) => {
    const by = (e.getAttribute("aria-labelledby") ?? "").split(" ").filter(Boolean);
    const labels = by.map((id) => document.getElementById(id)?.textContent ?? "");
    labels.push(...[...(e.labels ?? [])].map((l) => l.textContent));
    const name = e.getAttribute("aria-label") || labels.join(" ")
      || (["BUTTON", "A", "SUMMARY"].includes(e.tagName) ? e.textContent : "");
    return [e.outerHTML.slice(0, 90), name.trim()]; })"""


@pytest.fixture(params=["phone", "desktop"])
def full(request: pytest.FixtureRequest, page: "Page", station: FakeStation) -> "Page":
    """The page with everything that it can show."""
    if request.param == "phone":
        page.set_viewport_size({"width": 360, "height": 740})
    station.robot(checklist=CHECKS, stop="confirmed", stop_after_s=0.01, mode="FAULT")
    station.robot("/bob", **armed(name="Bob with a name that is rather long for a phone"))
    shows(page, "#stop-state", "confirmed")
    shows(page, "#robots", "Bob")
    return page


def test_everything_that_can_be_operated_has_a_name(full: "Page") -> None:
    named = full.evaluate(NAMES, OPERABLE + ", [role=group], [role=img], [role=region], nav, section, progress")
    assert len(named) > 30
    assert [element for element, name in named if not name] == []


def test_targets_are_as_large_as_a_finger(full: "Page") -> None:
    boxes = full.evaluate(
        """(selector) => [...document.querySelectorAll(selector)].filter((e) => e.checkVisibility()).map((e) => {
        const box = e.getBoundingClientRect(); return [e.outerHTML.slice(0, 90), box.width, box.height]; })""",
        OPERABLE,
    )
    assert len(boxes) > 15
    assert [box for box in boxes if min(box[1:]) < 44] == []


@pytest.mark.parametrize("why", ["the robot is lost", "the picture is stale"])
def test_what_is_no_longer_valid_can_still_be_read(full: "Page", station: FakeStation, why: str) -> None:
    """It is grey by its colours, whose contrast test_theme.py computes, and not by fading."""
    if why == "the robot is lost":
        station.robot(**lost())
        there(full, "#robot[data-live=false]")
    else:
        station.fall_silent()
        there(full, "body[data-fresh=false]")
    faded = full.evaluate(
        """() => {
        const isFaded = (e) => e !== null && (Number(getComputedStyle(e).opacity) < 0.9 || isFaded(e.parentElement));
        const hasWords = (e) => [...e.childNodes].some((node) => node.nodeType === Node.TEXT_NODE && node.data.trim());
        return [...document.body.querySelectorAll(":not(svg *)")].filter((e) => hasWords(e) && e.checkVisibility()
          && isFaded(e)).map((e) => e.outerHTML.slice(0, 90)); }"""
    )
    assert faded == []


def test_nothing_hangs_over_the_edge(full: "Page") -> None:
    width = full.evaluate("() => document.documentElement.scrollWidth - innerWidth")
    assert width <= 0


def test_headings_go_down_one_level_at_a_time(full: "Page") -> None:
    levels = full.eval_on_selector_all(
        "h1, h2, h3, h4", "all => all.filter((e) => e.checkVisibility()).map((e) => +e.tagName[1])"
    )
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))


def test_landmarks(full: "Page") -> None:
    assert full.eval_on_selector_all("main", "all => all.filter((e) => e.checkVisibility()).length") == 1
    assert full.locator("header, nav, footer").count() == 3
    assert full.get_attribute("html", "lang") == "en"
    ids = full.eval_on_selector_all("[id]", "all => all.map((e) => e.id)")
    assert len(ids) == len(set(ids))
    used = full.eval_on_selector_all(
        "[aria-labelledby], [aria-describedby], label[for]",
        "all => all.flatMap((e) => [e.getAttribute('aria-labelledby'), e.getAttribute('aria-describedby'), e.htmlFor])",
    )
    assert {name for name in used if name} <= set(ids)


def test_every_control_is_reached_with_the_tab_key_and_its_focus_is_seen(full: "Page") -> None:
    wanted = set(
        full.eval_on_selector_all(OPERABLE, "all => all.filter((e) => e.checkVisibility()).map((e) => e.outerHTML)")
    )
    reached = set()
    for _ in range(len(wanted) + 8):
        full.keyboard.press("Tab")
        html, outline, is_covered = full.evaluate(
            """() => { const e = document.activeElement; const box = e.getBoundingClientRect();
            const bar = document.getElementById("bar");
            return [e.outerHTML, getComputedStyle(e).outlineStyle,
              !bar.contains(e) && box.height < 200 && box.bottom > bar.getBoundingClientRect().top + 1]; }"""
        )
        if html.startswith("<body"):
            continue  # past the last one
        reached.add(html)
        assert outline != "none", html
        assert not is_covered, f"behind the bar: {html[:90]}"
    assert {html[:90] for html in wanted - reached} == set()


def test_the_skip_link_leads_to_the_robot(full: "Page") -> None:
    full.keyboard.press("Tab")
    full.keyboard.press("Enter")
    assert full.evaluate("() => document.activeElement.id") == "robot"
    shows(full, "#robot-name", "Alice")


def test_nothing_moves_where_that_is_not_wanted(full: "Page") -> None:
    """The page fixture asks for reduced motion."""
    moving = full.eval_on_selector_all(
        "*", "all => all.filter((e) => parseFloat(getComputedStyle(e).transitionDuration) > 0).length"
    )
    assert moving == 0
