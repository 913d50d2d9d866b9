# SPDX-License-Identifier: MIT
"""Logs of robots and support bundles, over HTTP."""

import asyncio
import hashlib
import os
import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import pytest
from yarl import URL

from segway_ecc.deploy.station.archive_client import ArchiveClient, Progress
from segway_ecc.deploy.station.views import RobotView
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.deploy.support.archive_files import LogFile, open_log
from segway_ecc.node.errors import NobodyListensError
from tests.deploy.station.web.scripted_station import ScriptedStation
from tests.deploy.station.web.serving import Served, browser, served
from tests.open_files import open_files

JSON = {"Accept": "application/json"}
WHAT_TO_START = "robot /bob hands out nothing; on the robot, start: segway-ecc log archive ROBOT --namespace /bob"
CHANGED_NS = 1_790_000_000_123_456_789


class ScriptedArchive(ArchiveClient):
    """`/alice` has two logs; `/bob` hands out none."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.listed = 0
        self.begun: list[tuple[str, str]] = []
        self.states: dict[str, Progress] = {}
        self.refusal = ""
        self.is_closed = False

    def logs(self, robot: str) -> Sequence[LogFile]:
        self.listed += 1
        if robot != "/alice":
            raise NobodyListensError(WHAT_TO_START)
        return [LogFile("a<b>.mcap", 10, CHANGED_NS), LogFile("c.mcap", 2**62, 2**62)]

    def begin(self, robot: str, name: str) -> None:
        if self.refusal:
            raise NobodyListensError(self.refusal)
        self.begun.append((robot, name))
        self.states[name] = Progress("fetching", 3, 10)

    def progress(self, robot: str) -> Mapping[str, Progress]:
        return self.states if robot == "/alice" else {}

    def open(self, robot: str, name: str) -> tuple[int, int]:
        assert robot in {"/alice", "/bob"}
        return open_log(self.folder, name)

    def close(self) -> None:
        self.is_closed = True

    def arrive(self) -> None:
        """The first log is here."""
        (self.folder / "a<b>.mcap").write_bytes(b"0123456789")
        os.utime(self.folder / "a<b>.mcap", ns=(CHANGED_NS, CHANGED_NS))
        self.states = {"a<b>.mcap": Progress("done", 10, 10)}


@pytest.fixture
def archive(tmp_path: Path) -> ScriptedArchive:
    (tmp_path / "fetched").mkdir()
    return ScriptedArchive(tmp_path / "fetched")


def alice_and_others() -> ScriptedStation:
    robots = [
        RobotView(robot="/alice", is_alive=True),
        RobotView(robot="/bob", is_alive=True),
        RobotView(robot="/carl"),
    ]
    return ScriptedStation(robots)


async def _json(client: Any, path: str) -> Any:
    async with client.get(path, headers=JSON) as answer:
        return await answer.json()


async def _page(client: Any, path: str) -> str:
    async with client.get(path) as answer:
        return str(await answer.text())


def test_the_page_of_logs_shows_the_stations_and_those_of_each_living_robot(
    tmp_path: Path, archive: ScriptedArchive
) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            (here.folder / "logs" / "own.mcap").write_bytes(b"own")
            text = await _page(client, "/logs")
            assert '<a href="/logs/own.mcap" download>own.mcap</a>' in text
            assert "a&lt;b&gt;.mcap" in text
            assert '<form method="post" action="/robots/%2Falice/logs/a%3Cb%3E.mcap">' in text
            assert WHAT_TO_START in text
            assert "/carl" not in text
            assert "refresh" not in text
            answer = await _json(client, "/logs")
            assert [log["name"] for log in answer["logs"]] == ["own.mcap"]
            assert [robot["robot"] for robot in answer["robots"]] == ["/alice", "/bob"]
            assert answer["robots"][0]["logs"][0] == {
                "name": "a<b>.mcap",
                "size": 10,
                "changed_ns": CHANGED_NS,
                "state": "on the robot",
                "fetched": 0,
                "why": "",
            }

    asyncio.run(scenario())


def test_of_the_stations_logs_those_of_other_robots_are_not_offered(tmp_path: Path, archive: ScriptedArchive) -> None:
    ours, others = "Cart-20261126T101500Z-12.mcap", "arm-20261126T101500Z-13.mcap"
    robots = [RobotView(robot="/alice", name="Cart")]

    async def scenario() -> None:
        async with (
            served(tmp_path, station=ScriptedStation(robots), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            for name in (ours, others):
                (here.folder / "logs" / name).write_bytes(b"own")
            assert [log["name"] for log in (await _json(client, "/logs"))["logs"]] == [ours]
            assert others not in await _page(client, "/logs")
            for name, status in ((ours, 200), (others, 404)):
                async with client.get(f"/logs/{name}") as answer:
                    assert answer.status == status

    asyncio.run(scenario())


def test_a_log_is_fetched_then_downloaded(tmp_path: Path, archive: ScriptedArchive) -> None:
    path = "/robots/%2Falice/logs/a%3Cb%3E.mcap"

    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            async with client.get(path) as answer:
                assert answer.status == 404
                assert "fetch it first" in (await answer.json())["error"]
            async with client.post(path, allow_redirects=False) as answer:
                assert (answer.status, answer.headers["Location"]) == (303, "/robots/%2Falice/logs")
            assert archive.begun == [("/alice", "a<b>.mcap")]
            text = await _page(client, "/robots/%2Falice/logs")
            assert '<progress aria-label="a&lt;b&gt;.mcap" value="3" max="10"></progress> 30 %' in text
            assert '<meta http-equiv="refresh"' in text
            archive.arrive()
            text = await _page(client, "/robots/%2Falice/logs")
            assert f'<a href="{path}" download>' in text
            assert "refresh" not in text
            assert (await _json(client, "/robots/%2Falice/logs"))["logs"][0]["state"] == "done"
            async with client.get(path) as answer:
                assert (answer.status, await answer.read()) == (200, b"0123456789")
                assert answer.headers["Content-Disposition"] == 'attachment; filename="alice-a_b_.mcap"'
            acts = [(entry["act"], entry["robot"]) for entry in await here.audit() if entry["act"] in {"fetch", "log"}]
            assert acts == [("log", "/alice"), ("fetch", "/alice"), ("log", "/alice")]

    asyncio.run(scenario())


def test_failed_fetch_shows_reason_and_can_be_retried(tmp_path: Path, archive: ScriptedArchive) -> None:
    archive.states = {"a<b>.mcap": Progress("failed", 3, 10, "it <broke>")}

    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            text = await _page(client, "/robots/%2Falice/logs")
            assert "it &lt;broke&gt; <form" in text
            assert "Try again" in text
            archive.refusal = "16 logs are being fetched already"
            async with client.post("/robots/%2Falice/logs/c.mcap") as answer:
                assert (answer.status, await answer.json()) == (503, {"error": archive.refusal})

    asyncio.run(scenario())


def test_robot_without_archive_shows_command_to_start(tmp_path: Path, archive: ScriptedArchive) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            async with client.get("/robots/%2Fbob/logs", headers=JSON) as answer:
                assert (answer.status, (await answer.json())["error"]) == (503, WHAT_TO_START)
            async with client.post("/robots/%2Fbob/logs/a", headers=JSON) as answer:
                assert (answer.status, await answer.json()) == (503, {"error": WHAT_TO_START})

    asyncio.run(scenario())


def test_robots_are_asked_once_however_many_look(tmp_path: Path, archive: ScriptedArchive) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            await asyncio.gather(*(_page(client, "/logs") for _ in range(10)))
            assert archive.listed == 2
        assert archive.is_closed

    asyncio.run(scenario())


def test_a_viewer_sees_and_fetches_nothing(tmp_path: Path, archive: ScriptedArchive) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, tokens=True, station=alice_and_others(), archive=archive) as here,
            browser(here, "bob", Role.VIEWER) as client,
            browser(here) as stranger,
        ):
            text = await _page(client, "/logs")
            assert "a&lt;b&gt;.mcap" in text
            assert "<form" not in text
            async with client.post("/robots/%2Falice/logs/c.mcap") as answer:
                assert answer.status == 403
            for path in ("/robots/%2Falice/logs", "/robots/%2Falice/logs/c.mcap"):
                async with stranger.get(path) as answer:
                    assert answer.status == 401
            async with stranger.post("/robots/%2Falice/logs/c.mcap") as answer:
                assert answer.status == 401
            assert archive.begun == []

    asyncio.run(scenario())


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/robots/%2Fnobody/logs"),
        ("GET", "/robots/..%2F..%2Fetc/logs"),
        ("GET", "/robots/%2Fnobody/logs/a"),
        ("POST", "/robots/%2Fnobody/logs/a"),
        ("POST", "/robots/%2Falice/logs/d.mcap"),
        ("POST", "/robots/%2Falice/logs/..%2Fc.mcap"),
        ("GET", "/robots/%2Falice/logs/..%2Fsecret"),
        ("GET", "/robots/%2Falice/logs/link"),
        ("GET", "/robots/%2Falice/logs/.a.part"),
        ("GET", "/robots/%2Falice/logs/a%00"),
    ],
)
def test_what_is_not_there_is_not_found(tmp_path: Path, archive: ScriptedArchive, method: str, path: str) -> None:
    (tmp_path / "secret").write_text("secret")
    (archive.folder / "link").symlink_to(tmp_path / "secret")
    (archive.folder / ".a.part").write_text("half")

    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            async with client.request(method, _raw(here, path), allow_redirects=False) as answer:
                assert answer.status == 404
                assert "secret" not in (await answer.text()).replace("%2Fsecret", "")
            assert archive.begun == []

    asyncio.run(scenario())


def _raw(here: Served, path: str) -> Any:

    return URL(here.url + path, encoded=True)


def test_foreign_form_is_refused_and_own_form_with_referrer_passes(tmp_path: Path, archive: ScriptedArchive) -> None:
    async def scenario() -> None:
        async with (
            served(tmp_path, station=alice_and_others(), archive=archive) as here,
            browser(here, "ann") as client,
        ):
            for origin in ("null", "http://evil.example"):
                async with client.post("/robots/%2Falice/logs/c.mcap", headers={"Origin": origin}) as answer:
                    assert answer.status == 403
            assert archive.begun == []
            for path, policy in {
                "/logs": "same-origin",
                "/robots/%2Falice/logs": "same-origin",
                "/": "no-referrer",
            }.items():
                async with client.get(path) as answer:
                    assert answer.headers["Referrer-Policy"] == policy

    asyncio.run(scenario())


def test_a_large_bundle_is_streamed_from_its_file_and_leaves_nothing_open(tmp_path: Path) -> None:
    content = hashlib.shake_128(b"zip").digest(5_000_000)
    made: list[IO[bytes]] = []

    def make(robot: str) -> IO[bytes]:
        assert threading.current_thread() is not threading.main_thread()
        assert robot == "/alice"
        stream = tempfile.TemporaryFile(dir=tmp_path)  # noqa: SIM115 - the server's to close
        stream.write(content)
        made.append(stream)
        return stream

    async def scenario() -> None:
        async with served(tmp_path, station=alice_and_others(), bundle=make) as here, browser(here, "ann") as client:
            async with client.get("/robots/%2Falice/bundle") as answer:
                assert answer.content_length == len(content)
                assert answer.headers["Content-Disposition"] == 'attachment; filename="alice-support.zip"'
                assert await answer.read() == content
            assert made[0].closed
            assert not [link for link in open_files() if str(tmp_path) in link and "deleted" in link]

    asyncio.run(scenario())
