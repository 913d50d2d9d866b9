# SPDX-License-Identifier: MIT
"""Requests that do not belong: each is refused and counted, and the station goes on."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from yarl import URL

from tests.deploy.station.web.attempts import ATTEMPTS, Attempt
from tests.deploy.station.web.raw_requests import logs, raw, still_answers
from tests.deploy.station.web.serving import Served, browser, served

Tried = Callable[[str, str], None]


@pytest.mark.parametrize("attempt", ATTEMPTS, ids=lambda attempt: attempt.what)
def test_attempt_is_refused_and_counted(attempt: Attempt, tmp_path: Path, tried: Tried) -> None:
    async def scenario() -> None:
        logs(tmp_path)
        async with (
            served(tmp_path, tokens=True) as here,
            browser(here, "ann" if attempt.role else "", attempt.role) as client,
        ):
            before = here.refused()
            status, body = await _ask(here, client, attempt)
            assert status == attempt.status, body
            assert "secret" not in body
            counts = here.refused()
            assert counts.get(attempt.cause, 0) == before.get(attempt.cause, 0) + 1
            assert sum(counts.values()) == sum(before.values()) + 1
            await still_answers(client)
        tried(attempt.what, f"refused with {attempt.status}, counted as {attempt.cause}")

    asyncio.run(scenario())


async def _ask(here: Served, client: Any, attempt: Attempt) -> tuple[int, str]:
    """Send it as it stands, which a client library would not; with the cookie of who is logged in."""
    cookies = client.cookie_jar.filter_cookies(URL(here.url))
    headers = {"Host": f"127.0.0.1:{here.port}", "Origin": here.url}
    if cookies:
        headers["Cookie"] = "; ".join(f"{name}={morsel.value}" for name, morsel in cookies.items())
    if "Sec-Fetch-Site" in attempt.headers:
        del headers["Origin"]  # as browsers do for an image
    headers |= {name: text.replace("S=", f"station_{here.port}=") for name, text in attempt.headers.items()}
    if headers["Host"] == "evil.example":
        headers["Host"] += f":{here.port}"
    headers = {name: text for name, text in headers.items() if text}
    body = (attempt.body or "").encode()
    headers |= {"Connection": headers.get("Connection", "close"), "Content-Length": str(len(body))}
    head = "".join(f"{name}: {text}\r\n" for name, text in headers.items())
    return await raw(here.port, f"{attempt.method} {attempt.path} HTTP/1.1\r\n{head}\r\n".encode() + body)
