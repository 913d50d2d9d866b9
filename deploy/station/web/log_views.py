# SPDX-License-Identifier: MIT
"""Logs as the page that plays them asks for them: as a whole, and in rows."""

import asyncio
import math
from collections.abc import Callable
from typing import Final, TypeAlias

from aiohttp import web

from segway_ecc.deploy.station.playback.log_reader import LogReader, LogReadingError
from segway_ecc.deploy.station.playback.reading_process import ReadRequest
from segway_ecc.deploy.station.playback.recorded_log import MOST_ROWS
from segway_ecc.deploy.station.web.shared import Cause, RefusedRequestError, json_response

OpenFile: TypeAlias = Callable[[web.Request], int]
"""Opens the log that a request names, and returns its descriptor.

It raises FileNotFoundError where there is none that may be seen, and RefusedRequestError.
"""
_LATEST_S: Final = 1e7
_BUSY: Final = 503
_NO_LOG: Final = 422


class LogViews:
    """Answers requests about logs; which may be seen is decided by who opens them."""

    def __init__(self, open_file: OpenFile) -> None:
        """Begin no process before the first request."""
        self._open_file = open_file
        self._reader = LogReader()

    async def whole(self, request: web.Request) -> web.Response:
        """A log as a whole."""
        return await self._read(request, None)

    async def rows(self, request: web.Request) -> web.Response:
        """Some rows of it: `from` and `to`, s, and `most`."""
        return await self._read(request, wanted_rows(request))

    def close(self) -> None:
        """End the process that reads."""
        self._reader.close()

    async def _read(self, request: web.Request, rows: tuple[float, float, int] | None) -> web.Response:
        try:
            file = await asyncio.to_thread(self._open_file, request)
        except FileNotFoundError:
            raise RefusedRequestError(Cause.NOT_FOUND) from None
        try:
            content = await self._reader.read(file, ReadRequest(name=request.match_info["name"], rows=rows))
        except LogReadingError as error:
            return json_response({"error": str(error)}, _BUSY if error.is_busy else _NO_LOG)
        response = web.Response(body=content, content_type="application/json")
        response.enable_compression()
        return response


def wanted_rows(request: web.Request) -> tuple[float, float, int]:
    """From when to when, s, and how many rows at most.

    Raises:
        RefusedRequestError: They are no such numbers.
    """
    query = request.query
    try:
        from_s, to_s, most = float(query["from"]), float(query["to"]), int(query.get("most", MOST_ROWS))
    except (KeyError, ValueError):
        raise RefusedRequestError(Cause.BAD_REQUEST) from None
    if not (math.isfinite(from_s) and 0.0 <= from_s <= to_s <= _LATEST_S and 1 < most <= MOST_ROWS):
        raise RefusedRequestError(Cause.BAD_REQUEST)
    return from_s, to_s, most
