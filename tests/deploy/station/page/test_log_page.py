# SPDX-License-Identifier: MIT
"""The page that plays a log, in a browser: its moment is that of the address, and keys, bar and events move it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.deploy.station.page.conftest import Tab
from tests.deploy.station.page.page_waits import gone, shows, tells, there
from tests.deploy.station.page.served_log import served_log
from tests.deploy.station.playback.log_maker import record, story, write_log

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

GAP = range(800, 1000)
"""Cycles that were not recorded: from 4 s to 5 s."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a log of 30 s: more than one piece, with a fall at 9 s and a gap."""
    path = tmp_path_factory.mktemp("logs") / "Alice run.mcap"
    write_log(path, [each for each in story(30.0) if each.cycle not in GAP])
    with served_log(path) as url:
        yield url


@pytest.fixture
def log(desktop: Tab, address: str) -> "Iterator[Page]":
    """The page at the moment 6.000 s."""
    desktop.clean()
    desktop.page.goto(f"{address}&t=6")
    at_cycle(desktop.page, 1200)
    yield desktop.page
    desktop.page.goto("about:blank")
    assert desktop.complaints == []


def at_cycle(page: "Page", cycle: int) -> None:
    """Wait until the page shows a cycle, by its number and by its words."""
    page.wait_for_function("(cycle) => document.body.dataset.cycle === String(cycle)", arg=cycle)
    shows(page, "#readouts", f"Cycle\n{cycle}")


def at_moment(page: "Page", text: str) -> None:
    shows(page, "#player-time", f"{text} of ")


def test_link_shows_its_moment_with_state_figures_and_events(log: "Page") -> None:
    assert log.inner_text("#log-name") == "Alice run.mcap"
    shows(log, "#log-summary", "29.995 s, 5800 cycles")
    shows(log, "#robot-name", "Alice")
    shows(log, "#headline", "BALANCING")
    shows(log, "#mode", "ARMED")
    shows(log, "#reason", "why it is ARMED")
    shows(log, "#readouts", "0.50")
    at_moment(log, "6.000 s")
    gone(log, "#pages")  # there are none beside it
    assert log.inner_text(".log-event[aria-current]").split("\n")[-1] == "Posture: BALANCING"
    assert log.get_attribute("#moment", "aria-valuetext") == "6.000 s, BALANCING, ARMED"


def test_scene_and_plots_are_those_of_the_live_page(log: "Page") -> None:
    there(log, "#scene")
    there(log, "#plots[data-shown] canvas")
    assert log.locator("#plots figure:not([hidden])").count() == 3
    shows(log, "#plots-span", "0.000 s to 20.000 s")
    log.click("#plots-buttons button:text-is('All')")
    shows(log, "#plots-span", "0.000 s to 29.995 s")


def test_arrows_step_by_one_cycle_and_with_shift_by_one_second(log: "Page") -> None:
    log.keyboard.press("ArrowRight")
    at_cycle(log, 1201)
    for _ in range(3):
        log.keyboard.press("ArrowLeft")
    at_cycle(log, 1198)
    log.keyboard.press("Shift+ArrowRight")
    at_cycle(log, 1398)
    log.keyboard.press("End")
    at_cycle(log, 5999)
    log.keyboard.press("ArrowRight")
    log.keyboard.press("Home")
    at_cycle(log, 0)
    log.click("#cycle-on")
    at_cycle(log, 1)
    log.click("#cycle-back")
    at_cycle(log, 0)


def test_steps_go_from_one_piece_of_the_log_to_the_next(log: "Page", address: str) -> None:
    log.goto(f"{address}&t=9.995")
    at_cycle(log, 1999)
    log.keyboard.press("ArrowRight")
    at_cycle(log, 2000)
    log.keyboard.press("ArrowRight")
    at_cycle(log, 2001)
    log.keyboard.press("ArrowLeft")
    log.keyboard.press("ArrowLeft")
    at_cycle(log, 1999)


def test_step_back_from_within_a_cycle_is_to_the_one_before(log: "Page") -> None:
    log.fill("#moment", "7.0031")
    at_cycle(log, 1400)
    log.keyboard.press("ArrowLeft")
    at_cycle(log, 1399)
    log.fill("#moment", "7.0031")
    log.keyboard.press("ArrowRight")
    at_cycle(log, 1401)


def test_keys_on_the_bar_step_by_cycles_too(log: "Page") -> None:
    log.focus("#moment")
    log.keyboard.press("ArrowRight")
    at_cycle(log, 1201)


def test_bar_is_dragged_to_a_moment_and_shows_modes_events_and_gaps(log: "Page") -> None:
    log.fill("#moment", "12")
    at_cycle(log, 2400)
    shows(log, "#headline", "FALLEN")
    assert log.eval_on_selector_all(".marks-mode", "all => all.map((e) => e.dataset.mode)") == [
        "disarmed",
        "armed",
        "fault",
    ]
    assert log.locator(".marks-gap").count() == 1
    assert log.locator(".marks-event.error").count() == 1


def test_address_is_a_link_to_the_moment_which_a_reload_and_another_link_show(log: "Page") -> None:
    log.keyboard.press("Shift+ArrowRight")
    at_cycle(log, 1400)
    log.wait_for_function("() => location.hash === '#log=Alice+run.mcap&t=7'")
    log.reload()
    at_cycle(log, 1400)
    log.evaluate("(hash) => { location.hash = hash; }", "#log=Alice+run.mcap&t=9.005")
    at_cycle(log, 1801)


def test_space_plays_at_the_chosen_speed_and_pauses(log: "Page") -> None:
    log.select_option("#rate", "10")
    log.keyboard.press("Space")
    shows(log, "#play", "Pause")
    log.wait_for_function("() => Number(document.body.dataset.cycle) > 2200")
    log.keyboard.press("Space")
    shows(log, "#play", "Play")
    before = log.evaluate("() => document.body.dataset.cycle")
    log.keyboard.press("ArrowRight")
    at_cycle(log, int(before) + 1)
    shows(log, "#headline", "FALLEN")


def test_end_of_the_log_pauses_and_play_begins_anew(log: "Page") -> None:
    log.keyboard.press("End")
    at_cycle(log, 5999)
    log.select_option("#rate", "10")
    log.click("#play")
    log.wait_for_function("() => Number(document.body.dataset.cycle) < 5000")
    log.click("#play")
    shows(log, "#play", "Play")


def test_events_lead_to_their_moments(log: "Page") -> None:
    log.click("#event-on")
    at_cycle(log, 1800)
    shows(log, "#headline", "FALLEN")
    shows(log, "#reason", "why it is FAULT")
    log.click("#event-back")
    at_cycle(log, 300)
    log.click("#log-events button:has-text('Mode: ARMED')")
    at_cycle(log, 200)


def test_what_was_not_recorded_is_said_and_dimmed_and_stepped_over(log: "Page") -> None:
    shows(log, "#damage-list", "Nothing was recorded from 3.995 s to 5.000 s.")
    log.fill("#moment", "4.5")
    shows(log, "#scene-gap", "Not recorded from 3.995 s to 5.000 s")
    there(log, "body[data-live=false]")
    log.keyboard.press("ArrowRight")
    at_cycle(log, 1000)
    gone(log, "#scene-gap")
    log.keyboard.press("ArrowLeft")
    at_cycle(log, 799)


def test_click_on_a_plot_goes_to_its_moment_and_a_drag_shows_a_part(log: "Page") -> None:
    there(log, "#plots[data-shown] canvas")
    over = log.locator("#plots .u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    assert box is not None
    log.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    log.wait_for_function("() => Math.abs(parseFloat(document.querySelector('#player-time').textContent) - 10) < 0.1")
    log.mouse.move(box["x"] + box["width"] * 0.25, box["y"] + 20)
    log.mouse.down()
    log.mouse.move(box["x"] + box["width"] * 0.5, box["y"] + 20, steps=4)
    log.mouse.up()
    log.wait_for_function(
        "() => { const [from, to] = document.querySelector('#plots-span').textContent.split(' to ').map(parseFloat);"
        " return to - from > 4 && to - from < 6; }"
    )


def test_link_is_copied(log: "Page", address: str) -> None:
    log.context.grant_permissions(["clipboard-read", "clipboard-write"])
    log.click("#copy-link")
    tells(log, "#announcer", "The link to 6.000 s was copied")
    assert log.evaluate("() => navigator.clipboard.readText()") == address.replace(" ", "+") + "&t=6"


def test_few_pieces_are_kept_however_long_the_log_is(log: "Page") -> None:
    kept = log.evaluate(
        """async () => {
        const { LogSource } = await import("/static/log_source.js");
        const source = new LogSource("/nowhere", () => {}, () => {});
        source.view = {duration_s: 36000, piece_s: 10, begin_ns: 1};
        let asked = 0;
        source.rows = async () => { asked += 1; return {time_s: [], cycle: []}; };
        for (let t = 0; t < 3600; t += 10) { source.pieceAt(t); await source._load(Math.floor(t / 10)); }
        return [asked, source._pieces.size]; }"""
    )
    assert kept == [360, 12]


def test_log_that_cannot_be_read_says_why(desktop: Tab, tmp_path: Path) -> None:
    (tmp_path / "notes.mcap").write_text("no log")
    desktop.clean()
    with served_log(tmp_path / "notes.mcap") as url:
        desktop.page.goto(url)
        shows(desktop.page, "#log-failure", "notes.mcap is no log of a run")
        gone(desktop.page, "#log-waiting")
        gone(desktop.page, "#player")
        desktop.page.goto(url.replace("notes", "other"))
        desktop.page.reload()
        shows(desktop.page, "#log-failure", "there is nothing here")
        desktop.page.goto("about:blank")


def test_damaged_log_plays_and_says_what_is_damaged(desktop: Tab, tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap", [record(cycle) for cycle in range(1000)], is_end=False)
    content = bytearray(path.read_bytes())
    content[len(content) * 45 // 100] ^= 0xFF
    path.write_bytes(content[: len(content) * 9 // 10])
    desktop.clean()
    with served_log(path) as url:
        desktop.page.goto(f"{url}&t=1")
        at_cycle(desktop.page, 200)
        shows(desktop.page, "#damage-list", "are damaged")
        shows(desktop.page, "#damage-list", "It ends before its time")
        desktop.page.goto("about:blank")
    assert desktop.complaints == []
