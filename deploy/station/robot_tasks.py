"""What is under way with one robot, and a command as it came in."""

from dataclasses import dataclass

from segway_ecc.deploy.station.connection import Reply, RobotConnection
from segway_ecc.deploy.station.posture import PostureRequest
from segway_ecc.deploy.station.requests import Requests
from segway_ecc.deploy.station.sequences import SequencePlayback
from segway_ecc.deploy.station.stops import Stop
from segway_ecc.deploy.station.views import Command
from segway_ecc.node.sequence.manoeuvre import Manoeuvre


@dataclass(slots=True)
class RobotTasks:
    """What is under way with one robot."""

    line: RobotConnection
    requests: Requests
    stop: Stop
    stand: PostureRequest
    playing: SequencePlayback | None = None

    @property
    def is_playing(self) -> bool:
        """Whether a sequence is being played."""
        return self.playing is not None and not self.playing.is_over

    def break_off(self, reason: str) -> bool:
        """End what is played, where something is."""
        if self.playing is None or self.playing.is_over:
            return False
        self.playing.break_off(self.line, reason)
        return True


@dataclass(frozen=True, slots=True)
class SubmittedCommand:
    """A command as it came in.

    Attributes:
        who: Whose it is.
        command: What is asked.
        reply: Told what came of it.
        at_ns: When, monotonic.
        manoeuvre: What is to be played, read already; its error where it is none.
    """

    who: str
    command: Command
    reply: Reply
    at_ns: int
    manoeuvre: Manoeuvre | str = ""
