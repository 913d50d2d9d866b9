"""The stop of one robot: sent until what the drive does confirms it, and latched until the fault is cleared.

Pure: time is given.
"""

import enum
from collections.abc import Callable
from typing import Final

from segway_ecc.deploy.station.connection import Reply, RobotConnection, ServiceResponse
from segway_ecc.deploy.station.requests import NO_ANSWER, WITHIN_NS
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.node.safety.modes import Action, Mode

AGAIN_NS: Final = 100_000_000
_LATER_NS: Final = 1_000_000_000
"""How often it is tried after it was reported as failed: the robot may come back, and is to stop then."""
_MOST_WAITING: Final = 100

Tell = Callable[[str, str], None]
"""Tells the event log a text and its level, of what no reply tells."""


@enum.unique
class StopState(enum.StrEnum):
    """How far a stop has come."""

    NONE = ""
    ASKED = "asked"
    CONFIRMED = "confirmed"


class Stop:
    """A stop is confirmed by the robot's FAULT, heard after it was asked for, with drives that say that they are off.

    Of a robot that has no drives it is confirmed by commands that are zero.

    Attributes:
        state: How far it has come.
        after_s: From the request to the confirmation, s.
    """

    def __init__(self, line: RobotConnection, tell: Tell) -> None:
        """Stop over `line`."""
        self.state = StopState.NONE
        self.after_s: float | None = None
        self._line = line
        self._tell = tell
        self._waiting: list[Reply] = []
        self._asked_ns = 0
        self._sent_ns = 0
        self._tries = 0
        self._answer = ""
        self._doing = ""
        self._has_failed = False

    @property
    def is_pending(self) -> bool:
        """Whether it was asked for and is neither confirmed nor failed."""
        return self.state is StopState.ASKED and not self._has_failed

    def ask(self, reply: Reply, asked_ns: int, now_ns: int) -> None:
        """Send it now; one that is under way already is joined.

        Args:
            reply: Told what came of it.
            asked_ns: When the operator asked.
            now_ns: The present.
        """
        if len(self._waiting) >= _MOST_WAITING:
            reply(False, "it has been asked already, and is not confirmed yet")  # noqa: FBT003 - the contract's form
            return
        if not self.is_pending:
            self.state, self.after_s, self._asked_ns, self._tries = StopState.ASKED, None, asked_ns, 0
            self._answer, self._doing, self._has_failed = "", "", False
        self._waiting.append(reply)
        self._send(now_ns)

    def take(self, answered: ServiceResponse) -> None:
        """What the robot's service says; it does not confirm anything by itself."""
        self._answer = answered.message if answered.accepted else f"refused: {answered.message}"

    def hear(self, mode: ModeReport, heard_ns: int) -> None:
        """Look at what the drive does."""
        if self.state is StopState.CONFIRMED and mode.mode is not Mode.FAULT:
            self.state, self.after_s = StopState.NONE, None
            self._tell(f"the stop is over: {mode.mode}: {mode.reason}", "warning")
        elif self.state is StopState.ASKED and heard_ns > self._asked_ns:
            self._doing = f"{mode.mode}, drives {mode.drives or 'unknown'}"
            if mode.is_stopped:
                self._confirm(mode, heard_ns)

    def step(self, now_ns: int) -> None:
        """Try again, and report what took too long."""
        if self.state is not StopState.ASKED:
            return
        if not self._has_failed and now_ns - self._asked_ns > WITHIN_NS:
            self._has_failed = True
            self._answer_all(accepted=False, text=f"{self._why()}; it is tried on")
        if now_ns - self._sent_ns >= (_LATER_NS if self._has_failed else AGAIN_NS):
            self._send(now_ns)

    def drop(self, text: str) -> None:
        """Forget it, as the operator who clears the fault wants."""
        if self.state is StopState.ASKED:
            self.state = StopState.NONE
            self._answer_all(accepted=False, text=text)

    def _confirm(self, mode: ModeReport, heard_ns: int) -> None:
        self.state, self.after_s = StopState.CONFIRMED, (heard_ns - self._asked_ns) * 1e-9
        what = "drives off" if mode.drives == "off" else "commands zero"
        text = f"stopped after {self.after_s * 1e3:.0f} ms: {what}; {mode.reason}"
        if not self._waiting:  # it was reported as failed before
            self._tell(text, "warning")
        self._answer_all(accepted=True, text=text)

    def _send(self, now_ns: int) -> None:
        self._line.call(Action.STOP)
        self._sent_ns = now_ns
        self._tries += 1

    def _why(self) -> str:
        if not self._answer and not self._doing:
            return f"{NO_ANSWER}, tried {self._tries} times"
        answer = f"it answered '{self._answer}'" if self._answer else "no answer"
        return f"{answer}, but it is {self._doing or 'silent'}"

    def _answer_all(self, *, accepted: bool, text: str) -> None:
        waiting, self._waiting = self._waiting, []
        for reply in waiting:
            reply(accepted, text)
