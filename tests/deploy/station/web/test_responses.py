# SPDX-License-Identifier: MIT
"""What is right is answered, with what keeps other pages out."""

import asyncio
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

import pytest

from segway_ecc.deploy.station.views import RobotView
from segway_ecc.deploy.station.web.site_address import SiteAddress
from tests.deploy.station.web.attempts import OPERATOR, VIEWER
from tests.deploy.station.web.raw_requests import login, logs, raw, still_answers
from tests.deploy.station.web.scripted_station import ScriptedStation
from tests.deploy.station.web.serving import browser, served

Tried = Callable[[str, str], None]


def _zip_of(robot: str) -> IO[bytes]:
    stream = tempfile.TemporaryFile()  # noqa: SIM115 - the server's to close
    stream.write(f"zip of {robot}".encode())
    stream.flush()
    return stream


def test_what_is_right_is_answered(tmp_path: Path) -> None:
    async def scenario() -> None:
        logs(tmp_path)
        async with served(tmp_path, bundle=_zip_of) as here, browser(here) as client:
            async with client.get("/session") as answer:
                assert await answer.json() == {"login": False, "who": "operator", "role": "operator"}
                cookie = answer.headers["Set-Cookie"]
                assert "HttpOnly" in cookie
                assert "SameSite=Strict" in cookie
                assert "Secure" not in cookie
            async with client.get("/logs/a.mcap") as answer:
                assert (answer.status, await answer.read()) == (200, b"0123456789")
                assert answer.headers["Content-Disposition"] == 'attachment; filename="a.mcap"'
            async with client.get("/logs", headers={"Accept": "application/json"}) as answer:
                assert [log["name"] for log in (await answer.json())["logs"]] == ["a.mcap"]
            async with client.get("/logs") as answer:
                assert '<a href="/logs/a.mcap" download>' in await answer.text()
            here.station.robots = [RobotView(robot="/alice")]
            here.station.tick()
            async with client.get("/robots/%2Falice/bundle") as answer:
                assert (answer.content_type, await answer.read()) == ("application/zip", b"zip of /alice")
            async with client.get("/refused") as answer:
                assert await answer.json() == {"web": {}, "station": {"too large": 1}}

    asyncio.run(scenario())


def test_a_log_with_a_name_that_is_markup_is_shown_as_text(tmp_path: Path) -> None:
    async def scenario() -> None:
        (tmp_path / "logs").mkdir()
        (tmp_path / "logs" / "<script>alert(1)<").touch()
        async with served(tmp_path) as here, browser(here, "ann") as client, client.get("/logs") as answer:
            text = await answer.text()
            assert "<script" not in text
            assert "&lt;script&gt;" in text

    asyncio.run(scenario())


def test_a_defect_of_ours_ends_one_request_and_not_the_station(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(robot: str) -> IO[bytes]:
        raise ValueError(robot)

    async def scenario() -> None:
        async with served(tmp_path, bundle=broken) as here, browser(here, "ann") as client:
            here.station.robots = [RobotView(robot="/alice")]
            here.station.tick()
            async with client.get("/robots/..%2F..%2Fetc/bundle") as answer:
                assert answer.status == 404
            for _ in range(2):
                async with client.get("/robots/%2Falice/bundle") as answer:
                    assert answer.status == 500
                    assert "alice" not in await answer.text()
            assert here.refused() == {"failed": 2, "not found": 1}
            await still_answers(client)

    asyncio.run(scenario())
    assert len([record for record in caplog.records if "failed" in record.getMessage()]) == 1


def test_every_answer_carries_what_keeps_other_pages_out(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path) as here, browser(here) as client:
            for path, kind in {
                "/": "text/html; charset=utf-8",
                "/static/app.js": "text/javascript; charset=utf-8",
                "/static/style.css": "text/css; charset=utf-8",
                "/static/icon.svg": "image/svg+xml; charset=utf-8",
                "/session": "application/json",
                "/nothing": "application/json",
            }.items():
                async with client.get(path) as answer:
                    headers = answer.headers
                    policy = [part.strip() for part in headers["Content-Security-Policy"].split(";")]
                    expected = {"default-src 'self'", "connect-src 'self'", "frame-ancestors 'none'", "base-uri 'none'"}
                    assert expected <= set(policy)
                    assert headers["X-Content-Type-Options"] == "nosniff"
                    assert headers["Referrer-Policy"] == "no-referrer"
                    assert headers["Content-Type"] == kind
                    is_page = path == "/" or path.startswith("/static")
                    assert headers["Cache-Control"] == ("no-cache" if is_page else "no-store")
                    assert "Server" not in headers
                    assert "Strict-Transport-Security" not in headers, "it means nothing without TLS (RFC 6797, 7.2)"

    asyncio.run(scenario())


def test_health_returns_503_when_pictures_stall(tmp_path: Path) -> None:
    now = [0]

    class Frozen(ScriptedStation):
        def tick(self) -> None:
            """Nothing comes."""

    async def scenario() -> None:
        async with (
            served(tmp_path, station=Frozen(), clock_ns=lambda: now[0]) as here,
            browser(here) as client,
        ):
            await asyncio.sleep(0.05)
            await still_answers(client)
            now[0] = 6_000_000_000
            async with client.get("/health") as answer:
                assert answer.status == 503

    asyncio.run(scenario())


def test_a_station_for_a_network_asks_who_comes(tmp_path: Path) -> None:
    async def scenario() -> None:
        place = SiteAddress("http", 0, frozenset({"base.local"}), is_loopback=False)
        async with served(tmp_path, tokens=True, place=place) as here, browser(here) as client:
            async with client.get("/session") as answer:
                assert await answer.json() == {"login": True, "who": "", "role": ""}
                assert "Set-Cookie" not in answer.headers
            assert await login(client, here.tokens[VIEWER]) == 204
            async with client.get("/session") as answer:
                assert await answer.json() == {"login": False, "who": "ann", "role": "viewer"}
            head = f"GET /health HTTP/1.1\r\nHost: base.local:{here.port}\r\nConnection: close\r\n\r\n"
            assert (await raw(here.port, head.encode()))[0] == 200

    asyncio.run(scenario())


def test_what_was_done_stands_in_the_audit_log(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path, tokens=True) as here, browser(here, "ann", OPERATOR) as client:
            async with client.get("/robots/%2Falice/bundle"):
                pass
            async with client.post("/logout", json={}):
                pass
            entries = await here.audit()
        assert [entry["act"] for entry in entries] == ["starts", "login", "bundle", "logout"]
        assert all((entry["who"], entry["role"]) == ("ann", "operator") for entry in entries[1:])
        assert json.loads((tmp_path / "audit.jsonl").read_text().splitlines()[-1])["act"] == "ends"

    asyncio.run(scenario())
