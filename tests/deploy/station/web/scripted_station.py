# SPDX-License-Identifier: MIT
"""A station that a test controls, and remembers what it was asked."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence

from segway_ecc.deploy.station.requests import Reply
from segway_ecc.deploy.station.views import Command, Drive, EventView, FleetView, RobotView, TrialView
from segway_ecc.node.cycle.setpoints import Setpoint


class ScriptedStation:
    """Answers every command at once, from another thread, as the real one does."""

    def __init__(self, robots: Sequence[RobotView] = (), clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with these robots; `clock` is what pictures are stamped with, s."""
        self.limits = Setpoint(1.0, 2.0)
        self.trials: Sequence[TrialView] = ()
        self.commands: list[tuple[str, Command]] = []
        self.drives: list[tuple[str, Drive]] = []
        self.gone: list[str] = []
        self.answer = (True, "done")
        self.robots = robots
        self._events: list[EventView] = []
        self._clock = clock
        self._picture = FleetView(time_s=clock(), robots=robots)

    def fleet(self) -> FleetView:
        return self._picture

    def tick(self) -> None:
        """A new picture."""
        self._picture = FleetView(time_s=self._clock(), robots=self.robots)

    def events(self, after: int) -> Sequence[EventView]:
        return self._events[after:]

    def happen(self, text: str) -> None:
        self._events = [*self._events, EventView(number=len(self._events) + 1, wall_ns=0, robot="", text=text)]

    def refused(self) -> Mapping[str, int]:
        return {"too large": 1}

    def submit(self, who: str, command: Command, reply: Reply) -> None:
        self.commands.append((who, command))
        threading.Thread(target=reply, args=self.answer).start()

    def drive(self, who: str, drive: Drive) -> None:
        self.drives.append((who, drive))

    def leave(self, who: str) -> None:
        self.gone.append(who)


def full_robot(name: str) -> RobotView:
    """A robot that tells everything, as large in JSON as a real one."""
    phase = "p50 123.4 us, p99 234.5 us, p99.9 345.6 us, max 1234.5 us, 123456 samples"
    names = ("exchange", "stage", "decide", "equations", "limit", "record", "lateness", "rest")
    link = {"state": "active", "frames received": "1234567", "frames sent": "234567", "errors": "0", "load": "34.5 %"}
    return RobotView(
        robot=name,
        name=name.strip("/"),
        is_alive=True,
        age_s=0.012,
        round_trip_s=0.0123456,
        mode="ARMED",
        reason="armed by the operator",
        drives="on",
        is_zero=False,
        pitch=0.0123456789,
        linear_velocity=0.123456789,
        angular_velocity=-0.123456789,
        linear_setpoint=0.125,
        angular_setpoint=-0.125,
        x=12.3456789,
        y=-2.3456789,
        heading=1.23456789,
        supply_v=36.123,
        checklist={f"check number {number}": "ok" for number in range(12)},
        links=dict.fromkeys(("can", "serial", "imu"), link),
        timing=dict.fromkeys(names, phase),
        can_stand=True,
        posture="STANDING UP",
    )
