# SPDX-License-Identifier: MIT
"""Plays a sequence to one robot through its stamped set-points. Pure: time is given."""

import enum
from collections.abc import Iterable
from typing import Final

from segway_ecc.deploy.station.control import fitted
from segway_ecc.deploy.station.requests import WITHIN_NS, Reply, RobotConnection
from segway_ecc.deploy.station.robot_messages import SetpointReport
from segway_ecc.deploy.station.views import SequenceView
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Player, PlayState, TimedSetpoint

LONGEST_TEXT: Final = 65_536
_LONGEST_NAME: Final = 80
_SHORTEST_S: Final = 0.01
"""Of a segment: thousands of shorter ones would have to be sent at once."""
_FOLLOWS_NS: Final = 1_500_000_000
"""Longer than it takes to detect a lost robot, which is the better reason."""


@enum.unique
class _State(enum.StrEnum):
    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    BROKEN_OFF = "broken off"
    FAILED = "failed"


def read_sequence(text: str, name: str, limits: Setpoint) -> Manoeuvre:
    """Decode a sequence file.

    Args:
        text: The YAML.
        name: What to call it in messages.
        limits: The largest set-points that it may hold.

    Raises:
        ConfigurationError: It is not a sequence that may be played.
    """
    if len(text.encode(errors="replace")) > LONGEST_TEXT:
        raise ConfigurationError(f"{name} is longer than {LONGEST_TEXT // 1024} KiB")
    try:
        manoeuvre = decode_yaml(text, Manoeuvre, name)
    except RecursionError as error:
        raise ConfigurationError(f"{name} is nested too deeply") from error
    for index, segment in enumerate(manoeuvre.segments):
        wanted = Setpoint(segment.linear, segment.angular)
        if fitted(*wanted, limits) != wanted:
            raise ConfigurationError(
                f"{name}: segment {index} asks for {wanted[0]:g} m/s and {wanted[1]:g} rad/s; allowed are "
                f"{limits[0]:g} m/s and {limits[1]:g} rad/s"
            )
        if not segment.duration >= _SHORTEST_S:
            raise ConfigurationError(f"{name}: segment {index} is shorter than {_SHORTEST_S:g} s")
    return manoeuvre


class SequencePlayback:
    """A sequence that is played, or was.

    It is confirmed by the first of its set-points that the robot brings into force.
    """

    def __init__(self, manoeuvre: Manoeuvre, name: str, reply: Reply, now_ns: int) -> None:
        self._player = Player(manoeuvre)
        self._name = name[:_LONGEST_NAME] or "sequence"
        self._reply: Reply | None = reply
        self._state = _State.WAITING
        self._reason = ""
        self._followed_ns = now_ns
        self._setpoint_ns = 0

    @property
    def is_over(self) -> bool:
        """Whether it ended."""
        return self._state not in (_State.WAITING, _State.RUNNING)

    @property
    def view(self) -> SequenceView:
        """How far it is."""
        return SequenceView(
            name=self._name, fraction=self._player.fraction, state=self._state.value, reason=self._reason
        )

    @property
    def outcome(self) -> str:
        """For the event log."""
        return f"sequence {self._name}: {self._state.value}" + (f": {self._reason}" if self._reason else "")

    def on_setpoint(self, setpoint: SetpointReport, now_ns: int) -> None:
        """Note which set-point is in force."""
        start_ns = self._player.start_ns
        if self.is_over or start_ns is None or setpoint.stamp_ns < start_ns or setpoint.stamp_ns == self._setpoint_ns:
            return
        self._setpoint_ns, self._followed_ns, self._state = setpoint.stamp_ns, now_ns, _State.RUNNING
        self._answer(accepted=True, text=f"{self._name} is being played")

    def step(self, connection: RobotConnection, odometry: Odometry | None, now_ns: int) -> None:
        """Send what is due by the robot's own time."""
        if self.is_over:
            return
        progress = self._player.update(odometry) if odometry is not None else PlayState.RUNNING
        if progress is PlayState.DONE and self._state is _State.RUNNING:
            self._end(_State.DONE, "")
            return
        self._player.received.clear()
        self._send(connection, self._player.due_setpoints())
        patience_ns = _FOLLOWS_NS if self._state is _State.RUNNING else WITHIN_NS
        if now_ns - self._followed_ns > patience_ns:
            why = "the robot does not follow: none of the set-points came into force"
            self.break_off(connection, why, failed=True)

    def break_off(self, connection: RobotConnection, reason: str, *, failed: bool = False) -> None:
        """End it: zeros replace all set-points that were sent ahead."""
        if self.is_over:
            return
        self._send(connection, self._player.abandon())
        self._end(_State.FAILED if failed else _State.BROKEN_OFF, reason)

    def _send(self, connection: RobotConnection, setpoints: Iterable[TimedSetpoint]) -> None:
        for timed in setpoints:
            connection.drive(timed.setpoint, (self._player.start_ns or 0) + timed.offset_ns)

    def _end(self, state: _State, reason: str) -> None:
        self._state, self._reason = state, reason
        self._answer(accepted=state is _State.DONE, text=self.outcome)

    def _answer(self, *, accepted: bool, text: str) -> None:
        reply, self._reply = self._reply, None
        if reply is not None:
            reply(accepted, text)
