# SPDX-License-Identifier: MIT
"""Logs over HTTP as the page that plays them asks for them: seen by those, and only by those, who may download them."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from segway_ecc.deploy.station.views import RobotView
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.station.web.log_server import LogServer
from segway_ecc.deploy.station.web.server import Server
from segway_ecc.deploy.station.web.site_address import bind, site_address_of
from tests.deploy.station.playback.log_maker import story, write_log
from tests.deploy.station.web.scripted_station import ScriptedStation
from tests.deploy.station.web.serving import Served, browser, served
from tests.deploy.station.web.test_downloads import ScriptedArchive

OURS = "Cart-20261126T101500Z-12.mcap"
OTHERS = "arm-20261126T101500Z-13.mcap"
ROWS = "rows?from=1.0&to=1.01"


def station() -> ScriptedStation:
    return ScriptedStation([RobotView(robot="/alice", name="Cart", is_alive=True)])


async def _json(client: aiohttp.ClientSession, path: str, status: int = 200) -> Mapping[str, Any]:
    async with client.get(path) as answer:
        assert answer.status == status, await answer.text()
        assert answer.headers["Cache-Control"] == "no-store"
        found: Mapping[str, Any] = await answer.json()
        return found


def _fill(here: Served) -> None:
    for name in (OURS, OTHERS):
        write_log(here.folder / "logs" / name, story(3.0))


def test_log_is_given_as_a_whole_and_in_rows_and_looking_at_it_is_noted(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path, station=station()) as here, browser(here, "ann") as client:
            _fill(here)
            view = await _json(client, f"/logs/{OURS}/view")
            assert (view["robot"], view["cycles"], view["tilt_limit_rad"]) == ("Alice", 600, 0.8)
            rows = await _json(client, f"/logs/{OURS}/{ROWS}")
            assert (rows["cycle"], rows["begin_ns"]) == ([200, 201, 202], view["begin_ns"])
            assert (await _json(client, f"/logs/{OURS}/rows?from=0&to=9&most=10"))["per"] > 1
            noted = [entry for entry in await here.audit() if entry["act"] == "view"]
            assert [(entry["who"], entry["text"]) for entry in noted] == [("ann", OURS)]

    asyncio.run(scenario())


@pytest.mark.parametrize("path", ["view", ROWS])
def test_logs_of_other_robots_are_not_shown_and_nothing_without_a_session(tmp_path: Path, path: str) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, tokens=True, station=station()) as here,
            browser(here, "bob", Role.VIEWER) as viewer,
            browser(here) as stranger,
        ):
            _fill(here)
            await _json(viewer, f"/logs/{OURS}/{path}")
            for name in (OTHERS, "nothing.mcap", "..%2Faudit.jsonl"):
                assert await _json(viewer, f"/logs/{name}/{path}", 404) == {"error": "there is nothing here"}
            await _json(stranger, f"/logs/{OURS}/{path}", 401)
            await _json(stranger, f"/robots/%2Falice/logs/{OURS}/{path}", 401)

    asyncio.run(scenario())


def test_log_that_was_fetched_from_a_robot_is_shown(tmp_path: Path) -> None:
    (tmp_path / "fetched").mkdir()
    archive = ScriptedArchive(tmp_path / "fetched")
    write_log(archive.folder / "c.mcap", story(3.0))

    async def scenario() -> None:
        async with served(tmp_path, station=station(), archive=archive) as here, browser(here, "ann") as client:
            assert (await _json(client, "/robots/%2Falice/logs/c.mcap/view"))["cycles"] == 600
            assert (await _json(client, f"/robots/%2Falice/logs/c.mcap/{ROWS}"))["cycle"] == [200, 201, 202]
            await _json(client, "/robots/%2Falice/logs/d.mcap/view", 404)
            await _json(client, "/robots/%2Fnobody/logs/c.mcap/view", 404)

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "query",
    ["", "from=0", "from=a&to=1", "from=nan&to=1", "from=0&to=inf", "from=2&to=1", "from=-1&to=1", "from=0&to=1e9",
     "from=0&to=1&most=1", "from=0&to=1&most=4001", "from=0&to=1&most=x"],
)  # fmt: skip
def test_rows_of_no_time_are_refused(tmp_path: Path, query: str) -> None:
    async def scenario() -> None:
        async with served(tmp_path, station=station()) as here, browser(here, "ann") as client:
            _fill(here)
            await _json(client, f"/logs/{OURS}/rows?{query}", 400)

    asyncio.run(scenario())


def test_file_that_is_no_log_is_refused_with_the_reason(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path, station=station()) as here, browser(here, "ann") as client:
            (here.folder / "logs" / "notes.mcap").write_text("no log")
            error = await _json(client, "/logs/notes.mcap/view", 422)
            assert "notes.mcap is no log of a run" in error["error"]

    asyncio.run(scenario())


def test_page_of_logs_leads_to_the_page_that_plays_them(tmp_path: Path) -> None:
    (tmp_path / "fetched").mkdir()
    archive = ScriptedArchive(tmp_path / "fetched")
    archive.arrive()

    async def scenario() -> None:
        async with served(tmp_path, station=station(), archive=archive) as here, browser(here, "ann") as client:
            _fill(here)
            (here.folder / "logs" / "notes.txt").write_text("no log")
            async with client.get("/logs") as answer:
                text = await answer.text()
            assert f'<a class="play-log" href="/log#log={OURS}" aria-label="Play {OURS}">Play</a>' in text
            assert "/log#robot=%2Falice&amp;log=a%3Cb%3E.mcap" in text
            assert "Play notes.txt" not in text
            async with client.get("/log") as answer:
                assert (answer.status, answer.content_type) == (200, "text/html")
                assert answer.headers["Cache-Control"] == "no-cache"

    asyncio.run(scenario())


def test_server_that_ends_leaves_no_process_that_reads(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with served(tmp_path, station=station()) as here, browser(here, "ann") as client:
            _fill(here)
            await _json(client, f"/logs/{OURS}/view")
            server: Server = here.server
            process = server._application._log_views._reader._process
            assert process is not None
            helper = process[0]
        assert helper.poll() is not None

    asyncio.run(scenario())


def test_one_log_alone_is_served_to_this_machine(tmp_path: Path) -> None:
    path = write_log(tmp_path / "my run.mcap", story(3.0))
    write_log(tmp_path / "other.mcap", story(1.0))

    async def scenario() -> None:
        sockets = bind("127.0.0.1", 0)
        place = site_address_of(sockets, "http", [])
        runner = aiohttp.web.AppRunner(LogServer(path, place).app())
        await runner.setup()
        await aiohttp.web.SockSite(runner, sockets[0]).start()
        url = f"http://127.0.0.1:{place.port}"
        async with aiohttp.ClientSession(url) as client:
            async with client.get("/", allow_redirects=False) as answer:
                assert (answer.status, answer.headers["Location"]) == (303, "/log#log=my+run.mcap")
            assert (await _json(client, "/logs/my%20run.mcap/view"))["cycles"] == 600
            assert (await _json(client, f"/logs/my%20run.mcap/{ROWS}"))["cycle"] == [200, 201, 202]
            assert await _json(client, "/session") == {"login": False, "who": "", "role": "viewer"}
            for there in ("/logs/other.mcap/view", "/logs/..%2Fother.mcap/view", "/socket", "/robots/a/bundle"):
                await _json(client, there, 404)
            async with client.get("/log", headers={"Host": "evil.example"}) as answer:
                assert answer.status == 421
            async with client.get("/logs/my%20run.mcap/view", headers={"Sec-Fetch-Site": "cross-site"}) as answer:
                assert answer.status == 403
            async with client.get("/log") as answer:
                assert answer.headers["Content-Security-Policy"].startswith("default-src 'self'")
        await runner.cleanup()
        sockets[0].close()

    asyncio.run(scenario())
