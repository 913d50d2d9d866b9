"""A browser, a fake station and the page in it; anything the page complains of fails the test."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.node.supervisor.page.fake_station import FakeStation
from tests.node.supervisor.page.told import armed

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = Path("/usr/bin/chromium")


# Of a module, not of the session: while it lives, nothing else in this process can run an event loop.
@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - it may not be there

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture
def station() -> Iterator[FakeStation]:
    fake = FakeStation()
    fake.robot("/alice", **armed())
    yield fake
    fake.close()
    assert fake.refused == [], "the page sent what no station takes"
    assert fake.ids == sorted(set(fake.ids)), "ids must count up"


@contextmanager
def _opened(browser: "Browser", url: str, **options: Any) -> "Iterator[Page]":
    context = browser.new_context(reduced_motion="reduce", **options)
    context.set_default_timeout(20_000)
    tab = context.new_page()
    complaints: list[str] = []
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("console", lambda said: complaints.append(said.text) if _is_complaint(said.type, said.text) else None)
    tab.goto(url)
    tab.wait_for_selector("body[data-fresh=true]")
    tab.wait_for_selector("#robot:not([hidden])")
    yield tab
    context.close()
    assert complaints == []


@pytest.fixture
def page(browser: "Browser", station: FakeStation) -> "Iterator[Page]":
    """The page at the fake station, with its first picture."""
    with _opened(browser, station.url, viewport={"width": 1280, "height": 800}) as tab:
        yield tab


@pytest.fixture
def browser_touch(browser: "Browser", station: FakeStation) -> "Iterator[Page]":
    """The same on a phone."""
    phone = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True}
    with _opened(browser, station.url, **phone) as tab:
        yield tab


# A request that is refused is told on the console too; a test that has one refused means it.
def _is_complaint(kind: str, text: str) -> bool:
    return kind in {"error", "warning"} and "WebSocket connection" not in text and "Failed to load resource" not in text


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Where screenshots go: SEGWAY_ECC_SCREENSHOTS, or a folder that is thrown away."""
    folder = Path(os.environ.get("SEGWAY_ECC_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
