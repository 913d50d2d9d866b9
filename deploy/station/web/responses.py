"""What is answered to a request that is refused."""

from typing import Final

import msgspec
from aiohttp import web

from segway_ecc.deploy.station.web.refusals import Cause

_STATUS: Final = {
    Cause.FOREIGN_HOST: (421, "the station is not known by this name; see --host"),
    Cause.FOREIGN_ORIGIN: (403, "a page of another site may not ask this of the station"),
    Cause.NO_SESSION: (401, "log in first"),
    Cause.WRONG_TOKEN: (403, "the token is not right"),
    Cause.VIEWER: (403, "a viewer may only look"),
    Cause.NOT_FOUND: (404, "there is nothing here"),
    Cause.BAD_REQUEST: (400, "this is not what is expected here"),
    Cause.OVERSIZED: (413, "this is too large"),
    Cause.REPLAYED_SOCKET: (403, "this socket was opened before"),
    Cause.LOGIN_RATE: (429, "too many attempts; wait a moment"),
    Cause.REQUEST_RATE: (429, "too many requests; wait a moment"),
    Cause.TOO_MANY_SOCKETS: (503, "too many browsers look already"),
    Cause.FAILED: (500, "the station failed at this; see its messages"),
}


class RefusedRequestError(Exception):
    """A request that is refused."""

    def __init__(self, cause: Cause) -> None:
        """Refuse for a cause that `refusal` has words for."""
        super().__init__(cause)
        self.cause = cause


def refusal(cause: Cause) -> web.Response:
    """The answer."""
    status, text = _STATUS[cause]
    answer = json_answer({"error": text}, status)
    if cause in {Cause.REQUEST_RATE, Cause.OVERSIZED, Cause.FOREIGN_HOST}:
        # What else came on this connection is not even read.
        answer.force_close()
    return answer


def json_answer(value: object, status: int = 200) -> web.Response:
    """Some value as JSON."""
    return web.Response(body=msgspec.json.encode(value), status=status, content_type="application/json")
