# SPDX-License-Identifier: MIT
"""What is in progress with one robot, and a command as an operator submitted it."""

from collections.abc import Callable
from dataclasses import dataclass

from segway_ecc.deploy.station.connection import Reply, RobotConnection
from segway_ecc.deploy.station.posture import PostureRequest
from segway_ecc.deploy.station.requests import Requests
from segway_ecc.deploy.station.sequences import SequencePlayback
from segway_ecc.deploy.station.stops import Stop
from segway_ecc.deploy.station.views import Command
from segway_ecc.node.sequence.manoeuvre import Manoeuvre


class RobotTasks:
    """What is in progress with one robot.

    Attributes:
        connection: The connection to it.
        requests: Its service requests.
        stop: Its stop.
        posture: Its request to stand up or to sit down.
        playback: The sequence that is played, or was last.
    """

    def __init__(self, connection: RobotConnection, log: Callable[[str, str], None]) -> None:
        """Begin with nothing; `log` takes text and level of events."""
        self.connection = connection
        self.requests = Requests(connection)
        self.stop = Stop(connection, log)
        self.posture = PostureRequest(connection)
        self.playback: SequencePlayback | None = None
        self._log = log

    @property
    def is_pending(self) -> bool:
        """Whether a report or a response of the robot is awaited."""
        return self.requests.is_pending or self.stop.is_pending or self.posture.is_pending

    def step(self, now_ns: int) -> None:
        """Send again what is not confirmed yet."""
        self.stop.step(now_ns)
        self.requests.step(now_ns)
        self.posture.step(now_ns)

    def break_off(self, reason: str) -> bool:
        """End the sequence that is played; False where none is."""
        if self.playback is None or self.playback.is_over:
            return False
        self.playback.break_off(self.connection, reason)
        self.log_outcome(self.playback)
        return True

    def log_outcome(self, playback: SequencePlayback) -> None:
        """Log how a sequence ended."""
        self._log(playback.outcome, "info" if playback.view.state == "done" else "warning")

    def fail(self, text: str) -> None:
        """Reply to everything that is pending that it failed."""
        self.requests.fail(text)
        self.posture.end(text)
        self.stop.cancel(text)


@dataclass(frozen=True, slots=True)
class SubmittedCommand:
    """A command as it was submitted.

    Attributes:
        who: The operator.
        command: The command.
        reply: Called with the outcome.
        at_ns: When, monotonic.
        manoeuvre: What is to be played, decoded already; the error's text where it is not valid.
    """

    who: str
    command: Command
    reply: Reply
    at_ns: int
    manoeuvre: Manoeuvre | str = ""
