# SPDX-License-Identifier: MIT
"""What is requested of one robot, each with a time-out, over the connection that this needs. Pure: time is given.

Services; and the stop, sent until the drives confirm it and latched until the fault is cleared.
"""

import enum
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, TypeAlias

from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import Trajectory
from segway_ecc.node.safety.modes import Action, Mode

WITHIN_NS: Final = 2_000_000_000
NO_ANSWER: Final = f"no answer within {WITHIN_NS / 1e9:g} s"
Reply: TypeAlias = Callable[[bool, str], None]
"""Called once, with whether a command was confirmed and the text."""
AGAIN_NS: Final = 100_000_000
_LATER_NS: Final = 1_000_000_000
"""Period of the retries after it was reported as failed: a robot that reconnects is to stop then."""
_MOST_WAITING: Final = 100
_logger: Final = logging.getLogger(__name__)


class ServiceResponse(NamedTuple):
    """A robot's response to a service request."""

    action: Action
    number: int
    accepted: bool
    message: str


class RobotConnection(Protocol):
    """Sends to a robot; nothing of it waits."""

    def is_ready(self, action: Action) -> bool:
        """Whether a node offers the service."""

    def call(self, action: Action) -> int:
        """Send a service request; return its number."""

    def responses(self) -> Iterable[ServiceResponse]:
        """The service responses that have arrived."""

    def drive(self, setpoint: Setpoint) -> None:
        """Send a set-point for now."""

    def follow(self, trajectory: Trajectory) -> None:
        """Send a whole manoeuvre, or an empty one to end it."""

    def introduce(self, station: str) -> None:
        """Ask the robot to rely on the heartbeats of this station."""


def once(reply: Reply) -> Reply:
    """A reply of which only the first call counts; an exception that it raises is logged and ends nothing."""
    waiting = [reply]

    def called(accepted: bool, text: str) -> None:  # noqa: FBT001 - the contract's form
        if waiting:
            try:
                waiting.pop()(accepted, text)
            except Exception:
                _logger.exception("a reply failed")

    return called


@dataclass(slots=True)
class _Pending:
    reply: Reply
    since_ns: int
    number: int | None = None


class Requests:
    """The service requests to one robot; at most one of each kind is pending."""

    def __init__(self, connection: RobotConnection) -> None:
        self._connection = connection
        self._pending: dict[Action, _Pending] = {}

    @property
    def is_pending(self) -> bool:
        """Whether a response is awaited."""
        return bool(self._pending)

    def send(self, action: Action, reply: Reply, now_ns: int) -> None:
        """Send a request, as soon as the service is discovered."""
        if action in self._pending:
            reply(False, "the same request is pending; wait for its answer")  # noqa: FBT003 - the contract's form
            return
        self._pending[action] = _Pending(reply, now_ns)
        self.step(now_ns)

    def on_response(self, response: ServiceResponse) -> None:
        """Reply with a response; one that arrives after its time-out is discarded."""
        pending = self._pending.get(response.action)
        if pending is not None and pending.number == response.number:
            del self._pending[response.action]
            pending.reply(response.accepted, response.message)

    def step(self, now_ns: int) -> None:
        """Send what waits for its service, and fail what took too long."""
        for action, pending in list(self._pending.items()):
            if now_ns - pending.since_ns > WITHIN_NS:
                del self._pending[action]
                why = NO_ANSWER if pending.number is not None else f"no node offers {action} there; {NO_ANSWER}"
                pending.reply(False, why)  # noqa: FBT003 - the contract's form
            elif pending.number is None and self._connection.is_ready(action):
                pending.number = self._connection.call(action)

    def fail(self, text: str) -> None:
        """Fail every pending request."""
        requests, self._pending = self._pending, {}
        for pending in requests.values():
            pending.reply(False, text)  # noqa: FBT003 - the contract's form


@enum.unique
class StopState(enum.StrEnum):
    """How far a stop has come."""

    NONE = ""
    REQUESTED = "requested"
    CONFIRMED = "confirmed"


class Stop:
    """Confirmed by a FAULT that the robot reports after the request, with drives that report that they are off.

    For a robot without drives it is confirmed by commands that are zero. It may be requested before the robot is found.

    Attributes:
        state: How far it has come.
        after_s: From request to confirmation, s.
        who: Who requested it first.
    """

    def __init__(self, log: Callable[[str, str], None]) -> None:
        """Begin with none; `log` takes text and level of events that no reply reports."""
        self.state = StopState.NONE
        self.after_s: float | None = None
        self.who = ""
        self._connection: RobotConnection | None = None
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

    def connect(self, connection: RobotConnection) -> None:
        """Send it over `connection` from now on, as the robot is found."""
        self._connection = connection

    def send(self, who: str, reply: Reply, requested_ns: int, now_ns: int) -> None:
        """Send it now, or join the one that is pending and send that again; `who` asked at `requested_ns`."""
        if len(self._waiting) >= _MOST_WAITING:
            reply(False, "a stop is pending and not confirmed yet")  # noqa: FBT003 - the contract's form
            return
        if not self.is_pending:
            self.state, self.after_s, self._requested_ns, self._tries = StopState.REQUESTED, None, requested_ns, 0
            self._response, self._reported, self._has_failed, self.who = "", "", False, who
        self._waiting.append(reply)
        self._call(now_ns)

    def on_response(self, response: ServiceResponse) -> None:
        """Keep the service's response for the failure's text; it confirms nothing by itself."""
        self._response = response.message if response.accepted else f"refused: {response.message}"

    def on_mode(self, mode: ModeReport, received_ns: int, *, is_disputed: bool = False) -> None:
        """Check the reported mode and drives; what another node may have published confirms nothing."""
        if self.state is StopState.CONFIRMED and mode.mode is not Mode.FAULT:
            self.state, self.after_s = StopState.NONE, None
            self._log(f"the stop is over: {mode.mode}: {mode.reason}", "warning")
        elif self.state is StopState.REQUESTED and received_ns > self._requested_ns:
            self._reported = f"{mode.mode}, drives {mode.drives or 'unknown'}"
            if is_disputed:
                self._reported += ", by one of several nodes that publish mode"
            elif mode.is_stopped:
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
            if self._connection is None:
                why = "no robot is found in this namespace; the stop is sent as soon as one is"
            elif self._response or self._reported:
                answer = f"it answered '{self._response}'" if self._response else "no answer"
                why = f"{answer}, but it is {self._reported or 'silent'}"
            self._reply_all(accepted=False, text=f"{why}; retries continue")
        if now_ns - self._sent_ns >= (_LATER_NS if self._has_failed else AGAIN_NS):
            self._call(now_ns)

    def cancel(self, text: str) -> None:
        """End one that is not confirmed, as when an operator takes it back or clears the fault."""
        if self.state is StopState.REQUESTED:
            self.state = StopState.NONE
            self._reply_all(accepted=False, text=text)

    def _call(self, now_ns: int) -> None:
        self._sent_ns = now_ns
        if self._connection is not None:
            self._connection.call(Action.STOP)
            self._tries += 1

    def _reply_all(self, *, accepted: bool, text: str) -> None:
        waiting, self._waiting = self._waiting, []
        for reply in waiting:
            reply(accepted, text)
