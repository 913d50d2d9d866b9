# SPDX-License-Identifier: MIT
"""The first minutes of `segway-ecc demo` in a browser: every fault button, a phone, and its log being scrubbed."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.chromium import chromium
from tests.deploy.station.film import Film
from tests.deploy.station.page.page_waits import shows, shows_like, there
from tests.patience import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = [pytest.mark.ros, pytest.mark.browser, pytest.mark.real_time]

DESKTOP = {"width": 1280, "height": 800}
HELD = {"phone": {"width": 390, "height": 844}, "landscape": {"width": 844, "height": 390}}
AGAIN = 5
"""Times that it is brought back: on a busy machine a robot may fall anew as it stands up."""


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    with chromium() as found:
        yield found


@pytest.fixture
def film() -> Film:
    wanted = os.environ.get("SEGWAY_ECC_SCREENSHOTS")
    if wanted:
        Path(wanted).mkdir(parents=True, exist_ok=True)
    return Film(Path(wanted) if wanted else None, time.monotonic())


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    """Of the page of a demo that runs."""
    messages = tmp_path / "messages.txt"
    with messages.open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "demo", "--port", "0", "--no-browser"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )
    try:
        deadline = time.monotonic() + PATIENCE_S
        while (found := re.search(r"open (http://\S+/); Ctrl-C", messages.read_text("utf-8"))) is None:
            assert process.poll() is None, messages.read_text("utf-8")
            assert time.monotonic() < deadline, messages.read_text("utf-8")
            time.sleep(0.05)
        yield found[1]
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(PATIENCE_S)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)


def attempt(page: "Page", name: str) -> str:
    """Press a button and wait for what it led to."""
    page.wait_for_function("(name) => !document.querySelector(`[data-trial=${name}]`).ariaDisabled", arg=name)
    page.evaluate("() => { window.newestBefore = document.querySelector('#trial-results li'); }")
    page.click(f"[data-trial={name}]")
    page.wait_for_function("() => document.querySelector('#trial-results li') !== window.newestBefore")
    return page.locator("#trial-results li").first.inner_text()


def bring_back(page: "Page") -> None:
    for _ in range(AGAIN):
        if "it is back" in attempt(page, "recover"):
            return
    pytest.fail(f"it did not come back: {page.inner_text('#trial-results')}")


def test_every_fault_button_does_what_it_says_and_the_log_shows_it(browser: "Browser", url: str, film: Film) -> None:
    context = browser.new_context(viewport=DESKTOP)  # type: ignore[arg-type]  # its own kind of dictionary
    context.set_default_timeout(PATIENCE_S * 1e3)
    page = context.new_page()
    page.goto(url)
    there(page, "body[data-fresh=true]")
    film.take(page, "open", "The page opens")
    shows_like(page, "#headline", "BALANCING|FALLEN")
    if page.inner_text("#headline") == "FALLEN":  # as it stood up, beside a browser that starts
        bring_back(page)
    there(page, "#scene[data-tilt=ok]")
    film.take(page, "balancing", "The robot stands, and its tilt limits are the fan around it")
    drive(page, film)
    names = page.eval_on_selector_all("[data-trial]", "all => all.map((button) => button.dataset.trial)")
    assert len(names) == 11
    for name in names:
        if name == "recover":
            continue
        page.eval_on_selector("#scene-panel", "(scene) => scene.scrollIntoView()")
        words = attempt(page, name)
        assert "failed" not in words, words
        film.take(page, name, words)
        bring_back(page)
    film.take(page, "back", "It was brought back after each")
    for size, viewport in HELD.items():
        page.set_viewport_size(viewport)  # type: ignore[arg-type]  # as above
        page.eval_on_selector("html", "(html) => html.scrollTo(0, 0)")
        shows(page, "#mode", "ARMED")
        film.take(page, size, f"The same in the hand: {size}")
    page.set_viewport_size(DESKTOP)  # type: ignore[arg-type]  # as above
    scrub(page, url, film)
    context.close()


def drive(page: "Page", film: Film) -> None:
    """Take control, and drive ahead for a while."""
    page.click("[data-act=take_control]")
    page.wait_for_function("() => document.querySelector('[data-act=take_control]').ariaDisabled === 'true'")
    page.keyboard.down("w")
    page.wait_for_function(
        "() => [...document.querySelectorAll('#readouts div')].some((row) =>"
        " row.innerText.startsWith('Speed') && parseFloat(row.innerText.split('\\n')[1]) > 0.15)"
    )
    film.take(page, "driving", "It is driven with a key, and the ghost is where it will be in a second")
    page.keyboard.up("w")
    shows(page, "#drive-now", "Not driving")


def scrub(page: "Page", url: str, film: Film) -> None:
    """Open the log of what the robot does in the browser, and move through it."""
    page.goto(f"{url}logs")
    page.click(".play-log")
    there(page, "#plots[data-shown]")
    shows_like(page, "#log-summary", r"\d+ cycles")
    film.take(page, "log", "Its log, opened with Play on the page of logs")
    end = float(page.get_attribute("#moment", "max") or 0.0)
    for share in (0.3, 0.6, 0.9):
        moment = f"{share * end:.3f}"
        page.fill("#moment", moment)
        # With its mode: only then is the robot of that moment here.
        page.wait_for_function(
            "(moment) => document.querySelector('#moment').ariaValueText?.startsWith(`${moment} s, `)", arg=moment
        )
        words = ", ".join(filter(None, page.inner_text("#mode-box").split("\n")))
        film.take(page, f"scrub-{share * 100:.0f}", f"Scrubbed to {moment} s: {words}")
    before = page.evaluate("() => Number(document.body.dataset.cycle)")
    page.keyboard.press("ArrowLeft")
    page.wait_for_function("(before) => Number(document.body.dataset.cycle) < before", arg=before)
