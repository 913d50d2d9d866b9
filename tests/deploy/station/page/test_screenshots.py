# SPDX-License-Identifier: MIT
"""The main states at each size and in both themes; nothing hangs over the edge, and nothing is too small to hit."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from segway_ecc.deploy.station.views import EventView, SequenceView
from tests.deploy.station.page.fake_station import FakeStation
from tests.deploy.station.page.page_waits import there
from tests.deploy.station.page.robot_states import CHECKS, armed, lost
from tests.patience import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.browser

SIZES = {"phone": (360, 740), "landscape": (740, 360), "desktop": (1280, 800)}
OFF: dict[str, object] = {"drives": "off", "posture": "RESTING"}
"""A robot that has no torque balances nowhere."""
PATH = [(1.25 + 0.05 * step, -0.5 + 0.4 * math.sin(0.1 * step)) for step in range(64)]
STATES: dict[str, dict[str, object]] = {
    "armed": armed(),
    "disarmed": armed(**OFF, mode="DISARMED", reason="just started", controller="", checklist=dict(CHECKS)),
    "hold": armed(mode="HOLD", reason="set-points fell silent"),
    "stopped": armed(
        **OFF | {"posture": "FALLEN"},
        mode="FAULT",
        reason="stopped by ann",
        is_zero=True,
        stop="confirmed",
        stop_after_s=0.0123,
    ),
    "lost": lost(),
    "sequence": armed(sequence=SequenceView(name="figure eight", fraction=0.42, state="running", path=PATH)),
}


def _fill(station: FakeStation, state: dict[str, object]) -> None:
    station.robot("/alice", **state)
    station.robot("/bob", **armed(**OFF, name="Bob", mode="DISARMED", controller=""))
    station.robot("/carol", **lost() | {"name": "Carol", "age_s": 74.0})
    fallen = OFF | {"posture": "FALLEN", "mode": "FAULT", "reason": "tilt beyond the limit"}
    station.robot("/dave", **armed(**fallen, name="Dave", controller="bert"))
    for number, (text, level) in enumerate(
        [
            ("found", "info"),
            ("armed", "info"),
            ("the serial line is lost", "warning"),
            ("tilt beyond the limit", "error"),
        ]
    ):
        wall_ns = 1_790_000_000_000_000_000 + number * 1_300_000_000
        station.tell(EventView(number=number + 1, wall_ns=wall_ns, robot="/alice", text=text, level=level, who="ann"))


def _move(station: FakeStation, frames: int) -> None:
    """Let it drive about, so that the plots have something to show."""
    start = station.frames
    while station.frames < start + frames:
        t = 0.05 * (station.frames - start)
        moving = {
            "pitch": 0.06 * math.sin(2.1 * t),
            "linear_velocity": 0.4 * math.sin(t) + 0.03 * math.sin(9 * t),
            "linear_setpoint": 0.4 if math.sin(t) > 0 else -0.4,
            "angular_velocity": 0.3 * math.cos(0.8 * t),
            "angular_setpoint": 0.3,
        }
        station.robot("/alice", **moving)
        station.wait_frames(1)


@pytest.mark.variants(1)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_main_states_fit_the_screen(
    browser: "Browser", station: FakeStation, pictures: Path, size: str, theme: Any
) -> None:
    width, height = SIZES[size]
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=theme)
    context.set_default_timeout(PATIENCE_S * 1e3)
    tab = context.new_page()
    tab.goto(station.url)
    there(tab, "body[data-fresh=true]")
    for name, state in STATES.items():
        station.robot("/alice", **armed())
        if name == "armed":
            _fill(station, state)
            _move(station, 40)
        station.robot("/alice", **state)
        word = "LOST" if name == "lost" else str(state["mode"])
        tab.wait_for_function("word => document.querySelector('#mode').textContent === word", arg=word)
        station.wait_frames(6)
        tab.screenshot(path=pictures / f"{name}-{size}-{theme}.png")
        if name == "disarmed":
            tab.screenshot(path=pictures / f"{name}-{size}-{theme}-full.png", full_page=True)
        assert tab.evaluate("document.documentElement.scrollWidth") <= width, f"{name} hangs over the edge"
        stop = tab.locator("#stop").bounding_box()
        assert stop is not None
        assert stop["y"] + stop["height"] <= height, "STOP is out of sight"
    station.fall_silent()
    there(tab, "#stale:not([hidden])")
    tab.screenshot(path=pictures / f"no-station-{size}-{theme}.png")
    context.close()
