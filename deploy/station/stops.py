# SPDX-License-Identifier: MIT
"""The stop of one robot: sent until the drives confirm it, and latched until the fault is cleared.

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
"""Period of the retries after it was reported as failed: a robot that reconnects is to stop then."""
_MOST_WAITING: Final = 100


@enum.unique
class StopState(enum.StrEnum):
    """How far a stop has come."""

    NONE = ""
    REQUESTED = "requested"
    CONFIRMED = "confirmed"


class Stop:
    """Confirmed by a FAULT that the robot reports after the request, with drives that report that they are off.

    For a robot that has no drives it is confirmed by commands that are zero.

    Attributes:
        state: How far it has come.
        after_s: From the request to the confirmation, s.
    """

    def __init__(self, connection: RobotConnection, log: Callable[[str, str], None]) -> None:
        """Stop over `connection`; `log` takes text and level of events that no reply reports."""
        self.state = StopState.NONE
        self.after_s: float | None = None
        self._connection = connection
        self._log = log
        self._waiting: list[Reply] = []
        self._requested_ns = 0
        self._sent_ns = 0
        self._tries = 0
        self._response = ""
        self._reported = ""
        self._has_failed = False

    @property
    def is_pending(self) -> bool:
        """Whether it was requested and is neither confirmed nor failed."""
        return self.state is StopState.REQUESTED and not self._has_failed

    def send(self, reply: Reply, requested_ns: int, now_ns: int) -> None:
        """Send it now, or join the one that is pending and send that again.

        Args:
            reply: Called with the outcome.
            requested_ns: When the operator requested it.
            now_ns: The present.
        """
        if len(self._waiting) >= _MOST_WAITING:
            reply(False, "a stop is pending and not confirmed yet")  # noqa: FBT003 - the contract's form
            return
        if not self.is_pending:
            self.state, self.after_s, self._requested_ns, self._tries = StopState.REQUESTED, None, requested_ns, 0
            self._response, self._reported, self._has_failed = "", "", False
        self._waiting.append(reply)
        self._call(now_ns)

    def on_response(self, response: ServiceResponse) -> None:
        """Keep the service's response for the failure's text; it confirms nothing by itself."""
        self._response = response.message if response.accepted else f"refused: {response.message}"

    def on_mode(self, mode: ModeReport, received_ns: int) -> None:
        """Check the reported mode and drives."""
        if self.state is StopState.CONFIRMED and mode.mode is not Mode.FAULT:
            self.state, self.after_s = StopState.NONE, None
            self._log(f"the stop is over: {mode.mode}: {mode.reason}", "warning")
        elif self.state is StopState.REQUESTED and received_ns > self._requested_ns:
            self._reported = f"{mode.mode}, drives {mode.drives or 'unknown'}"
            if mode.is_stopped:
                self.state, self.after_s = StopState.CONFIRMED, (received_ns - self._requested_ns) * 1e-9
                what = "drives off" if mode.drives == "off" else "commands zero"
                text = f"stopped after {self.after_s * 1e3:.0f} ms: {what}; {mode.reason}"
                if not self._waiting:  # it was reported as failed before
                    self._log(text, "warning")
                self._reply_all(accepted=True, text=text)

    def step(self, now_ns: int) -> None:
        """Send it again, and report what took too long."""
        if self.state is not StopState.REQUESTED:
            return
        if not self._has_failed and now_ns - self._requested_ns > WITHIN_NS:
            self._has_failed = True
            why = f"{NO_ANSWER}, tried {self._tries} times"
            if self._response or self._reported:
                answer = f"it answered '{self._response}'" if self._response else "no answer"
                why = f"{answer}, but it is {self._reported or 'silent'}"
            self._reply_all(accepted=False, text=f"{why}; retries continue")
        if now_ns - self._sent_ns >= (_LATER_NS if self._has_failed else AGAIN_NS):
            self._call(now_ns)

    def cancel(self, text: str) -> None:
        """End one that is not confirmed, as when the operator clears the fault."""
        if self.state is StopState.REQUESTED:
            self.state = StopState.NONE
            self._reply_all(accepted=False, text=text)

    def _call(self, now_ns: int) -> None:
        self._connection.call(Action.STOP)
        self._sent_ns = now_ns
        self._tries += 1

    def _reply_all(self, *, accepted: bool, text: str) -> None:
        waiting, self._waiting = self._waiting, []
        for reply in waiting:
            reply(accepted, text)
