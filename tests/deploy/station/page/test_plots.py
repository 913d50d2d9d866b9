# SPDX-License-Identifier: MIT
"""Plots show what was heard, and no line where nothing was."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import pytest

from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import drawn, gone, load_again, shows, there
from tests.deploy.station.page.robot_states import lost

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

COLUMNS = """() => {
    const canvas = document.querySelector("#plots canvas");
    const copy = new OffscreenCanvas(canvas.width, canvas.height);
    const context = copy.getContext("2d", {willReadFrequently: true});
    context.drawImage(canvas, 0, 0);
    const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
    const hex = getComputedStyle(document.documentElement).getPropertyValue("--plot-1").trim();
    const [red, green, blue] = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
    const isLine = (at) => data[at + 3] > 200 && Math.abs(data[at] - red) + Math.abs(data[at + 1] - green)
      + Math.abs(data[at + 2] - blue) < 30;
    const columns = new Array(canvas.width).fill(false);
    for (let at = 0; at < data.length; at += 4) if (isLine(at)) columns[(at / 4) % canvas.width] = true;
    return columns; }"""
"""Of the first plot: in which columns of dots there is a line."""


Row = tuple[float, list[float | None] | None]
IMAGE = "() => document.querySelector('#plots canvas').toDataURL()"
CLOCK = re.compile(r"(\d\d):(\d\d):(\d\d)")


def _longest_gap(columns: list[bool]) -> int:
    """Columns in a row without a line, between the first and the last with one."""
    drawn = "".join("x" if column else " " for column in columns).strip()
    return max(map(len, drawn.split("x")))


def test_no_line_is_drawn_through_silence(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest] canvas")
    station.wait_frames(20)
    assert _longest_gap(page.evaluate(COLUMNS)) < 10
    station.script.sends = False
    station.wait_frames(40)
    station.script.sends = True
    station.wait_seen(20)
    page.wait_for_function(
        "(newest) => Number(document.querySelector('#plots').dataset.newest) >= newest", arg=station.sent[-3]
    )
    assert _longest_gap(page.evaluate(COLUMNS)) >= 40, "2 s of 20 s, which are some 500 dots"


def _history(page: "Page", rows: Sequence[Row]) -> list[list[float | None]]:
    """The columns of a history of two lines that keeps 20 s."""
    columns: list[list[float | None]] = page.evaluate(
        """async (rows) => {
        const { History } = await import("/static/plot_history.js");
        const history = new History(2, 20);
        for (const [time, values] of rows) history.add(time, values);
        return [history.times, ...history.columns]; }""",
        rows,
    )
    return columns


def test_a_line_ends_where_nothing_follows_within_a_second(page: "Page") -> None:
    rows: list[Row] = [(1.0, [1.0, 5.0]), (1.9, [2.0, None]), (15.0, [3.0, 6.0]), (15.05, [4.0, 7.0])]
    times, first, second = _history(page, rows)
    assert times == [1.0, 1.9, pytest.approx(1.901), 15.0, 15.05]
    assert first == [1.0, 2.0, None, 3.0, 4.0]
    assert second == [5.0, None, None, 6.0, 7.0]


def test_a_line_ends_where_the_robot_is_lost_and_its_end_is_kept_once(page: "Page") -> None:
    rows: list[Row] = [(1.0, [1.0, 5.0]), (1.05, None), (1.1, None), (9.0, None), (9.05, [2.0, 6.0])]
    assert _history(page, rows) == [[1.0, 1.05, 9.05], [1.0, None, 2.0], [5.0, None, 6.0]]


def test_what_is_older_than_is_kept_is_gone_and_another_clock_begins_anew(page: "Page") -> None:
    rows: list[Row] = [(0.5 * number, [number, 0.0]) for number in range(100)]
    times = _history(page, rows)[0]
    assert (times[0], times[-1]) == (29.0, 49.5)  # one before the 20 s, from where the line comes
    assert _history(page, [*rows, (3.0, [7.0, 8.0])]) == [[3.0], [7.0], [8.0]]


def test_what_was_before_comes_before_and_what_is_there_stays(page: "Page") -> None:
    columns = page.evaluate(
        """async () => {
        const { History } = await import("/static/plot_history.js");
        const history = new History(1, 600);
        history.add(10, [1]);
        history.add(10.05, [2]);
        history.prepend([[7, [3]], [7.2, null], [8.5, [4]], [10, [5]], [10.2, [6]]]);
        return [history.times, ...history.columns]; }"""
    )
    assert columns == [[7, 7.2, 8.5, 8.501, 10, 10.05], [3, None, 4, None, 1, 2]]


def test_robots_that_are_no_longer_in_the_picture_are_forgotten_after_ten_minutes(page: "Page") -> None:
    kept = page.evaluate(
        """async () => {
        const { Plots } = await import("/static/plots.js");
        const plots = new Plots();
        const robot = (name) => ({robot: name, is_alive: true, pitch: 0.1, linear_velocity: 1});
        const add = (time_s, ...names) => {
          plots.add({time_s, robots: names.map(robot)});
          return plots._histories.size;
        };
        return [add(1, "/a", "/b"), add(1.05, "/b"), add(600, "/b"), add(602, "/b"), add(603)]; }"""
    )
    assert kept == [2, 2, 2, 1, 1]


def _trace(station: FakeStation) -> dict[str, list[float | None]]:
    """What a station keeps of a robot that leant by 6 degrees from nine minutes to one minute ago."""
    count = 960
    times: list[float | None] = [station._time_s - 540.0 + 0.5 * number for number in range(count)]
    lines = ("linear_velocity", "linear_setpoint", "angular_velocity", "angular_setpoint")
    unknown: list[float | None] = [None] * count
    return {"time_s": times, "pitch": [0.1047] * count, **dict.fromkeys(lines, unknown)}


def test_the_last_ten_minutes_are_there_after_a_reload(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest] canvas")
    station.script.trace = _trace(station)
    load_again(page)
    oldest = station.script.trace["time_s"][0]
    page.wait_for_function("(oldest) => Number(document.querySelector('#plots').dataset.oldest) === oldest", arg=oldest)
    assert station.traced[-1] == "/alice"
    page.click("#plots-buttons button:text-is('10 min')")
    shows(page, "#plots-title", "Last 10 min")
    page.wait_for_function(
        f"() => {{ const columns = ({COLUMNS})(); return columns.indexOf(true) < 0.3 * columns.length; }}"
    )
    page.click("#plots-buttons button:text-is('20 s')")
    shows(page, "#plots-title", "Last 20 s")


def test_plots_that_are_paused_stand_still_and_go_on(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest] canvas")
    page.click("#plots-buttons button:text-is('Pause')")
    shows(page, "#plots-state", "paused")
    drawn(page)
    shown, title = page.evaluate(IMAGE), page.inner_text("#plots-title")
    assert re.match(r"\d\d:\d\d:\d\d to \d\d:\d\d:\d\d", title)
    station.robot(pitch=0.5)
    station.wait_frames(15)
    assert (page.evaluate(IMAGE), page.inner_text("#plots-title")) == (shown, title)
    page.click("#plots-buttons button:text-is('Go on')")
    gone(page, "#plots-state")
    shows(page, "#plots-title", "Last 20 s")
    page.wait_for_function(f"(shown) => ({IMAGE})() !== shown", arg=shown)


def test_plots_that_have_stopped_have_the_time_of_day_where_they_are_paused(page: "Page", station: FakeStation) -> None:
    """Paused, "0" would be a wrong label soon: it is the moment of what came last, and no longer of now."""
    there(page, "#plots[data-newest] canvas")
    station.fall_silent()
    there(page, "#plots[data-live=false]")
    drawn(page)
    before = page.evaluate(IMAGE)
    page.click("#plots-buttons button:text-is('Pause')")
    page.wait_for_function(f"(before) => ({IMAGE})() !== before", arg=before)
    page.click("#plots-buttons button:text-is('Go on')")
    page.wait_for_function(f"(before) => ({IMAGE})() === before", arg=before)


def test_plots_of_a_robot_that_was_lost_long_ago_can_be_paused(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest] canvas")
    station.wait_seen(10)
    station.robot(**lost())
    shows(page, "#plots-state", "stopped")
    station._time_s += 100.0
    station.wait_seen(2)
    page.click("#plots-buttons button:text-is('Pause')")
    shows(page, "#plots-buttons", "Go on")
    drawn(page)
    assert any(page.evaluate(COLUMNS)), "what it did last stays in sight"


def test_a_drag_shows_a_part_and_the_cursor_reads_values(page: "Page", station: FakeStation) -> None:
    there(page, "#plots[data-newest] canvas")
    station.wait_frames(10)
    page.locator("#plots .u-over").first.scroll_into_view_if_needed()
    box = page.locator("#plots .u-over").first.bounding_box()
    assert box is not None
    right, middle = box["x"] + box["width"], box["y"] + box["height"] / 2
    page.mouse.move(right - 3, middle)
    shows(page, "#plots .plot-at", ": 3.00")
    page.mouse.down()
    page.mouse.move(right - box["width"] / 2, middle, steps=4)
    page.mouse.up()
    shows(page, "#plots-state", "paused")
    title = page.inner_text("#plots-title")
    begun, ended = (int(hour) * 3600 + int(minute) * 60 + int(second) for hour, minute, second in CLOCK.findall(title))
    assert 9 <= (ended - begun) % 86400 <= 11, "half of 20 s"
    page.mouse.move(0, 0)
    page.wait_for_function("() => document.querySelector('#plots .plot-at').textContent === ''")
