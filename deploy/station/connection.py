# SPDX-License-Identifier: MIT
"""What the station needs of its connection to one robot."""

import logging
from collections.abc import Callable, Iterable
from typing import Final, NamedTuple, Protocol, TypeAlias

from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.safety.modes import Action

Reply: TypeAlias = Callable[[bool, str], None]
"""Called once, with whether a command was confirmed and the text."""

_logger: Final = logging.getLogger(__name__)


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

    def drive(self, setpoint: Setpoint, stamp_ns: int | None = None) -> None:
        """Send a set-point for now, or for a moment of the robot's time, ns since the Unix epoch."""

    def stand(self, *, up: bool) -> None:
        """Request standing up, or sitting down."""
