# SPDX-License-Identifier: MIT
"""A browser, a fake station and the page in it; anything the page complains of fails the test."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.chromium import chromium
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import loaded
from tests.deploy.station.page.robot_states import armed
from tests.patience import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ConsoleMessage, Page

HELD = ("ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "KeyW", "KeyA", "KeyS", "KeyD", "Escape", "Control")
"""What tests hold down and may leave so."""


# Of a module, not of the session: while it lives, nothing else in this process can run an event loop.
@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    with chromium() as found:
        yield found


@pytest.fixture
def station() -> Iterator[FakeStation]:
    fake = FakeStation()
    fake.robot("/alice", **armed())
    yield fake
    fake.close()
    assert fake.refused == [], "the page sent what no station takes"
    assert fake.ids == sorted(set(fake.ids)), "ids must count up"


_MEANT = ("WebSocket connection", "Failed to load resource", "GPU stall due to ReadPixels")
"""What may stand on the console: a request or a socket that a test has refused, and what a screenshot costs."""


class Tab:
    """A tab that outlives a test, and what its page complains of."""

    def __init__(self, browser: "Browser", options: dict[str, Any]) -> None:
        """Open it in a context of its own."""
        self._viewport = options["viewport"]
        self.complaints: list[str] = []
        self._context = browser.new_context(reduced_motion="reduce", **options)
        self._context.set_default_timeout(PATIENCE_S * 1e3)
        self.page = self._context.new_page()
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._listen)

    def close(self) -> None:
        """Close it with its context."""
        self._context.close()

    def clean(self) -> None:
        """Forget what a test before left: keys and buttons held, cookies, a size; the page's script stores nothing."""
        for key in HELD:
            self.page.keyboard.up(key)
        self.page.mouse.up()
        self.page.mouse.move(0, 0)
        self._context.clear_cookies()
        if self.page.viewport_size != self._viewport:
            self.page.set_viewport_size(self._viewport)
        self.complaints.clear()

    def _listen(self, output: "ConsoleMessage") -> None:
        meant = any(text in output.text for text in _MEANT)
        if output.type in {"error", "warning"} and not meant:
            self.complaints.append(output.text)


@contextmanager
def _tab(browser: "Browser", **options: Any) -> Iterator[Tab]:
    tab = Tab(browser, options)
    yield tab
    tab.close()


@contextmanager
def _opened(tab: Tab, url: str) -> "Iterator[Page]":
    tab.clean()
    tab.page.goto(url)
    loaded(tab.page)
    yield tab.page
    tab.page.goto("about:blank")
    assert tab.complaints == []


# A new tab costs as much as the rest of a test, so the tests of a module have one, which each finds clean.
@pytest.fixture(scope="module")
def desktop(browser: "Browser") -> Iterator[Tab]:
    with _tab(browser, viewport={"width": 1280, "height": 800}) as tab:
        yield tab


@pytest.fixture
def page(desktop: Tab, station: FakeStation) -> "Iterator[Page]":
    """The page at the fake station, with its first picture."""
    with _opened(desktop, station.url) as page:
        yield page


@pytest.fixture
def browser_touch(browser: "Browser", station: FakeStation) -> "Iterator[Page]":
    """The same on a phone, in a tab of its own: nobody lifts the fingers that a test leaves on it."""
    phone = _tab(browser, viewport={"width": 360, "height": 740}, has_touch=True, is_mobile=True)
    with phone as tab, _opened(tab, station.url) as page:
        yield page


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Where screenshots go: SEGWAY_ECC_SCREENSHOTS, or a folder that is thrown away."""
    folder = Path(os.environ.get("SEGWAY_ECC_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
