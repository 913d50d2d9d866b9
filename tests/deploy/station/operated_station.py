# SPDX-License-Identifier: MIT
"""A station that a test operates."""

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import Act, Command, Drive, RobotView
from tests.patience import PATIENCE_S


class Operated:
    """A station with an operator's hands."""

    def __init__(self, station: Station) -> None:
        self.station = station

    def robot(self, name: str) -> RobotView | None:
        return next((robot for robot in self.station.fleet().robots if robot.robot == name), None)

    def wait_for(self, name: str, condition: Callable[[RobotView], object]) -> RobotView:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            robot = self.robot(name)
            if robot is not None and condition(robot):
                return robot
            time.sleep(0.01)
        pytest.fail(f"{name} does not come to that: {self.robot(name)}; {self.texts(name)}")

    def submit(self, who: str, act: Act, robot: str = "/a", text: str = "") -> Callable[[], tuple[bool, str]]:
        """Give a command; call what is returned for the outcome."""
        outcomes: list[Any] = []
        came = threading.Event()

        def reply(*outcome: Any) -> None:
            outcomes.append(outcome)
            came.set()

        self.station.submit(who, Command(id=1, robot=robot, act=act, text=text, name="one"), reply)

        def outcome() -> tuple[bool, str]:
            assert came.wait(PATIENCE_S)
            assert len(outcomes) == 1
            accepted, text = outcomes[0]
            return accepted, text

        return outcome

    def drive(self, linear: float) -> None:
        self.station.drive("ann", Drive(id=1, robot="/a", linear=linear, angular=0.0))

    def texts(self, name: str | None = None) -> list[str]:
        """What has happened, to one robot or at all."""
        return [event.text for event in self.station.events(0) if name is None or event.robot == name]
