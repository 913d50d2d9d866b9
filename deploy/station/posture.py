"""Telling a robot to stand up or to sit down, until it says that this is in force. Pure: time is given."""

from typing import Final

from segway_ecc.deploy.station.connection import Reply, RobotConnection
from segway_ecc.deploy.station.requests import WITHIN_NS
from segway_ecc.deploy.station.robot_messages import ModeReport

_AGAIN_NS: Final = 100_000_000


class PostureRequest:
    """What one robot was told last of standing and sitting."""

    def __init__(self, line: RobotConnection) -> None:
        """Tell it over `line`."""
        self._line = line
        self._reply: Reply | None = None
        self._up = False
        self._asked_ns = self._told_ns = 0

    @property
    def is_pending(self) -> bool:
        """Whether the robot's word is waited for."""
        return self._reply is not None

    def ask(self, reply: Reply, now_ns: int, *, up: bool) -> None:
        """Tell it to stand `up`, or to sit down; what it was told before counts no more."""
        self.fail("it was told otherwise before it had taken this")
        self._reply, self._up = reply, up
        self._asked_ns, self._told_ns = now_ns, now_ns
        self._line.stand(up=up)

    def hear(self, mode: ModeReport) -> None:
        """Take the robot's word."""
        if mode.stand == float(self._up):
            self._end(f"the robot has taken it: {'stand up' if self._up else 'sit down'}", accepted=True)

    def step(self, now_ns: int) -> None:
        """Tell it again: it may not have been connected yet; and give up what takes too long."""
        if self._reply is None:
            return
        if now_ns - self._asked_ns > WITHIN_NS:
            self.fail(f"the robot has not taken it within {WITHIN_NS / 1e9:g} s")
        elif now_ns - self._told_ns >= _AGAIN_NS:
            self._told_ns = now_ns
            self._line.stand(up=self._up)

    def fail(self, text: str) -> None:
        """Give it up."""
        self._end(text, accepted=False)

    def _end(self, text: str, *, accepted: bool) -> None:
        reply, self._reply = self._reply, None
        if reply is not None:
            reply(accepted, text)
