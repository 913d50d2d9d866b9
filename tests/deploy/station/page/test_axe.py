# SPDX-License-Identifier: MIT
"""axe-core finds nothing wrong with any page, in any state, size or theme."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import pytest

from segway_ecc.deploy.station.views import EventView, SequenceView, TrialView
from segway_ecc.deploy.station.web.downloads import RobotLogs, logs_page
from segway_ecc.deploy.support.archive_files import LogFile
from tests.deploy.station.page.axe import violations
from tests.deploy.station.page.conftest import Tab
from tests.deploy.station.page.fake_station import PAGE, FakeStation
from tests.deploy.station.page.page_waits import load_again, shows, there
from tests.deploy.station.page.robot_states import CHECKS, armed, lost
from tests.deploy.station.page.served_log import served_log
from tests.deploy.station.playback.log_maker import story, write_log

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.browser

SIZES = {"phone": (360, 740), "landscape": (844, 390), "desktop": (1280, 800)}
OFF = {"drives": "off", "posture": "RESTING", "controller": ""}
STATES: dict[str, dict[str, object]] = {
    "armed": armed(sequence=SequenceView(name="line", fraction=0.4, state="running", path=[(0.0, 0.0), (1.0, 0.0)])),
    "disarmed": armed(**OFF | {"mode": "DISARMED", "reason": "just started", "checklist": CHECKS}),
    "hold": armed(mode="HOLD", reason="set-points fell silent"),
    "stopped": armed(mode="FAULT", posture="FALLEN", reason="stopped", stop="confirmed", stop_after_s=0.01),
    "lost": lost(),
}


@contextmanager
def opened(browser: "Browser", url: str, size: str, theme: Any) -> "Iterator[Page]":
    width, height = SIZES[size]
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme=theme, reduced_motion="reduce"
    )
    page = context.new_page()
    page.goto(url)
    yield page
    context.close()


@pytest.mark.variants(2)
@pytest.mark.parametrize(("size", "theme"), [("desktop", "light"), ("phone", "dark"), ("landscape", "light")])
def test_live_page_violates_no_rule_in_any_state(
    browser: "Browser", station: FakeStation, size: str, theme: str
) -> None:
    trials = (TrialView(name="push", title="Push", effect="It is pushed."),)
    station.script.hello = msgspec.structs.replace(station.script.hello, trials=trials)
    station.robot("/bob", **armed(name="Bob", mode="DISARMED", controller="bert"))
    station.tell(EventView(number=1, wall_ns=1_790_000_000_000_000_000, robot="/alice", text="fell", level="error"))
    with opened(browser, station.url, size, theme) as page:
        there(page, "body[data-fresh=true]")
        there(page, "#scene[data-tilt]")
        for name, state in STATES.items():
            station.robot("/alice", **state)
            shows(page, "#mode", "LOST" if name == "lost" else str(state["mode"]))
            station.wait_seen(3)
            assert violations(page) == [], name
        station.fall_silent()
        there(page, "body[data-fresh=false]")
        assert violations(page) == [], "no station"


def test_form_that_signs_in_violates_no_rule(page: "Page", station: FakeStation) -> None:
    station.script.token = "secret"  # noqa: S105 - of a test
    page.reload()
    there(page, "#login-form")
    assert violations(page) == []
    station.script.token = ""
    load_again(page)


@pytest.mark.parametrize(("size", "theme"), [("desktop", "dark"), ("phone", "light"), ("landscape", "dark")])
def test_page_that_plays_a_log_violates_no_rule(browser: "Browser", tmp_path: Path, size: str, theme: str) -> None:
    records = [each for each in story() if not 800 <= each.cycle < 1000]
    with served_log(write_log(tmp_path / "run.mcap", records)) as url, opened(browser, url, size, theme) as page:
        there(page, "#scene[data-tilt]")
        there(page, "#plots[data-shown]")
        for moment, mode in (("2", "ARMED"), ("4.5", "ARMED"), ("10", "FAULT")):
            page.fill("#moment", moment)
            shows(page, "#mode", mode)
            assert violations(page) == [], f"at {moment} s"


def test_page_of_logs_violates_no_rule(desktop: Tab) -> None:
    logs = [LogFile("Alice-20261126T101500Z-12.mcap", 12345, 1_790_000_000_000_000_000)]
    robots = [RobotLogs("/alice", logs), RobotLogs("/bob", error="robot /bob hands out nothing")]
    styles = "".join((PAGE / name).read_text(encoding="utf-8") for name in ("theme.css", "style.css"))
    desktop.clean()
    desktop.page.set_content(logs_page(logs, robots, may_fetch=True))
    desktop.page.add_style_tag(content=styles)
    assert violations(desktop.page) == []
    desktop.page.goto("about:blank")
