# SPDX-License-Identifier: MIT
"""What is requested of one robot, each with a time-out, over the connection that this needs. Pure: time is given.

Services; standing up and sitting down, repeated until the robot reports the value in force; and the stop, sent until
the drives confirm it and latched until the fault is cleared.
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

    def stand(self, *, up: bool) -> None:
        """Request standing up, or sitting down."""


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


class PostureRequest:
    """The newest request to one robot to stand up or to sit down."""

    def __init__(self, connection: RobotConnection) -> None:
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
        elif now_ns - self._sent_ns >= AGAIN_NS:
            self._sent_ns = now_ns
            self._connection.stand(up=self._up)

    def end(self, text: str, *, accepted: bool = False) -> None:
        """Reply where a request is pending, by default that it failed."""
        reply, self._reply = self._reply, None
        if reply is not None:
            reply(accepted, text)


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
        """Send it now, or join the one that is pending and send that again; the operator asked at `requested_ns`."""
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
