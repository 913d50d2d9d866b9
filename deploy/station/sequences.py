# SPDX-License-Identifier: MIT
"""Has one robot play a sequence, as one trajectory. Pure: time is given."""

import enum
from collections.abc import Sequence
from typing import Final

from segway_ecc.deploy.station.control import fitted
from segway_ecc.deploy.station.planned_path import planned_path
from segway_ecc.deploy.station.requests import WITHIN_NS, Reply, RobotConnection
from segway_ecc.deploy.station.views import SequenceView
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import CANCEL, TOO_LATE, Trajectory, TrajectoryState, TrajectoryStatus
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Manoeuvre, Odometry, Player, PlayState, start_stamp

LONGEST_TEXT: Final = 65_536
_LONGEST_NAME: Final = 80
_SHORTEST_S: Final = 0.01
"""Of a segment: a robot at 100 Hz would not follow a shorter one."""
_AGAIN_NS: Final = 500_000_000
_GOES_ON: Final = (TrajectoryState.ACCEPTED, TrajectoryState.FOLLOWED)
_UNCONFIRMED: Final = "; the robot does not confirm that it stopped"


@enum.unique
class _State(enum.StrEnum):
    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    BROKEN_OFF = "broken off"
    FAILED = "failed"


def read_sequence(text: str, name: str, limits: Setpoint) -> Manoeuvre:
    """Decode a sequence file, YAML that holds set-points up to `limits`; messages call it `name`.

    Raises:
        ConfigurationError: It is not a sequence that may be played.
    """
    if len(text.encode(errors="replace")) > LONGEST_TEXT:
        raise ConfigurationError(f"{name} is longer than {LONGEST_TEXT // 1024} KiB")
    manoeuvre = decode_yaml(text, Manoeuvre, name)
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
    """A sequence that is played, or was: it is sent whole, and confirmed by the robot before it begins."""

    def __init__(self, manoeuvre: Manoeuvre, name: str, reply: Reply, now_ns: int) -> None:
        self._player = Player(manoeuvre)
        self._manoeuvre = manoeuvre
        self._path: Sequence[tuple[float, float]] = ()
        self._name = name[:_LONGEST_NAME] or "sequence"
        self._reply: Reply | None = reply
        self._state = _State.WAITING
        self._reason = ""
        self._since_ns = now_ns
        self._lead_ns = LEAD_NS
        self._sent: Trajectory | None = None
        self._again_ns = now_ns
        self._is_cancelling = False
        self._unconfirmed = ""

    @property
    def is_over(self) -> bool:
        """Whether it ended."""
        return self._state not in (_State.WAITING, _State.RUNNING)

    @property
    def view(self) -> SequenceView:
        """How far it is."""
        return SequenceView(
            name=self._name,
            fraction=self._player.fraction,
            state=self._state.value,
            reason=self._reason + self._unconfirmed,
            path=() if self.is_over else self._path,
        )

    @property
    def outcome(self) -> str:
        """For the event log."""
        reason = f": {self._reason}" if self._reason else ""
        return f"sequence {self._name}: {self._state.value}{reason}{self._unconfirmed}"

    def on_status(self, status: TrajectoryStatus) -> None:
        """Receive what the robot reports of a trajectory."""
        self._player.receive_status(status)
        if self.is_over:
            return
        reason = self._player.status.reason if self._player.status is not None else ""
        match self._player.state:
            case PlayState.REFUSED if reason.startswith(TOO_LATE):
                self._sent, self._lead_ns, self._again_ns = None, 2 * self._lead_ns, 0  # again, with more time
            case PlayState.REFUSED:
                self._end(_State.FAILED, f"the robot refused it: {reason}")
            case PlayState.BROKEN_OFF:
                self._end(_State.BROKEN_OFF, reason)
            case PlayState.RUNNING if self._state is _State.WAITING:
                self._state = _State.RUNNING
                self._answer(accepted=True, text=f"{self._name} is being played")

    def step(self, connection: RobotConnection, odometry: Odometry | None, now_ns: int) -> None:
        """Send it, again where no answer comes, until the robot confirms it; then follow the robot's time.

        What was broken off is cancelled, until the robot reports its end, and `outcome` has it where that is late.
        """
        if self.is_over:
            self._cancel(connection, now_ns)
            return
        if self._state is _State.WAITING and now_ns - self._since_ns > WITHIN_NS:
            self.break_off(connection, "the robot does not answer whether it takes it", now_ns, failed=True)
            return
        if odometry is not None:
            self._player.latest_ns = odometry.stamp_ns
            if self._state is _State.RUNNING and not self._path:
                self._path = planned_path(self._manoeuvre, odometry)
        if self._player.state is PlayState.DONE:
            self._end(_State.DONE, "")
        elif self._state is _State.WAITING and odometry is not None and now_ns >= self._again_ns:
            self._sent = self._sent or self._player.trajectory(start_stamp(odometry.stamp_ns, self._lead_ns))
            self._again_ns = now_ns + _AGAIN_NS
            connection.follow(self._sent)

    def break_off(self, connection: RobotConnection, reason: str, now_ns: int, *, failed: bool = False) -> None:
        """End it: an empty trajectory brings the robot to rest."""
        if self.is_over:
            return
        self._is_cancelling, self._since_ns, self._again_ns = self._sent is not None, now_ns, now_ns
        self._cancel(connection, now_ns)
        self._end(_State.FAILED if failed else _State.BROKEN_OFF, reason)

    def _cancel(self, connection: RobotConnection, now_ns: int) -> None:
        status, is_late = self._player.status, now_ns - self._since_ns > WITHIN_NS
        self._is_cancelling = self._is_cancelling and (status is None or status.state in _GOES_ON)
        self._unconfirmed = _UNCONFIRMED if self._is_cancelling and is_late else ""
        # A robot that never answered may not have it, and follow another's by now.
        if self._is_cancelling and now_ns >= self._again_ns and not (status is None and is_late):
            self._again_ns = now_ns + _AGAIN_NS
            connection.follow(CANCEL)

    def _end(self, state: _State, reason: str) -> None:
        self._state, self._reason = state, reason
        self._answer(accepted=state is _State.DONE, text=self.outcome)

    def _answer(self, *, accepted: bool, text: str) -> None:
        reply, self._reply = self._reply, None
        if reply is not None:
            reply(accepted, text)
