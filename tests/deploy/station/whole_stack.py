# SPDX-License-Identifier: MIT
"""A robot, the plant at the other end of its bus, the station and its page, each in a process of its own."""

import contextlib
import json
import math
import os
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import pytest

from segway_ecc.hil.drill.plant_control import Tick, Torque, read_trace, torque_after
from segway_ecc.hil.processes import Command as Process
from segway_ecc.hil.processes import command
from segway_ecc.node.config import read_text
from tests.patience import PATIENCE_S
from tests.ros_domains import next_domain

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PATIENCE_MS: Final = PATIENCE_S * 1e3
NAMESPACE: Final = "/alice"
DOWN: Final = 0.4
"""Pitch of a segway that lies on its stop at 0.5 rad."""
SIZES: Final = {"desktop": (1280, 800), "phone": (360, 740)}
_POLL_S: Final = 0.02
_TAIL: Final = 8192


def until(condition: Callable[[], object], what: str, patience_s: float = PATIENCE_S) -> None:
    deadline = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"never came: {what}")
        time.sleep(_POLL_S)


@contextlib.contextmanager
def ros_of_our_own(folder: Path) -> Iterator[None]:
    """A ROS domain that never leaves this machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", next_domain())
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.setenv("ROS_LOG_DIR", str(folder))
        yield


class Truth(NamedTuple):
    """What the plant does, whatever anybody tells of it: m, m/s, rad."""

    x: float
    velocity: float
    pitch: float


class Stack:
    """Starts, kills and starts again what a robot's operation consists of."""

    def __init__(self, folder: Path, robot: str, station: str = "{}") -> None:
        """Prepare a packaged robot that waits to be asked to arm, with another section `station`."""
        self.folder = folder
        self._stack = contextlib.ExitStack()
        self._processes: dict[str, Process] = {}
        self._starts = 0
        self.port = 0
        lines = [line for line in read_text(robot).splitlines() if not line.startswith(("station:", "arming:"))]
        file = folder / f"{robot}.yaml"
        file.write_text("\n".join([*lines, "arming: on_request", f"station: {station}", ""]), "utf-8")
        self._words = [str(file), "--interface", "local", "--channel", f"whole_{os.getpid()}_{robot}"]

    def close(self) -> None:
        self._stack.close()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def start_plant(self) -> None:
        files = ["--truth", str(self.folder / "truth.csv"), "--trace", str(self.folder / "trace.csv")]
        self._start("plant", *self._words, *files)

    def start_robot(self) -> None:
        self._start("run", *self._words, "--ros", "--no-log", "--namespace", NAMESPACE)

    def start_station(self) -> None:
        """On the port that it had before, where it had one."""
        folders = ["--folder", str(self.folder / "station"), "--logs", str(self.folder / "logs")]
        output = self._start("station", "serve", "--json", "--name", "base", "--port", str(self.port), *folders)
        until(lambda: "open http" in output.read_text("utf-8"), "the station's address")
        found = re.search(r"open http://127\.0\.0\.1:(\d+)/", output.read_text("utf-8"))
        assert found is not None
        self.port = int(found[1])

    def kill(self, verb: str) -> float:
        """SIGKILL; when, monotonic s."""
        process = self._processes[verb].process
        process.kill()
        at_s = time.monotonic()
        process.wait()
        return at_s

    def output(self, verb: str) -> str:
        """The messages of the one that was started last."""
        return max(self.folder.glob(f"{verb}-*.txt"), key=lambda path: path.stat().st_mtime_ns).read_text("utf-8")

    def pid(self, verb: str) -> int:
        return self._processes[verb].process.pid

    def is_running(self, verb: str) -> bool:
        return verb in self._processes and self._processes[verb].process.poll() is None

    def truth(self) -> Truth:
        """The newest line of what the plant writes; not a number while it has written none."""
        path = self.folder / "truth.csv"
        if not path.exists():
            return Truth(math.nan, math.nan, math.nan)
        with path.open("rb") as file:
            names = file.readline().decode().strip().split(",")
            file.seek(max(file.seek(0, os.SEEK_END) - _TAIL, 0))
            lines = file.read().decode().split("\n")
        if len(lines) < 3:
            return Truth(math.nan, math.nan, math.nan)
        values = dict(zip(names, lines[-2].split(","), strict=True))
        pitch = float(values.get("truth.pitch", "nan"))
        return Truth(float(values["truth.x"]), float(values["truth.linear_velocity"]), pitch)

    def ticks(self) -> list[Tick]:
        return read_trace(self.folder / "trace.csv")

    def torque_after(self, fault_ns: int) -> Torque:
        return torque_after(self.ticks(), fault_ns, time.monotonic_ns())

    def was_driven(self, at_ns: int) -> bool:
        """Whether the drive's last tick before a moment left a motor driven."""
        return [tick for tick in self.ticks() if tick.monotonic_ns <= at_ns][-1].is_driven

    def audit(self) -> list[dict[str, object]]:
        lines = (self.folder / "station" / "audit.jsonl").read_text("utf-8").splitlines()
        return [json.loads(line) for line in lines]

    def _start(self, verb: str, *words: str) -> Path:
        self._starts += 1
        messages = self.folder / f"{verb}-{self._starts}.txt"
        self._processes[verb] = self._stack.enter_context(command([verb, *words], messages))
        return messages


class OperatorPage:
    """An operator at the page: what is on it, and the keys and buttons."""

    def __init__(self, page: "Page", pictures: Path | None = None) -> None:
        self.page = page
        self.complaints: list[str] = []
        self._pictures = pictures
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def text(self, selector: str) -> str:
        return self.page.text_content(selector) or ""

    @property
    def mode(self) -> str:
        return self.text("#mode")

    def shows(self, selector: str, text: str) -> None:
        until(lambda: text in self.text(selector), f"{text!r} in {selector}; {self.situation()}")

    def situation(self) -> str:
        """What the page tells, for somebody who has to find out why a test failed."""
        parts = [self.text(place) for place in ("#mode", "#reason", "#command-state", "#command-failure")]
        return " | ".join([*parts, *self.page.locator("#events li").all_text_contents()[:12]])

    def is_disabled(self, act: str) -> bool:
        return self.page.get_attribute(f"[data-act={act}]", "aria-disabled") == "true"

    def press(self, act: str) -> None:
        """Press a button as soon as it may be pressed."""
        until(lambda: not self.is_disabled(act), f"that {act} may be pressed; {self.situation()}")
        self.page.click(f"[data-act={act}]")

    def arm(self) -> None:
        """Arm, as often as the robot refuses: it needs the plant's frames, and the rate of the first second.

        Where the machine stalls it is in FAULT at once, which may be all that is seen of it.
        """

        def is_armed() -> bool:
            if self.mode == "FAULT" and not self.is_disabled("clear_fault"):
                self.page.click("[data-act=clear_fault]")
                self.page.wait_for_timeout(300)
            if self.mode == "DISARMED" and not self.is_disabled("arm"):
                self.page.click("[data-act=arm]")
                self.page.wait_for_timeout(300)
            return self.mode in {"ARMED", "HOLD"}

        until(is_armed, f"armed; {self.situation()}")

    def look(self, name: str, at: str = "#robots") -> None:
        """Take a picture of the state at both sizes, of the part of the page that has `at`."""
        if self._pictures is None:
            return
        for size, (width, height) in SIZES.items():
            self.page.set_viewport_size({"width": width, "height": height})
            self.page.locator(at).scroll_into_view_if_needed()
            self.page.wait_for_timeout(300)  # a moment to draw in; nothing is proved by it
            self.page.screenshot(path=self._pictures / f"stack-{name}-{size}.png")
        width, height = SIZES["desktop"]
        self.page.set_viewport_size({"width": width, "height": height})


@contextlib.contextmanager
def operator_page_at(browser: "Browser", url: str, pictures: Path | None = None) -> Iterator[OperatorPage]:
    """A page that is open; what it complains of fails the test."""
    width, height = SIZES["desktop"]
    context = browser.new_context(viewport={"width": width, "height": height}, reduced_motion="reduce")
    context.set_default_timeout(PATIENCE_MS)
    seat = OperatorPage(context.new_page(), pictures)
    seat.page.goto(url)
    yield seat
    context.close()
    assert seat.complaints == []
