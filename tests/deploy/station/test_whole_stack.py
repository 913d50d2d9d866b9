# SPDX-License-Identifier: MIT
"""The page in a browser, the station, a segway and its plant: each a process of its own, as an operator has them."""

import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.chromium import chromium
from tests.deploy.station.whole_stack import (
    DOWN,
    NAMESPACE,
    OperatorPage,
    Stack,
    operator_page_at,
    ros_of_our_own,
    until,
)

pytestmark = [pytest.mark.ros, pytest.mark.browser, pytest.mark.real_time]

LOST = "the base station is lost"
STATION = "{timeout_s: 1.0, sit_down_after_s: 3.0, sit_down: {stand: 0.0}, disarm_after_s: 8.0}"
SEQUENCE = "segments:\n  - {linear: 0.3, duration: 1.5}\n  - {angular: 0.5, duration: 1.5}\n"
STANDS = 0.1
"""Pitch of a segway that stands, rad."""


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    folder = tmp_path_factory.mktemp("stack")
    with ros_of_our_own(folder):
        stack = Stack(folder, "segway", STATION)
        try:
            stack.start_plant()
            stack.start_station()
            yield stack
        finally:
            stack.close()


@pytest.fixture(scope="module")
def seat(stack: Stack) -> Iterator[OperatorPage]:
    wanted = os.environ.get("SEGWAY_ECC_SCREENSHOTS")
    if wanted:
        Path(wanted).mkdir(parents=True, exist_ok=True)
    with chromium() as browser, operator_page_at(browser, stack.url, Path(wanted) if wanted else None) as seat:
        yield seat


@pytest.fixture
def standing(stack: Stack, seat: OperatorPage) -> OperatorPage:
    """A page whose operator has control of a segway that stands, whatever became of it in the test before."""
    if NAMESPACE not in seat.text("#robots"):
        stack.start_robot()
    seat.page.wait_for_selector("#robot[data-live=true]")
    if not seat.is_disabled("take_control"):
        seat.press("take_control")
    get_up(stack, seat)
    return seat


def stands(stack: Stack) -> bool:
    return abs(stack.truth().pitch) < STANDS


def get_up(stack: Stack, seat: OperatorPage) -> None:
    """Have it stand, and again where it fell meanwhile: balancing beside all this is not what is proved."""

    def is_up() -> bool:
        if seat.mode in {"ARMED", "HOLD"} and stands(stack):
            return True
        if seat.mode == "FAULT":
            seat.press("clear_fault")
            seat.shows("#mode", "DISARMED")
        seat.arm()
        seat.press("stand")
        deadline = time.monotonic() + 5.0
        while not stands(stack) and time.monotonic() < deadline:
            time.sleep(0.02)
        return stands(stack)

    until(is_up, f"it stands; {seat.situation()}")


def drive(stack: Stack, seat: OperatorPage, is_enough: Callable[[], bool] = lambda: True) -> None:
    """Hold the key until the plant moves, and it is enough.

    The key is pressed anew where the page let go of it, which it does where a picture is late, or the robot fell.
    """

    def is_held() -> bool:
        return "Requesting" in seat.text("#drive-now")

    def moves() -> bool:
        if not is_held():
            seat.page.keyboard.up("ArrowUp")
            get_up(stack, seat)
            seat.page.keyboard.down("ArrowUp")
            deadline = time.monotonic() + 5.0
            while not is_held() and time.monotonic() < deadline:
                time.sleep(0.02)
        return stack.truth().velocity > 0.2 and is_enough()

    until(moves, f"it moves; {stack.truth()}, {seat.situation()}")


def test_a_robot_is_found_by_itself_and_armed(stack: Stack, seat: OperatorPage) -> None:
    if stack.is_running("run"):  # run again, as the machine stood still: tests/held_up.py
        stack.kill("run")
        stack.kill("station")
        stack.start_station()
    seat.page.wait_for_selector("body[data-fresh=true]")
    seat.shows("#no-robots", "None found yet")
    seat.look("no-robot")
    stack.start_robot()
    seat.page.wait_for_selector("#robot[data-live=true]")
    seat.shows("#robots", NAMESPACE)
    seat.shows("#mode", "DISARMED")
    seat.shows("#drive-reason", "Take control first")
    seat.press("sit")
    seat.look("disarmed")
    get_up(stack, seat)
    seat.shows("#more-readouts", "operator")  # who arms what nobody controls has control
    seat.look("armed")


def test_the_keyboard_drives_it_and_letting_go_is_zero(stack: Stack, standing: OperatorPage) -> None:
    if not standing.is_disabled("take_control"):
        standing.press("take_control")
    begun = stack.truth()

    def gets_on() -> bool:
        is_asked_for = standing.mode == "ARMED" and "Requesting 0.90 m/s" in standing.text("#drive-now")
        return is_asked_for and stack.truth().x > begun.x + 0.2

    drive(stack, standing, gets_on)
    standing.look("driving")
    standing.page.keyboard.up("ArrowUp")
    standing.shows("#drive-now", "Not driving")
    until(lambda: abs(stack.truth().velocity) < 0.05, f"it comes to rest; {standing.situation()}")
    assert standing.mode in {"ARMED", "HOLD"}
    drives = [entry["act"] for entry in stack.audit() if entry["act"] in {"drive", "rest"}]
    assert drives[-2:] == ["drive", "rest"]


def test_a_key_stops_it_and_the_drives_confirm_it(stack: Stack, standing: OperatorPage) -> None:
    drive(stack, standing)
    asked_ns = time.monotonic_ns()
    standing.page.keyboard.press("Escape")
    standing.shows("#stop-state", "Stop confirmed after")
    standing.page.keyboard.up("ArrowUp")
    assert re.search(r": (drives off|commands zero)\b", standing.text("#stop-state"))
    standing.shows("#mode", "FAULT")
    assert "stop was pressed" in standing.text("#reason")
    assert stack.was_driven(asked_ns)
    until(lambda: stack.torque_after(asked_ns).zero_s is not None, "zero torque at the drives")
    until(lambda: abs(stack.truth().pitch) > DOWN, "without torque it falls on its stop")
    zero_s = stack.torque_after(asked_ns).zero_s
    assert zero_s is not None, "the torque came back"
    sys.stderr.write(f"stop: {standing.text('#stop-state')}; from the key to zero torque {zero_s * 1e3:.0f} ms\n")
    standing.look("stopped")
    assert standing.is_disabled("arm"), "latched"
    standing.page.click("#stop-clear")
    standing.shows("#mode", "DISARMED")
    standing.page.locator("#stop-clear").wait_for(state="hidden")


def test_a_sequence_runs_to_its_end(stack: Stack, standing: OperatorPage) -> None:
    if not standing.is_disabled("take_control"):
        standing.press("take_control")
    standing.page.fill("#sequence-text", SEQUENCE)
    standing.page.fill("#sequence-name", "there and round")
    standing.page.evaluate(
        """() => { window.shown = [];
        const progress = document.querySelector("#sequence-progress");
        const note = () => window.shown.push(progress.value);
        new MutationObserver(note).observe(progress, {attributes: true, attributeFilter: ["value"]}); }"""
    )
    begun = stack.truth()
    standing.press("play")
    standing.shows("#sequence-state", "there and round: ")
    standing.look("sequence", "#sequence-buttons")

    def is_done() -> bool:
        if standing.mode not in {"ARMED", "HOLD"}:
            get_up(stack, standing)
            standing.press("play")
        return "there and round: done, 100 %" in standing.text("#sequence-state")

    until(is_done, f"the sequence ends; {standing.situation()}")
    between = [value for value in standing.page.evaluate("() => window.shown") if 0.0 < value < 1.0]
    assert between, "its progress was shown"
    assert abs(stack.truth().x - begun.x) > 0.1


def test_a_robot_that_is_killed_is_shown_as_lost_and_comes_back_by_itself(stack: Stack, standing: OperatorPage) -> None:
    killed_s = stack.kill("run")
    while standing.mode != "LOST":
        assert time.monotonic() < killed_s + 40.0, standing.situation()
    after_s = time.monotonic() - killed_s
    sys.stderr.write(f"lost: shown {after_s:.2f} s after the robot was killed\n")
    standing.page.wait_for_selector("#robot[data-live=false]")
    standing.shows("#reason", "No message for")
    standing.shows("#drive-reason", "The robot is lost")
    assert standing.text("#readouts").count("\N{EN DASH}") + standing.text("#readouts").count("-") >= 4, "no number"
    standing.look("lost")
    stack.start_robot()
    standing.page.wait_for_selector("#robot[data-live=true]")
    standing.shows("#mode", "DISARMED")
    standing.shows("#events", "back after")


def test_without_its_station_it_holds_and_sits_down_by_itself(stack: Stack, standing: OperatorPage) -> None:
    drive(stack, standing)
    stack.kill("station")
    standing.page.wait_for_selector("#stale:not([hidden])")
    standing.page.wait_for_selector("body[data-fresh=false]")
    standing.look("no-station")
    until(lambda: abs(stack.truth().velocity) < 0.05 and abs(stack.truth().pitch) < STANDS, f"holds: {stack.truth()}")
    until(lambda: abs(stack.truth().pitch) > DOWN, "it sits down")
    assert any(tick.is_driven for tick in stack.ticks()[-50:]), "by its motors"
    until(lambda: not any(tick.is_driven for tick in stack.ticks()[-100:]), "its motors go off")
    standing.page.keyboard.up("ArrowUp")
    until(lambda: f"DISARMED, RESTING: {LOST}" in stack.output("run"), "the robot says why")
    told = [line.partition(": ")[2] for line in stack.output("run").splitlines() if LOST in line]
    assert (told[0], told[-1]) == (f"HOLD, BALANCING: {LOST}", f"DISARMED, RESTING: {LOST}")
    assert f"{LOST}: the robot sits down" in told

    stack.start_station()
    standing.page.wait_for_selector("body[data-fresh=true]")
    standing.page.wait_for_selector("#robot[data-live=true]")
    standing.page.locator("#stale").wait_for(state="hidden")
    standing.shows("#mode", "DISARMED")
    standing.shows("#reason", LOST)
    standing.look("back")
