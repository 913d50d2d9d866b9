# SPDX-License-Identifier: MIT
"""What the parts of the web server share: the robots, the audit log, the limits, and why something is refused."""

import enum
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, Protocol

import msgspec
from aiohttp import web

from segway_ecc.deploy.station.requests import Reply
from segway_ecc.deploy.station.views import Command, Drive, FleetStatus, TrialView
from segway_ecc.deploy.station.web.audit import AuditLog
from segway_ecc.deploy.station.web.limits import Limits
from segway_ecc.node.cycle.setpoints import Setpoint


@enum.unique
class Cause(enum.StrEnum):
    """Why something was refused."""

    FOREIGN_HOST = "foreign host"
    """The page's address is a name that is not ours, as when somebody's name server points at us (DNS rebinding)."""
    FOREIGN_ORIGIN = "foreign origin"
    NO_SESSION = "no session"
    WRONG_TOKEN = "wrong token"  # noqa: S105 - the name of a cause
    VIEWER = "viewer"
    NOT_FOUND = "not found"
    BAD_HTTP = "bad HTTP"
    BAD_REQUEST = "bad request"
    OVERSIZED = "oversized"
    MALFORMED = "malformed"
    OUT_OF_RANGE = "out of range"
    REPLAYED_COMMAND = "replayed command"
    LOGIN_RATE = "login rate"
    CONNECTION_RATE = "connection rate"
    REQUEST_RATE = "request rate"
    MESSAGE_RATE = "message rate"
    COMMAND_RATE = "command rate"
    DRIVE_RATE = "drive rate"
    TOO_MANY_CONNECTIONS = "too many connections"
    TOO_MANY_SOCKETS = "too many sockets"
    SILENT_CONNECTION = "silent connection"
    TOO_SLOW = "too slow"
    FAILED = "failed"
    """A defect of ours, logged once in the station's messages."""


_STATUS: Final = {
    Cause.FOREIGN_HOST: (421, "the station is not known by this name; see --host"),
    Cause.FOREIGN_ORIGIN: (403, "a page of another site may not request this"),
    Cause.NO_SESSION: (401, "log in first"),
    Cause.WRONG_TOKEN: (403, "the token is wrong"),
    Cause.VIEWER: (403, "a viewer may only watch"),
    Cause.NOT_FOUND: (404, "there is nothing here"),
    Cause.BAD_REQUEST: (400, "this is not a valid request here"),
    Cause.OVERSIZED: (413, "this is too large"),
    Cause.LOGIN_RATE: (429, "too many attempts; wait a moment"),
    Cause.REQUEST_RATE: (429, "too many requests; wait a moment"),
    Cause.TOO_MANY_SOCKETS: (503, "too many browsers are connected already"),
    Cause.FAILED: (500, "the station failed at this; see its messages"),
}


class Robots(FleetStatus, Protocol):
    """Shows robots and accepts operators' commands; nothing of it waits. `deploy.station.station.Station` is one.

    Seven methods with the three of `FleetStatus`, which are all that what only shows robots needs.
    """

    @property
    def limits(self) -> Setpoint:
        """The fastest that may be requested, m/s and rad/s."""

    @property
    def trials(self) -> Sequence[TrialView]:
        """What can be done to a robot, where it is simulated."""

    def submit(self, who: str, command: Command, reply: Reply) -> None:
        """Have a command carried out; the reply may come from any thread."""

    def drive(self, who: str, drive: Drive) -> None:
        """Have a robot driven."""

    def leave(self, who: str) -> None:
        """An operator is gone."""


class SharedServices(NamedTuple):
    """What every part has; `clock_ns` is monotonic, ns."""

    robots: Robots
    audit: AuditLog
    refusals: Counter[Cause]
    limits: Limits
    clock_ns: Callable[[], int]


class RefusedRequestError(Exception):
    """A request that is refused."""

    def __init__(self, cause: Cause) -> None:
        """Refuse for a cause that `refusal` has a text for."""
        super().__init__(cause)
        self.cause = cause


def refusal(cause: Cause) -> web.Response:
    """The response to a request that is refused."""
    status, text = _STATUS[cause]
    response = json_response({"error": text}, status)
    if cause in {Cause.REQUEST_RATE, Cause.OVERSIZED, Cause.FOREIGN_HOST}:
        # What else came on this connection is not even read.
        response.force_close()
    return response


def json_response(value: object, status: int = 200) -> web.Response:
    """Some value as JSON."""
    return web.Response(body=msgspec.json.encode(value), status=status, content_type="application/json")
