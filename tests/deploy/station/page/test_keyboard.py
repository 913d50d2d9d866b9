# SPDX-License-Identifier: MIT
"""One set of keys, shown on the screen: each does what its button does."""

from typing import TYPE_CHECKING

import msgspec
import pytest

from segway_ecc.deploy.station.views import Act, TrialView
from segway_ecc.hil.play.keys import KEYS
from tests.deploy.station.page.fake_station import HELLO, FakeStation
from tests.deploy.station.page.page_waits import gone, load_again, shows, there

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.browser

TRIALS = tuple(TrialView(name=name, title=name, effect="something") for name in ("push", "cut", "recover"))
STATES: dict[str, dict[str, object]] = {
    "arm": {"mode": "DISARMED"},
    "clear_fault": {"mode": "FAULT"},
    "take_control": {"controller": "bert"},
}
COMMANDS = [(act, key) for act, keys, _ in KEYS for key in keys if act in set(Act) - {Act.STOP}]
ALWAYS = [
    "\u2191 W ahead",
    "\u2193 S back",
    "\u2190 A left",
    "\u2192 D right",
    "X rest",
    "Esc Space STOP",
    "T take control",
    "M arm",
    "N disarm",
    "C clear fault",
]


def _shown(page: "Page") -> list[str]:
    return [text.strip() for text in page.locator("#keys li").all_inner_texts()]


def test_the_page_has_the_table_of_the_terminal(page: "Page") -> None:
    rows = page.evaluate("async () => (await import('/static/keys.js')).KEYS")
    assert rows == [[act, list(keys), words] for act, keys, words in KEYS]


@pytest.mark.variants(3)
@pytest.mark.parametrize(("act", "key"), COMMANDS)
def test_a_key_does_what_its_button_does(page: "Page", station: FakeStation, act: str, key: str) -> None:
    station.robot(**STATES.get(act, {}))
    there(page, f"[data-act={act}]:not([aria-disabled])")
    page.keyboard.press(key)
    station.wait(lambda: station.commands)
    station.wait_frames(2)
    assert [(c.robot, c.act) for c in station.commands] == [("/alice", Act(act))]
    assert page.get_attribute(f"[data-act={act}]", "aria-keyshortcuts") == key.upper()


@pytest.mark.parametrize(("key", "name"), [("p", "push"), ("b", "cut"), ("r", "recover")])
def test_the_demos_keys_do_what_its_buttons_do(page: "Page", station: FakeStation, key: str, name: str) -> None:
    page.keyboard.press(key)
    station.script.hello = msgspec.structs.replace(HELLO, trials=TRIALS)
    load_again(page)
    there(page, "#trials")
    assert station.commands == [], "a real robot has no such key"
    page.keyboard.press(key)
    station.wait(lambda: station.commands)
    assert [(c.act, c.name) for c in station.commands] == [(Act.TRY, name)]


def test_the_keys_that_do_something_are_shown(page: "Page", station: FakeStation) -> None:
    shows(page, "#keys", "clear fault")
    assert _shown(page) == [*ALWAYS, "U stand up", "J sit down"]
    assert page.inner_text("#stop-keys") == "Esc, Space or gamepad B"
    station.robot(can_stand=False)
    gone(page, "[data-act=stand]")
    station.wait_frames(2)
    assert _shown(page) == ALWAYS
    station.script.hello = msgspec.structs.replace(HELLO, trials=TRIALS)
    load_again(page)
    there(page, "#trials")
    assert _shown(page)[-3:] == ["P push", "B cut the bus", "R repair"]


def test_x_brings_to_rest_what_is_driven(page: "Page", station: FakeStation) -> None:
    page.keyboard.down("w")
    station.wait(lambda: len(station.drives) > 2)
    page.keyboard.press("x")
    station.wait(lambda: station.drives[-1].linear == 0.0)
    count = len(station.drives)
    station.wait_frames(6)
    assert len(station.drives) == count, "the key is still held, and counts no more"
    assert station.commands == []


@pytest.mark.parametrize("place", ["#sequence-text", "#sequence-name"])
def test_letters_in_a_text_field_are_text(page: "Page", station: FakeStation, place: str) -> None:
    page.fill(place, "")
    page.focus(place)
    page.keyboard.type("mncujtpbrx")
    station.wait_frames(3)
    assert page.input_value(place) == "mncujtpbrx"
    assert station.commands == []


@pytest.mark.parametrize("chord", ["Control+m", "Alt+n", "Meta+u"])
def test_with_a_modifier_it_is_the_browsers(page: "Page", station: FakeStation, chord: str) -> None:
    page.keyboard.press(chord)
    station.wait_frames(3)
    assert station.commands == []


def test_a_key_that_is_held_asks_once(page: "Page", station: FakeStation) -> None:
    for _ in range(3):
        page.keyboard.down("n")
    page.keyboard.up("n")
    station.wait(lambda: station.commands)
    station.wait_frames(3)
    assert [command.act for command in station.commands] == [Act.DISARM]


def test_a_key_that_is_refused_says_why(page: "Page", station: FakeStation) -> None:
    page.keyboard.press("c")
    shows(page, "#command-failure", "Clear fault: There is no fault to clear")
    assert station.commands == []


def test_letters_can_be_switched_off_and_esc_and_arrows_not(page: "Page", station: FakeStation) -> None:
    """Who speaks to the computer, or hits keys by accident, needs that (WCAG 2.1.4)."""
    page.click("#letter-keys")
    for key in ("n", "w"):
        page.keyboard.press(key)
    station.wait_frames(3)
    assert (station.commands, station.drives) == ([], [])
    page.keyboard.down("ArrowUp")
    station.wait(lambda: station.drives)
    page.keyboard.up("ArrowUp")
    page.keyboard.press("Escape")
    station.wait(lambda: station.commands)
    assert [command.act for command in station.commands] == [Act.STOP]


def test_the_switch_keeps_no_focus_that_a_pointer_gave_it(page: "Page", station: FakeStation) -> None:
    page.click(".switch", position={"x": 90, "y": 20})
    page.wait_for_function("() => !document.querySelector('#letter-keys').checked")
    page.wait_for_function("() => document.activeElement === document.body")
    page.keyboard.press(" ")
    station.wait(lambda: station.commands)
    assert [command.act for command in station.commands] == [Act.STOP]


@pytest.mark.parametrize(
    ("key", "code", "name"),
    [
        ("w", "KeyW", "w"),
        ("W", "KeyW", "w"),
        ("z", "KeyW", "z"),  # a French keyboard: the letter counts
        ("\u0446", "KeyW", "w"),  # a Russian one types no Latin letter: the place counts
        (" ", "Space", "Space"),
        ("Escape", "Escape", "Escape"),
        ("Shift", "ShiftLeft", "Shift"),
        (None, None, ""),  # what a browser fills in comes as an event without a key
    ],
)
def test_a_key_is_known_by_its_letter(page: "Page", key: str | None, code: str | None, name: str) -> None:
    found = page.evaluate(
        """async ([key, code]) => (await import('/static/keys.js')).nameOf(
            {key: key ?? undefined, code: code ?? undefined})""",
        [key, code],
    )
    assert found == name
