# SPDX-License-Identifier: MIT
"""Why requests and messages are refused, and the response to a refused request."""

import enum
from typing import Final

import msgspec
from aiohttp import web


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
