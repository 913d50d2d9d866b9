# SPDX-License-Identifier: MIT
"""Driving is dead-man: each way in which the hold can end sends zero at once, and nothing after it."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from segway_ecc.deploy.station.views import Act
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import shows, there
from tests.deploy.station.page.robot_states import armed, lost

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

HIDE = """() => { Object.defineProperty(document, "hidden", {value: true, configurable: true});
    document.dispatchEvent(new Event("visibilitychange")); }"""


def _driving(page: "Page", station: FakeStation, key: str = "ArrowUp") -> None:
    page.keyboard.down(key)
    station.wait(lambda: len(station.drives) > 2)


def _is_at_rest(station: FakeStation) -> bool:
    last = station.drives[-1]
    return (last.linear, last.angular) == (0.0, 0.0)


def _goes_by(station: FakeStation, linear: object, angular: object) -> None:
    """This is asked for, as soon as what was asked for before has arrived, and goes on to be."""

    def is_last() -> bool:
        return bool(station.drives) and (station.drives[-1].linear, station.drives[-1].angular) == (linear, angular)

    station.wait(is_last)
    station.wait_drives(3)
    assert is_last()


def _ended(station: FakeStation) -> None:
    """Zero came, once, for the robot that was driven, and then nothing."""
    station.wait(lambda: _is_at_rest(station))
    count = len(station.drives)
    station.wait_frames(6)
    assert len(station.drives) == count, "something was sent after the zeros"
    assert sum((d.linear, d.angular) == (0.0, 0.0) for d in station.drives) == 1
    assert {drive.robot for drive in station.drives} == {"/alice"}


def _stick(page: "Page") -> tuple[float, float, float]:
    page.locator("#joystick").scroll_into_view_if_needed()
    box = page.locator("#joystick").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, box["width"] / 2


@pytest.mark.variants(4)
@pytest.mark.parametrize(
    ("keys", "linear", "angular"),
    [
        (["ArrowUp"], 0.3, 0.0),
        (["KeyW"], 0.3, 0.0),
        (["ArrowDown"], -0.3, 0.0),
        (["KeyS"], -0.3, 0.0),
        (["ArrowLeft"], 0.0, 0.6),
        (["KeyA"], 0.0, 0.6),
        (["ArrowRight"], 0.0, -0.6),
        (["KeyD"], 0.0, -0.6),
        (["ArrowUp", "ArrowLeft"], 0.3, 0.6),
        (["ArrowUp", "KeyW"], 0.3, 0.0),
        (["ArrowUp", "ArrowDown"], 0.0, 0.0),
    ],
)
def test_keys_drive_within_the_limit_of_the_slider(
    page: "Page", station: FakeStation, keys: list[str], linear: float, angular: float
) -> None:
    """The slider stands at 30 %, the station allows 1 m/s and 2 rad/s."""
    for key in keys:
        page.keyboard.down(key)
    _goes_by(station, pytest.approx(linear), pytest.approx(angular))


def test_the_slider_sets_the_speed(page: "Page", station: FakeStation) -> None:
    page.fill("#speed", "100")
    shows(page, "#speed-text", "1.00 m/s, 2.00 rad/s")
    _driving(page, station, "KeyW")  # the slider has the focus, and takes the arrows only
    assert station.drives[-1].linear == pytest.approx(1.0)


def test_held_key_sends_setpoint_repeatedly(page: "Page", station: FakeStation) -> None:
    _driving(page, station)
    count = len(station.drives)
    station.wait(lambda: len(station.drives) > count + 5)


def test_one_of_two_keys_released_drives_on_by_the_other(page: "Page", station: FakeStation) -> None:
    page.keyboard.down("ArrowUp")
    page.keyboard.down("ArrowLeft")
    station.wait(lambda: station.drives and station.drives[-1].angular > 0)
    page.keyboard.up("ArrowLeft")
    station.wait(lambda: station.drives[-1].angular == 0.0)
    assert station.drives[-1].linear == pytest.approx(0.3)
    page.keyboard.up("ArrowUp")
    _ended(station)


ENDS: dict[str, Callable[[Any, FakeStation], object]] = {
    "the key is released": lambda page, _: page.keyboard.up("ArrowUp"),
    "the window loses the focus": lambda page, _: page.evaluate("() => { window.dispatchEvent(new Event('blur')); }"),
    "the page is hidden": lambda page, _: page.evaluate(HIDE),
    "the page is left": lambda page, _: page.goto("about:blank"),
    "the page is put away": lambda page, _: page.evaluate("() => { window.dispatchEvent(new Event('pagehide')); }"),
    "a text field is entered": lambda page, _: page.focus("#sequence-name"),
    "stop": lambda page, _: page.keyboard.press("Escape"),
    "a modifier": lambda page, _: page.keyboard.down("Control"),
    "a menu opens": lambda page, _: page.evaluate(
        "() => { document.body.dispatchEvent(new Event('contextmenu', {bubbles: true})); }"
    ),
    "another robot is selected": lambda page, _: page.locator("#robots button").nth(1).click(),
    "the robot is lost": lambda _, station: station.robot(**lost()),
    "the robot is disarmed": lambda _, station: station.robot(mode="DISARMED"),
    "the robot is in fault": lambda _, station: station.robot(mode="FAULT"),
    "another takes control": lambda _, station: station.robot(controller="bert"),
    "another stops it": lambda _, station: station.robot(stop="requested"),
    "the picture is stale": lambda _, station: station.fall_silent(),
    "the picture stands still": lambda _, station: station.stand_still(),
}


@pytest.mark.variants(5)
@pytest.mark.parametrize("way", ENDS)
def test_the_hold_ends(page: "Page", station: FakeStation, way: str) -> None:
    station.robot("/bob", **armed(name="Bob"))
    shows(page, "#robots", "Bob")
    _driving(page, station)
    ENDS[way](page, station)
    _ended(station)


def test_a_broken_socket_ends_the_hold_and_it_does_not_come_back_by_itself(page: "Page", station: FakeStation) -> None:
    _driving(page, station)
    station.reconnect()
    there(page, "body[data-fresh=true]")
    count = len(station.drives)
    station.wait_frames(10)
    assert len(station.drives) == count, "the key is still held, but it must be pressed anew"
    page.keyboard.up("ArrowUp")
    page.keyboard.down("ArrowUp")
    station.wait(lambda: len(station.drives) > count)


def test_a_key_that_repeats_does_not_start_it_again(page: "Page", station: FakeStation) -> None:
    _driving(page, station)
    page.evaluate("() => { window.dispatchEvent(new Event('blur')); }")
    station.wait(lambda: _is_at_rest(station))
    page.keyboard.down("ArrowUp")  # while it is down: a repetition
    _ended(station)


def test_no_timer_is_left_behind(page: "Page", station: FakeStation) -> None:
    page.evaluate(
        """() => { window.timers = new Set(); const [start, end] = [setInterval, clearInterval];
        window.setInterval = (...given) => { const id = start(...given); window.timers.add(id); return id; };
        window.clearInterval = (id) => { window.timers.delete(id); end(id); }; }"""
    )
    _driving(page, station)
    assert page.evaluate("() => window.timers.size") == 1
    page.keyboard.up("ArrowUp")
    _ended(station)
    assert page.evaluate("() => window.timers.size") == 0


def test_a_key_that_was_held_when_it_ended_counts_no_more(page: "Page", station: FakeStation) -> None:
    _driving(page, station)
    page.evaluate("() => { window.dispatchEvent(new Event('blur')); }")
    station.wait(lambda: _is_at_rest(station))
    page.keyboard.down("ArrowLeft")
    station.wait(lambda: station.drives[-1].angular > 0)
    assert station.drives[-1].linear == 0.0


WHY_NOT: dict[str, dict[str, object]] = {
    "Take control first": {"controller": ""},
    "bert has control; take it first": {"controller": "bert"},
    "Arm the robot first": {"mode": "DISARMED"},
    "The robot is lost": {"is_alive": False},
    "Clear the stop first": {"stop": "requested"},
}


@pytest.mark.variants(2)
@pytest.mark.parametrize("why", WHY_NOT)
def test_refused_driving_sends_nothing_and_shows_reason(page: "Page", station: FakeStation, why: str) -> None:
    station.robot(**WHY_NOT[why])
    shows(page, "#drive-reason", why)
    page.keyboard.down("ArrowUp")
    x, y, _ = _stick(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 30)
    shows(page, "#command-failure", f"Drive: {why}")
    station.wait_frames(3)
    assert station.drives == []


def test_a_robot_that_holds_may_be_driven(page: "Page", station: FakeStation) -> None:
    station.robot(mode="HOLD")
    shows(page, "#mode", "HOLD")
    _driving(page, station)


def test_a_viewer_does_not_drive(page: "Page", station: FakeStation) -> None:
    station.script.hello = msgspec.structs.replace(station.script.hello, role="viewer")
    station.cut()
    shows(page, "#drive-reason", "viewer")
    page.keyboard.down("ArrowUp")
    station.wait_frames(3)
    assert station.drives == []


@pytest.mark.parametrize("place", ["#sequence-text", "#sequence-name", "#speed"])
def test_keys_in_a_field_do_not_drive(page: "Page", station: FakeStation, place: str) -> None:
    page.focus(place)
    page.keyboard.down("ArrowUp")
    station.wait_frames(3)
    assert station.drives == []


@pytest.mark.variants(2)
@pytest.mark.parametrize(
    ("lean", "linear", "angular"),
    [
        ((0.0, 1.0), 0.3, 0.0),
        ((-1.0, 0.0), 0.0, 0.6),
        ((0.0, -3.0), -0.3, 0.0),
        ((0.0, 0.5), 0.15, 0.0),
        ((0.02, 0.02), 0.0, 0.0),
    ],
)
def test_the_joystick_drives_as_far_as_it_leans(
    page: "Page", station: FakeStation, lean: tuple[float, float], linear: float, angular: float
) -> None:
    x, y, reach = _stick(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + lean[0] * reach, y - lean[1] * reach)
    _goes_by(station, pytest.approx(linear, abs=0.005), pytest.approx(angular, abs=0.01))


@pytest.mark.variants(2)
@pytest.mark.parametrize("way", ["release", "pointerup", "pointercancel", "pointerleave", "lostpointercapture", "stop"])
def test_the_hold_of_the_joystick_ends(page: "Page", station: FakeStation, way: str) -> None:
    page.evaluate("() => addEventListener('pointerdown', (event) => { window.pointer = event.pointerId; }, true)")
    x, y, reach = _stick(page)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - reach)
    station.wait(lambda: station.drives and station.drives[-1].linear > 0)
    if way == "release":
        page.mouse.up()
    elif way == "stop":
        page.keyboard.press("Escape")
    else:
        page.dispatch_event("#joystick", way, {"pointerId": page.evaluate("() => window.pointer")})
    station.wait(lambda: _is_at_rest(station))
    count = len(station.drives)
    page.mouse.move(x, y + reach)  # a pointer that is still down holds no more
    station.wait_frames(6)
    assert len(station.drives) == count
    assert page.get_attribute("#knob", "style") == "transform: translate(0px, 0px);"


def test_a_finger_that_the_system_takes_away_ends_the_hold(browser_touch: "Page", station: FakeStation) -> None:
    page = browser_touch
    x, y, reach = _stick(page)
    session = page.context.new_cdp_session(page)
    touch = {"touchPoints": [{"x": x, "y": y}]}
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", **touch})
    session.send("Input.dispatchTouchEvent", {"type": "touchMove", "touchPoints": [{"x": x, "y": y - reach}]})
    station.wait(lambda: station.drives and station.drives[-1].linear > 0.29)
    session.send("Input.dispatchTouchEvent", {"type": "touchCancel", "touchPoints": []})
    station.wait(lambda: _is_at_rest(station))
    count = len(station.drives)
    station.wait_frames(6)
    assert len(station.drives) == count


def test_a_second_finger_stops(browser_touch: "Page", station: FakeStation) -> None:
    page = browser_touch
    x, y, reach = _stick(page)
    session = page.context.new_cdp_session(page)
    stop = page.locator("#stop").bounding_box()
    assert stop is not None
    first = {"x": x, "y": y - reach, "id": 0}
    second = {"x": stop["x"] + 20, "y": stop["y"] + 20, "id": 1}
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [first]})
    station.wait(lambda: station.drives and station.drives[-1].linear > 0)
    session.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [first, second]})
    station.wait(lambda: station.commands)
    assert station.commands[0].act is Act.STOP
    _ended(station)
