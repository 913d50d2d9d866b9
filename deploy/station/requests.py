# SPDX-License-Identifier: MIT
"""Requests to a robot's services, each with a time-out. Pure: time is given."""

from dataclasses import dataclass
from typing import Final

from segway_ecc.deploy.station.connection import Reply, RobotConnection, ServiceResponse
from segway_ecc.node.safety.modes import Action

WITHIN_NS: Final = 2_000_000_000
NO_ANSWER: Final = f"no answer within {WITHIN_NS / 1e9:g} s"


@dataclass(slots=True)
class _Pending:
    reply: Reply
    since_ns: int
    number: int | None = None


class Requests:
    """The service requests to one robot; at most one of each kind is pending."""

    def __init__(self, connection: RobotConnection) -> None:
        """Send over `connection`."""
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
