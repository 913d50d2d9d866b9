# SPDX-License-Identifier: MIT
"""Commands: each waits for its reply where it can be seen, and a failure says why."""

from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest

from segway_ecc.deploy.station.views import Act, SequenceView
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import gone, press, shows, there
from tests.deploy.station.page.robot_states import armed, lost

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

STATES: dict[str, dict[str, object]] = {
    "arm": {"mode": "DISARMED", "controller": ""},
    "disarm": {},
    "clear_fault": {"mode": "FAULT"},
    "stand": {},
    "sit": {},
    "take_control": {"controller": "bert"},
    "release_control": {},
    "play": {},
    "break_off": {"sequence": SequenceView(name="x", fraction=0.5, state="running")},
}
NOT_NOW: dict[str, tuple[dict[str, object], str]] = {
    "arm": ({}, "The robot is in ARMED"),
    "disarm": ({"mode": "DISARMED"}, "The robot is not armed"),
    "clear_fault": ({}, "There is no fault to clear"),
    "stand": ({"controller": "bert"}, "bert has control; take it first"),
    "take_control": ({}, "You have control"),
    "release_control": ({"controller": ""}, "You do not have control"),
    "play": ({"mode": "DISARMED"}, "Arm the robot first"),
    "break_off": ({}, "No sequence is being played"),
    "sit": ({"is_alive": False}, "The robot is lost"),
}


@pytest.mark.variants(2)
@pytest.mark.parametrize("act", STATES)
def test_a_button_asks_the_selected_robot(page: "Page", station: FakeStation, act: str) -> None:
    station.robot(**STATES[act])
    there(page, f"[data-act={act}]:not([aria-disabled])")
    press(page, act)
    station.wait(lambda: station.commands)
    assert [(c.robot, c.act) for c in station.commands] == [("/alice", Act(act))]
    shows(page, "#command-state", "Alice /alice: done")


@pytest.mark.variants(3)
@pytest.mark.parametrize("act", NOT_NOW)
def test_disabled_button_shows_reason(page: "Page", station: FakeStation, act: str) -> None:
    fields, why = NOT_NOW[act]
    station.robot(**fields)
    there(page, f"[data-act={act}][aria-disabled=true]")
    page.focus(f"[data-act={act}]")
    page.keyboard.press("Enter")
    shows(page, "#command-failure", why)
    assert page.evaluate("() => document.activeElement.dataset.act") == act, "it keeps the focus"
    station.wait_frames(2)
    assert station.commands == []


def test_a_command_waits_visibly_and_is_not_sent_twice(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.DISARM] = None
    press(page, "disarm")
    there(page, "[data-act=disarm][aria-busy=true]")
    shows(page, "#command-state", "Disarm Alice /alice: requested")
    press(page, "disarm")
    station.wait_frames(3)
    assert len(station.commands) == 1


def test_refusal_shows_robot_reason(page: "Page", station: FakeStation) -> None:
    station.robot(mode="DISARMED")
    station.script.answers[Act.ARM] = (False, "tilt: 0.31 rad from upright")
    shows(page, "#mode", "DISARMED")
    press(page, "arm")
    shows(page, "#command-failure", "Arm Alice /alice failed: tilt: 0.31 rad from upright")
    assert page.get_attribute("#command-failure", "role") == "alert"
    there(page, "[data-act=arm]:not([aria-busy])")


def test_missing_answer_is_reported(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.DISARM] = None
    press(page, "disarm")
    shows(page, "#command-failure", "Disarm Alice /alice failed: the base station did not answer")
    there(page, "[data-act=disarm]:not([aria-busy])")


def test_a_connection_that_breaks_answers_what_was_asked(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.DISARM] = None
    press(page, "disarm")
    station.wait(lambda: station.commands)
    station.cut()
    shows(page, "#command-failure", "the connection broke before an answer came")


def test_what_a_command_came_to_vanishes_with_the_connection(page: "Page", station: FakeStation) -> None:
    press(page, "disarm")
    shows(page, "#command-state", "Disarm Alice /alice: done")
    station.wait_seen(5)
    shows(page, "#command-state", "Disarm Alice /alice: done")
    station.fall_silent()
    gone(page, "#command-state")
    station.go_on()
    there(page, "body[data-fresh=true]")
    assert page.inner_text("#command-state") == ""


def test_what_a_command_came_to_vanishes_with_control(page: "Page", station: FakeStation) -> None:
    press(page, "disarm")
    shows(page, "#command-state", "Disarm Alice /alice: done")
    station.wait_seen(2)
    station.robot(controller="bert")
    gone(page, "#command-state")


def test_that_control_was_given_up_is_shown_until_somebody_has_it(page: "Page", station: FakeStation) -> None:
    press(page, "release_control")
    station.robot(controller="")
    shows(page, "#command-state", "Release control Alice /alice: done")
    station.wait_seen(5)
    shows(page, "#command-state", "Release control Alice /alice: done")
    station.robot(controller="bert")
    gone(page, "#command-state")


def test_stand_and_sit_are_there_where_a_robot_can(page: "Page", station: FakeStation) -> None:
    assert page.locator("[data-act=stand]").is_visible()
    station.robot(can_stand=False)
    gone(page, "[data-act=stand]")
    gone(page, "[data-act=sit]")


def test_a_lost_robot_can_be_dismissed(page: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob"))
    shows(page, "#robots", "Bob")
    gone(page, "[data-act=dismiss]")
    station.robot(**lost())
    there(page, "[data-act=dismiss]:not([aria-disabled])")
    station.script.react = lambda asked: station.script.robots.pop(asked.robot)
    press(page, "dismiss")
    station.wait(lambda: station.commands)
    assert [(c.robot, c.act) for c in station.commands] == [("/alice", Act.DISMISS)]
    shows(page, "#command-state", "Dismiss Alice /alice: done")
    shows(page, "#summary", "1 robot")
    shows(page, "#no-robots", "/alice was not found. Choose a robot.")


NOT_DISMISSED: dict[str, dict[str, object]] = {
    "bert has control; take it first": {"controller": "bert"},
    "Clear the stop first": {"stop": "requested", "stop_kept": True},
}


@pytest.mark.parametrize("why", NOT_DISMISSED)
def test_why_a_lost_robot_cannot_be_dismissed(page: "Page", station: FakeStation, why: str) -> None:
    station.robot(**{**lost(), **NOT_DISMISSED[why]})
    there(page, "[data-act=dismiss][aria-disabled=true]")
    press(page, "dismiss")
    shows(page, "#command-failure", f"Dismiss: {why}")
    station.wait_frames(2)
    assert station.commands == []


def test_a_viewer_sees_everything_and_commands_nothing_but_a_stop(page: "Page", station: FakeStation) -> None:
    station.script.hello = msgspec.structs.replace(station.script.hello, role="viewer", who="vera")
    station.cut()
    shows(page, "#commands-reason", "You are signed in as a viewer")
    shows(page, "#who", "vera, viewer")
    shows(page, "#mode", "ARMED")
    buttons = page.locator("[data-act]:visible")
    assert buttons.count() == 9
    assert {button.get_attribute("aria-disabled") for button in buttons.all()} == {"true"}
    assert page.locator("#stop").get_attribute("aria-disabled") is None
    gone(page, "#bundle-link")
    press(page, "disarm")
    shows(page, "#command-failure", "viewer")
    station.wait_frames(2)
    assert station.commands == []


def test_a_sequence_is_loaded_from_a_file_and_played(page: "Page", station: FakeStation, tmp_path: Path) -> None:
    text = "segments:\n  - {linear: 0.1, duration: 1}\n"
    path = tmp_path / "eight.yaml"
    path.write_text(text, encoding="utf-8")
    page.set_input_files("#sequence-file", path)
    page.wait_for_function("() => document.querySelector('#sequence-name').value === 'eight.yaml'")
    press(page, "play")
    station.wait(lambda: station.commands)
    assert (station.commands[0].text, station.commands[0].name) == (text, "eight.yaml")


def test_a_sequence_is_typed_and_played(page: "Page", station: FakeStation) -> None:
    page.fill("#sequence-text", "segments: [{duration: 2}]")
    page.fill("#sequence-name", "rest")
    press(page, "play")
    station.wait(lambda: station.commands)
    assert (station.commands[0].text, station.commands[0].name) == ("segments: [{duration: 2}]", "rest")


@pytest.mark.parametrize(("text", "why"), [("  \n", "is empty"), ("é" * 32_769, "longer than 65536 bytes")])
def test_a_sequence_that_no_station_takes_is_not_sent(page: "Page", station: FakeStation, text: str, why: str) -> None:
    page.fill("#sequence-text", text)
    press(page, "play")
    shows(page, "#command-failure", why)
    station.wait_frames(2)
    assert station.commands == []


def test_a_file_that_is_too_large_is_not_read(page: "Page", tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    path.write_bytes(b"#" * 65_537)
    page.set_input_files("#sequence-file", path)
    shows(page, "#command-failure", "large.yaml has 65537 bytes")
    assert page.input_value("#sequence-name") == "typed"


def test_logs_and_the_support_bundle_can_be_had(page: "Page", station: FakeStation) -> None:
    with page.expect_download() as download:
        page.click("#bundle-link")
    assert download.value.suggested_filename == "bundle.zip"
    assert station.fetched == ["/alice"]
    assert page.get_attribute("#logs-link", "href") == "/logs"
