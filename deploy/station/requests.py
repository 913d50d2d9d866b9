"""Requests to a robot's services, each with a time-out. Pure: time is given."""

from dataclasses import dataclass
from typing import Final

from segway_ecc.deploy.station.connection import Reply, RobotConnection, ServiceResponse
from segway_ecc.node.safety.modes import Action

WITHIN_NS: Final = 2_000_000_000
NO_ANSWER: Final = f"no answer within {WITHIN_NS / 1e9:g} s"


@dataclass(slots=True)
class _Asked:
    reply: Reply
    asked_ns: int
    number: int | None = None


class Requests:
    """What one robot was asked; at most one request of each kind is under way."""

    def __init__(self, line: RobotConnection) -> None:
        """Ask over `line`."""
        self._line = line
        self._asked: dict[Action, _Asked] = {}

    @property
    def is_pending(self) -> bool:
        """Whether an answer is waited for."""
        return bool(self._asked)

    def ask(self, action: Action, reply: Reply, now_ns: int) -> None:
        """Ask, as soon as the service is seen."""
        if action in self._asked:
            reply(False, "it has been asked already, and has not answered yet")  # noqa: FBT003 - the contract's form
            return
        self._asked[action] = _Asked(reply, now_ns)
        self.step(now_ns)

    def take(self, answered: ServiceResponse) -> None:
        """Take an answer; one that nobody waits for any more is dropped."""
        asked = self._asked.get(answered.action)
        if asked is not None and asked.number == answered.number:
            del self._asked[answered.action]
            asked.reply(answered.accepted, answered.message)

    def step(self, now_ns: int) -> None:
        """Send what waits for its service, and give up what took too long."""
        for action, asked in list(self._asked.items()):
            if now_ns - asked.asked_ns > WITHIN_NS:
                del self._asked[action]
                why = NO_ANSWER if asked.number is not None else f"nobody offers {action} there; {NO_ANSWER}"
                asked.reply(False, why)  # noqa: FBT003 - the contract's form
            elif asked.number is None and self._line.is_ready(action):
                asked.number = self._line.call(action)

    def fail(self, text: str) -> None:
        """Give up everything."""
        asked, self._asked = self._asked, {}
        for one in asked.values():
            one.reply(False, text)  # noqa: FBT003 - the contract's form
