# SPDX-License-Identifier: MIT
"""STOP: from anywhere, at once, latched, and confirmed."""

import re
from typing import TYPE_CHECKING

import msgspec
import pytest

from segway_ecc.deploy.station.views import Act, Command
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import gone, shows, tells, there
from tests.deploy.station.page.robot_states import armed

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

ANYWHERE = [
    "body",
    "#robots button",
    "[data-act=disarm]",
    "#speed",
    "#sequence-name",
    "#sequence-text",
    "#logs-link",
    "#stop",
]
SPACE_STOPS = ["body", "#speed", "#logs-link", ".events .scroll"]
TYPED_IN = ["#sequence-name", "#sequence-text"]
PRESSED = ["[data-act=disarm]", "[data-act=arm]", "#robots button", "#change-user"]
STOPS = [*((place, " ") for place in SPACE_STOPS), *((place, "Escape") for place in ANYWHERE)]
GAMEPAD = """(state) => { window.pads = [{index: 0, mapping: state.mapping ?? "standard",
    buttons: state.held.map((pressed) => ({pressed}))}];
    navigator.getGamepads = () => { window.looks += 1; return window.pads; };
    dispatchEvent(new Event("gamepadconnected")); }"""


def _acts(station: FakeStation) -> list[Act]:
    return [command.act for command in station.commands]


@pytest.mark.variants(5)
@pytest.mark.parametrize(("place", "key"), STOPS)
def test_one_key_stops_from_anywhere(page: "Page", station: FakeStation, place: str, key: str) -> None:
    if place != "body":
        page.focus(place)
    page.keyboard.press(key)
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP]
    assert station.commands[0].robot == "/alice"


@pytest.mark.variants(2)
@pytest.mark.parametrize("place", PRESSED)
def test_space_never_stops_from_a_button_that_has_the_focus(page: "Page", station: FakeStation, place: str) -> None:
    page.evaluate("() => addEventListener('click', (event) => { window.pressed = event.target; }, true)")
    page.focus(place)
    page.keyboard.press(" ")
    page.wait_for_function("place => window.pressed?.closest(place)", arg=place)
    station.wait_frames(3)
    assert Act.STOP not in _acts(station)


def test_space_presses_the_stop_button_once(page: "Page", station: FakeStation) -> None:
    page.focus("#stop")
    page.keyboard.press(" ")
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP]


@pytest.mark.parametrize("key", ["Enter", " ", "Escape"])
def test_the_keyboard_presses_stop_after_a_pointer_slipped_off_it(page: "Page", station: FakeStation, key: str) -> None:
    page.hover("#stop")
    page.mouse.down()
    page.mouse.move(5, 5)
    page.mouse.up()
    station.wait(lambda: station.commands)
    page.focus("#stop")
    page.keyboard.press(key)
    station.wait(lambda: len(station.commands) == 2)
    assert _acts(station) == [Act.STOP, Act.STOP]


def test_space_stops_after_a_button_was_clicked(page: "Page", station: FakeStation) -> None:
    """The pointer's click is over: what is hit in haste afterwards is not to press that button again."""
    page.click("[data-act=disarm]")
    page.keyboard.press(" ")
    station.wait(lambda: len(station.commands) == 2)
    assert _acts(station) == [Act.DISARM, Act.STOP]


def test_a_browser_that_does_not_name_the_pointer_of_a_click_is_understood(page: "Page", station: FakeStation) -> None:
    """A click is a PointerEvent in Firefox from 129 on; everywhere it counts the clicks, of a keyboard none."""
    page.focus("[data-act=disarm]")
    page.evaluate(
        """() => { const click = () => new MouseEvent("click", {detail: 1, bubbles: true});
        const [stop, disarm] = ["#stop", "[data-act=disarm]"].map((name) => document.querySelector(name));
        stop.dispatchEvent(new PointerEvent("pointerdown", {bubbles: true}));
        stop.dispatchEvent(click());
        disarm.dispatchEvent(click()); }"""
    )
    station.wait(lambda: Act.DISARM in _acts(station))
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP, Act.DISARM]
    assert page.evaluate("() => document.activeElement === document.body")


@pytest.mark.variants(1)
@pytest.mark.parametrize(("width", "height"), [(740, 360), (360, 740), (1000, 600), (1280, 800), (844, 390)])
def test_stop_stays_where_it_was_pressed(page: "Page", station: FakeStation, width: int, height: int) -> None:
    """A second press in haste hits STOP again, and not what clears it."""
    page.set_viewport_size({"width": width, "height": height})
    station.robot("/bob", **armed(name="Bob"))
    there(page, "#stop-all")
    box = page.locator("#stop").bounding_box()
    assert box is not None
    page.keyboard.press("Escape")
    station.robot(stop="confirmed", stop_after_s=0.0123, mode="FAULT", drives="off", posture="FALLEN")
    there(page, "#stop-clear")
    shows(page, "#stop-state", "Stop confirmed after")
    hit = page.evaluate(
        """({x, y, width, height}) => [0.1, 0.5, 0.9].map(
            (share) => document.elementFromPoint(x + share * width, y + height / 2).closest("button").id)""",
        box,
    )
    assert hit == ["stop", "stop", "stop"]


def test_a_gamepads_button_stops_once_for_each_press(page: "Page", station: FakeStation) -> None:
    page.focus("[data-act=disarm]")
    page.evaluate(GAMEPAD, {"held": [True, False]})
    station.wait_frames(3)
    assert station.commands == [], "A is not the button that stops"
    page.evaluate("() => { window.pads[0].buttons[1].pressed = true; }")
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP]
    page.evaluate("() => { window.pads[0].buttons[1].pressed = false; }")
    page.evaluate("() => { window.looks = 0; }")
    page.wait_for_function("() => window.looks > 1")
    page.evaluate("() => { window.pads[0].buttons[1].pressed = true; }")
    station.wait(lambda: len(station.commands) == 2)
    assert _acts(station) == [Act.STOP, Act.STOP]


def test_the_press_that_shows_a_gamepad_stops(page: "Page", station: FakeStation) -> None:
    """Browsers hide a gamepad until one of its buttons is pressed."""
    page.evaluate(GAMEPAD, {"held": [False, True]})
    station.wait(lambda: station.commands)
    assert _acts(station) == [Act.STOP]


def test_a_gamepad_that_was_gone_meanwhile_stops_again(page: "Page", station: FakeStation) -> None:
    """Its batteries were empty while the button was held; another one is there all the time."""
    page.evaluate(GAMEPAD, {"held": [False, False]})
    page.evaluate("() => { window.pads.push({index: 1, mapping: 'standard', buttons: [{}, {pressed: true}]}); }")
    station.wait(lambda: station.commands)
    page.evaluate("() => { window.gone = window.pads.pop(); dispatchEvent(new Event('gamepaddisconnected')); }")
    page.evaluate("() => { window.pads.push(window.gone); dispatchEvent(new Event('gamepadconnected')); }")
    station.wait(lambda: len(station.commands) == 2)
    assert _acts(station) == [Act.STOP, Act.STOP]


def test_any_button_of_an_unknown_gamepad_stops(page: "Page", station: FakeStation) -> None:
    page.evaluate(GAMEPAD, {"mapping": "", "held": [False, False, False, True]})
    station.wait(lambda: station.commands)
    assert _acts(station) == [Act.STOP]


def test_without_a_robot_a_stop_is_not_passed_over_in_silence(page: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob"))
    del station.script.robots["/alice"]
    shows(page, "#no-robots", "/alice was not found")
    page.keyboard.press("Escape")
    shows(page, "#command-failure", "Stop: no robot is selected, and nothing was stopped")
    assert station.commands == []


@pytest.mark.parametrize("place", TYPED_IN)
def test_space_in_a_text_field_types(page: "Page", station: FakeStation, place: str) -> None:
    page.fill(place, "")
    page.focus(place)
    page.keyboard.type("a b")
    station.wait_frames(3)
    assert page.input_value(place) == "a b"
    assert station.commands == []


def test_a_key_that_is_held_stops_once(page: "Page", station: FakeStation) -> None:
    for _ in range(4):
        page.keyboard.down("Escape")
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP]


def test_the_button_acts_when_it_is_touched_and_not_when_it_is_left(page: "Page", station: FakeStation) -> None:
    page.hover("#stop")
    page.mouse.down()
    station.wait(lambda: station.commands)
    page.mouse.up()
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP]


def test_the_button_can_be_pressed_with_enter(page: "Page", station: FakeStation) -> None:
    page.focus("#stop")
    page.keyboard.press("Enter")
    station.wait(lambda: station.commands)
    assert _acts(station) == [Act.STOP]


def test_a_stop_is_latched_until_it_is_cleared(page: "Page", station: FakeStation) -> None:
    page.keyboard.press("Escape")
    shows(page, "#stop-state", "Stop requested")
    station.robot(stop="requested")
    station.wait_seen(4)
    shows(page, "#stop-state", "Stop requested")
    station.robot(stop="confirmed", stop_after_s=0.0123, mode="FAULT", drives="off", reason="stopped by ann")
    shows(page, "#stop-state", "(12 ms at the station): drives off")
    station.wait_frames(10)
    shows(page, "#stop-state", "(12 ms at the station): drives off")
    page.click("#stop-clear")
    station.wait(lambda: Act.CLEAR_FAULT in _acts(station))
    assert set(_acts(station)) == {Act.STOP, Act.CLEAR_FAULT}
    shows(page, "#stop-state", "Stop confirmed")  # it is the robot that says when it is over
    station.robot(stop="", stop_after_s=None, mode="DISARMED", reason="fault cleared")
    gone(page, "#stop-clear")
    assert page.inner_text("#stop-state") == ""


def test_the_time_to_confirmation_is_from_the_key_to_the_picture(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.STOP] = None
    page.keyboard.press("Escape")
    station.robot(stop="requested")
    station.wait_seen(15)  # the picture is on the way for long, and the station knows nothing of it
    station.robot(stop="confirmed", stop_after_s=0.0123, mode="FAULT", drives="off")
    shows(page, "#stop-state", "(12 ms at the station)")
    found = re.match(r"Stop confirmed after (\d+) ms ", page.inner_text("#stop-state"))
    assert found is not None
    assert int(found[1]) >= 500


def test_a_second_stop_is_not_confirmed_by_the_first(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.STOP] = None
    station.robot(stop="confirmed", stop_after_s=0.01, mode="FAULT", drives="off")
    shows(page, "#stop-state", "Stop confirmed 10 ms after")
    page.keyboard.press("Escape")
    shows(page, "#stop-state", "Stop confirmed: drives off")
    station.wait_frames(3)
    assert page.inner_text("#stop-state") == "Stop confirmed: drives off"
    station.robot(stop="requested", stop_after_s=None)
    station.wait_seen(2)
    station.robot(stop="confirmed", stop_after_s=0.02)
    shows(page, "#stop-state", "Stop confirmed after")
    shows(page, "#stop-state", "(20 ms at the station)")


@pytest.mark.parametrize("then", ["confirmed", ""])
def test_a_second_stop_that_was_lost_is_sent_again_whatever_became_of_the_first(
    page: "Page", station: FakeStation, then: str
) -> None:
    """The station does not have it yet: that the first is confirmed, or was cleared, says nothing of it."""
    station.script.answers[Act.STOP] = None
    station.robot(stop="confirmed", stop_after_s=0.01, mode="FAULT", drives="off")
    shows(page, "#stop-state", "Stop confirmed 10 ms after")
    page.keyboard.press("Escape")
    station.wait(lambda: station.commands)
    station.wait_seen(2)
    station.robot(stop=then)
    station.wait_seen(2)
    station.cut()
    station.wait(lambda: len(station.commands) == 2)
    assert _acts(station) == [Act.STOP, Act.STOP]


def test_zero_commands_confirm_stop_and_are_shown_as_such(page: "Page", station: FakeStation) -> None:
    station.robot(stop="confirmed", stop_after_s=0.0049, mode="FAULT", drives="none", is_zero=True)
    shows(page, "#stop-state", "Stop confirmed 4.9 ms after it reached the station: commands zero")


def test_a_confirmation_is_of_its_picture_where_nothing_came_since(page: "Page", station: FakeStation) -> None:
    """The robot may have been cleared and armed meanwhile."""
    station.robot(stop="confirmed", stop_after_s=0.0123, mode="FAULT", drives="off")
    there(page, ".bar[data-stop=confirmed]")
    station.robot(is_alive=False, age_s=3.0)
    there(page, ".bar[data-stop=past]")
    shows(page, "#stop-state", "drives off, as of ")
    station.robot(is_alive=True)
    there(page, ".bar[data-stop=confirmed]")
    station.fall_silent()
    there(page, ".bar[data-stop=past]")
    shows(page, "#stop-state", "drives off, as of ")


@pytest.mark.parametrize(("posture", "way"), [("FALLEN", "stand up"), ("", "arm")])
def test_clear_stop_shows_both_commands_of_the_way_back(
    page: "Page", station: FakeStation, posture: str, way: str
) -> None:
    station.robot(stop="confirmed", stop_after_s=0.01, mode="FAULT", posture=posture, drives="off")
    shows(page, "#stop-clear", "Clear stop")
    page.wait_for_selector(f"#stop-clear[title='The way back: clear stop, then {way}']")


def test_unconfirmed_stop_is_shown(page: "Page", station: FakeStation) -> None:
    page.keyboard.press("Escape")
    station.robot(stop="requested")
    shows(page, "#stop-state", "not confirmed")


def test_failed_stop_shows_reason(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.STOP] = (False, "no answer within 2 s")
    page.keyboard.press("Escape")
    shows(page, "#stop-state", "Stop failed: no answer within 2 s")
    shows(page, "#command-failure", "Stop Alice /alice failed: no answer within 2 s")
    station.robot(stop="requested")
    station.wait_seen(4)
    station.robot(stop="confirmed", stop_after_s=3.0, mode="FAULT", drives="off")
    shows(page, "#stop-state", "(3000 ms at the station): drives off")


def test_stop_without_connection_is_shown_and_sent_after_reconnect(page: "Page", station: FakeStation) -> None:
    station.script.accepts = False
    station.cut()
    there(page, "body[data-fresh=false]")
    page.keyboard.press("Escape")
    shows(page, "#stop-state", "Stop not sent: no connection")
    station.script.accepts = True
    page.evaluate("dispatchEvent(new Event('online'))")
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert _acts(station) == [Act.STOP]


def test_stop_that_could_not_be_sent_is_sent_however_late(page: "Page", station: FakeStation) -> None:
    page.clock.install()
    station.script.accepts = False
    station.cut()
    there(page, "body[data-fresh=false]")
    page.keyboard.press("Escape")
    shows(page, "#stop-state", "Stop not sent: no connection")
    page.clock.fast_forward("02:00:00")
    shows(page, "#stop-state", "Stop not sent: no connection")
    station.script.accepts = True
    page.clock.resume()
    page.evaluate("dispatchEvent(new Event('online'))")
    station.wait(lambda: station.commands)
    assert _acts(station)[0] == Act.STOP


def test_stop_that_could_not_be_sent_can_be_taken_back(page: "Page", station: FakeStation) -> None:
    station.script.accepts = False
    station.cut()
    there(page, "body[data-fresh=false]")
    page.keyboard.press("Escape")
    shows(page, "#stop-state", "Stop not sent: no connection")
    page.click("#stop-clear")
    gone(page, "#stop-clear")
    station.script.accepts = True
    page.evaluate("dispatchEvent(new Event('online'))")
    there(page, "body[data-fresh=true]")
    station.wait_frames(30)
    assert station.commands == []


def test_station_that_forgot_a_robot_is_sent_the_stop_again_by_namespace(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.STOP] = None
    page.keyboard.press("Escape")
    station.robot(stop="requested")
    station.wait(lambda: station.commands)
    alice = station.script.robots.pop("/alice")  # the station is started again, and has not found the robot
    station.cut()
    station.wait(lambda: len(station.commands) > 1)
    assert {(c.robot, c.act) for c in station.commands} == {("/alice", Act.STOP)}
    station.script.robots["/alice"] = msgspec.structs.replace(alice, stop="requested", stop_kept=True)
    station.wait_frames(5)
    count = len(station.commands)
    station.wait_frames(30)
    assert len(station.commands) == count


def test_stop_that_the_station_keeps_is_not_sent_again(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.STOP] = None
    page.keyboard.press("Escape")
    station.robot(stop="requested", stop_kept=True)
    shows(page, "#stop-state", "Stop requested")
    station.wait_seen(4)
    station.reconnect()
    there(page, "body[data-fresh=true]")
    station.wait_seen(30)
    assert _acts(station) == [Act.STOP]


def test_stop_that_no_picture_reports_is_sent_again(page: "Page", station: FakeStation) -> None:
    station.script.answers[Act.STOP] = None
    page.keyboard.press("Escape")
    station.wait_seen(10)
    assert _acts(station) == [Act.STOP]
    station.limit_age(0.5)
    station.wait(lambda: len(station.commands) >= 4)
    station.robot(stop="requested", stop_kept=True)
    station.wait_seen(2)
    count = len(station.commands)
    station.wait_seen(10)
    assert len(station.commands) == count


def test_stop_of_a_lost_robot_can_be_taken_back(page: "Page", station: FakeStation) -> None:
    station.robot(is_alive=False)
    shows(page, "#mode", "LOST")
    page.keyboard.press("Escape")
    station.robot(stop="requested", stop_kept=True)
    shows(page, "#stop-state", "not confirmed")
    page.click("#stop-clear")
    station.wait(lambda: len(station.commands) == 2)
    assert _acts(station) == [Act.STOP, Act.CANCEL_STOP]
    station.robot(stop="", stop_kept=False)
    gone(page, "#stop-clear")


def test_a_stop_that_another_operator_cleared_is_over_here_too(page: "Page", station: FakeStation) -> None:
    page.keyboard.press("Escape")
    station.robot(stop="confirmed", stop_after_s=0.01, mode="FAULT", drives="off")
    shows(page, "#stop-state", "Stop confirmed")
    station.robot(stop="", mode="DISARMED")
    gone(page, "#stop-clear")


def test_a_lost_robot_is_stopped_all_the_same(page: "Page", station: FakeStation) -> None:
    station.robot(is_alive=False)
    shows(page, "#mode", "LOST")
    page.keyboard.press("Escape")
    station.wait(lambda: station.commands)
    assert _acts(station) == [Act.STOP]


def test_a_robot_that_another_controls_is_stopped_all_the_same(page: "Page", station: FakeStation) -> None:
    station.robot(controller="bert")
    shows(page, "#drive-reason", "bert has control")
    page.keyboard.press(" ")
    station.wait(lambda: station.commands)
    assert _acts(station) == [Act.STOP]


def test_all_robots_can_be_stopped_together(page: "Page", station: FakeStation) -> None:
    gone(page, "#stop-all")
    station.robot("/bob", **armed(name="Bob"))
    page.click("#stop-all")
    station.wait(lambda: len(station.commands) == 2)
    assert [(c.robot, c.act) for c in station.commands] == [("/alice", Act.STOP), ("/bob", Act.STOP)]


def test_the_key_stops_the_robot_that_is_selected(page: "Page", station: FakeStation) -> None:
    station.robot("/bob", **armed(name="Bob"))
    page.click("#robots button:has-text('Bob')")
    shows(page, "#stop", "STOP Bob")
    page.keyboard.press("Escape")
    station.wait(lambda: station.commands)
    assert station.commands[0].robot == "/bob"


def test_robots_of_one_name_are_told_apart_wherever_they_are_named(page: "Page", station: FakeStation) -> None:
    """Two carts: STOP, the headline and what became of a command have the namespace too."""
    station.robot("/alice", name="cart")
    station.robot("/bob", **armed(name="cart"))
    shows(page, "#stop", "STOP cart /alice")
    shows(page, "#robot-name", "cart /alice")
    page.click("#robots button:has-text('/bob')")
    shows(page, "#stop", "STOP cart /bob")
    shows(page, "#robot-name", "cart /bob")
    page.keyboard.press("Escape")
    shows(page, "#command-state", "Stop cart /bob: done")
    station.robot("/bob", mode="FAULT", reason="stopped")
    tells(page, "#alarm", "cart /bob: FAULT")


def test_the_namespace_of_the_root_is_not_shown(page: "Page", station: FakeStation) -> None:
    station.robot("/", **armed(name="cart"))
    page.click("#robots button:has-text('cart')")
    page.wait_for_function("() => document.querySelector('#stop-robot').textContent === 'cart'")


def test_viewer_may_stop(page: "Page", station: FakeStation) -> None:
    station.script.hello = msgspec.structs.replace(station.script.hello, role="viewer")
    station.cut()
    shows(page, "#commands-reason", "viewer")
    page.keyboard.press("Escape")
    station.wait(lambda: station.commands)
    assert _acts(station) == [Act.STOP]


def test_the_bar_is_in_sight_wherever_one_scrolls(page: "Page", station: FakeStation) -> None:
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    box = page.locator("#stop").bounding_box()
    assert box is not None
    assert 0 <= box["y"] <= 800 - box["height"]
    reached = page.evaluate(
        "([x, y]) => document.elementFromPoint(x, y).closest('button').id", [box["x"] + 9, box["y"] + 9]
    )
    assert reached == "stop"
    assert station.commands == []


def test_a_reply_belongs_to_its_own_command(page: "Page", station: FakeStation) -> None:
    """A second stop that fails does not mark the first as answered."""
    output: list[Command] = []
    station.script.react = output.append
    station.script.answers[Act.STOP] = None
    page.keyboard.press("Escape")
    station.wait(lambda: output)
    station.script.answers[Act.DISARM] = (True, "disarmed")
    page.click("[data-act=disarm]")
    shows(page, "#command-state", "Disarm Alice /alice: disarmed")
    shows(page, "#stop-state", "Stop requested")
