# SPDX-License-Identifier: MIT
"""Requests to stand up or to sit down, repeated until the robot reports the value in force. Pure: time is given."""

from typing import Final

from segway_ecc.deploy.station.connection import Reply, RobotConnection
from segway_ecc.deploy.station.requests import WITHIN_NS
from segway_ecc.deploy.station.robot_messages import ModeReport

_AGAIN_NS: Final = 100_000_000


class PostureRequest:
    """The newest request to one robot to stand up or to sit down."""

    def __init__(self, connection: RobotConnection) -> None:
        """Send over `connection`."""
        self._connection = connection
        self._reply: Reply | None = None
        self._up = False
        self._since_ns = self._sent_ns = 0

    @property
    def is_pending(self) -> bool:
        """Whether the robot's confirmation is awaited."""
        return self._reply is not None

    def send(self, reply: Reply, now_ns: int, *, up: bool) -> None:
        """Request standing `up`, or sitting down; an earlier request that is pending fails."""
        self.end("replaced by a later request before it was confirmed")
        self._reply, self._up = reply, up
        self._since_ns = self._sent_ns = now_ns
        self._connection.stand(up=up)

    def on_mode(self, mode: ModeReport) -> None:
        """Confirm the request where the robot reports its value as in force."""
        if mode.stand == float(self._up):
            self.end(f"the robot has accepted it: {'stand up' if self._up else 'sit down'}", accepted=True)

    def step(self, now_ns: int) -> None:
        """Send again, as the robot may not have been connected yet; fail what takes too long."""
        if self._reply is None:
            return
        if now_ns - self._since_ns > WITHIN_NS:
            self.end(f"the robot has not accepted it within {WITHIN_NS / 1e9:g} s")
        elif now_ns - self._sent_ns >= _AGAIN_NS:
            self._sent_ns = now_ns
            self._connection.stand(up=self._up)

    def end(self, text: str, *, accepted: bool = False) -> None:
        """Reply where a request is pending, by default that it failed."""
        reply, self._reply = self._reply, None
        if reply is not None:
            reply(accepted, text)
