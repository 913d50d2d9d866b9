# SPDX-License-Identifier: MIT
"""Fetching from robots, against an archive as a robot has it, without ROS between them."""

import contextlib
import hashlib
import os
import threading
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from segway_ecc.deploy.station.archive_client import ArchiveClient, Progress
from segway_ecc.deploy.station.station_bundle import StationBundle
from segway_ecc.deploy.station.views import EventView, FleetView, RobotView
from segway_ecc.deploy.support.archive_files import PIECE_BYTES, Value
from segway_ecc.deploy.support.archive_service import ArchiveCalls
from segway_ecc.deploy.support.file_store import FileStore
from segway_ecc.node.errors import NobodyListensError
from tests.patience import PATIENCE_S

CONTENT = hashlib.shake_128(b"log").digest(5 * PIECE_BYTES + 100)


class Robot(ArchiveCalls):
    """Archives of robots; `answer` can be put in front of what they say."""

    def __init__(self, folder: Path) -> None:
        self.logs = folder / "logs"
        self.logs.mkdir()
        (folder / "work").mkdir()
        (self.logs / "a.mcap").write_bytes(CONTENT)
        self.file_store = FileStore(self.logs, folder / "work", self._make)
        self.asked: list[str] = []
        self.answer: Callable[[str], Value] = self.file_store.answer
        self.is_closed = False

    def ask(self, robot: str, name: str) -> Value:
        assert robot == "/alice"
        self.asked.append(name)
        return self.answer(name)

    def close(self) -> None:
        self.is_closed = True

    @staticmethod
    def _make(place: Path) -> Path:
        path = place / "robot.zip"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("hello", "from the robot")
        return path


class Bench:
    def __init__(self, folder: Path) -> None:
        (folder / "robot").mkdir()
        self.robot = Robot(folder / "robot")
        self.folder = folder / "fetched"
        self.client = ArchiveClient(self.robot, self.folder, most_bytes=2 * len(CONTENT), free_bytes=lambda _: 2**40)
        self.place = self.folder / "%2Falice"

    def fetch(self, name: str = "a.mcap") -> Progress:
        self.client.begin("/alice", name)
        deadline_s = time.monotonic() + PATIENCE_S
        while (progress := self.client.progress("/alice")[name]).is_going_on and time.monotonic() < deadline_s:
            time.sleep(0.005)
        return progress

    def pieces(self) -> list[int]:
        return [int(name.rpartition("/")[2]) for name in self.robot.asked if name.startswith("log/")]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr("segway_ecc.deploy.station.archive_client._RETRY_S", 0.001)
    monkeypatch.setattr("segway_ecc.deploy.station.archive_client._POLL_S", 0.001)
    return Bench(tmp_path)


def test_a_log_is_fetched_whole_with_its_time_and_can_be_opened(bench: Bench) -> None:
    (log,) = bench.client.logs("/alice")
    assert bench.fetch() == Progress("done", len(CONTENT), len(CONTENT))
    file, size = bench.client.open("/alice", "a.mcap")
    with os.fdopen(file, "rb") as stream:
        assert (stream.read(), size) == (CONTENT, len(CONTENT))
    assert (bench.place / "a.mcap").stat().st_mtime_ns == log.changed_ns
    assert [path.name for path in bench.place.iterdir()] == ["a.mcap"]
    assert bench.pieces() == [n * PIECE_BYTES for n in range(6)]


def test_an_answer_that_is_lost_is_asked_for_again(bench: Bench) -> None:
    lost: list[str] = []

    def lossy(name: str) -> Value:
        if name.startswith(("log/", "sha256/")) and lost.count(name) < 2:
            lost.append(name)
            raise NobodyListensError("no answer")
        return bench.robot.file_store.answer(name)

    bench.robot.answer = lossy
    assert bench.fetch().state == "done"
    assert (bench.place / "a.mcap").read_bytes() == CONTENT


def test_a_fetch_that_broke_off_goes_on_where_it_was(bench: Bench) -> None:
    def breaks(name: str) -> Value:
        if name == f"log/a.mcap/{3 * PIECE_BYTES}":
            raise NobodyListensError("the archive of robot /alice gave no answer")
        return bench.robot.file_store.answer(name)

    bench.robot.answer = breaks
    assert bench.fetch() == Progress(
        "failed", 3 * PIECE_BYTES, len(CONTENT), "the archive of robot /alice gave no answer"
    )
    with pytest.raises(FileNotFoundError):
        bench.client.open("/alice", "a.mcap")
    bench.robot.answer = bench.robot.file_store.answer
    bench.robot.asked.clear()
    assert bench.fetch().state == "done"
    assert bench.pieces() == [n * PIECE_BYTES for n in (3, 4, 5)]
    assert (bench.place / "a.mcap").read_bytes() == CONTENT


def test_what_was_begun_with_another_log_of_that_name_is_begun_anew(bench: Bench) -> None:
    bench.place.mkdir(parents=True)
    (bench.place / ".a.mcap.part").write_bytes(bytes(2 * PIECE_BYTES))
    assert bench.fetch().state == "done"
    assert (bench.place / "a.mcap").read_bytes() == CONTENT
    (bench.place / ".a.mcap.part").write_bytes(bytes(len(CONTENT) + 1))
    assert bench.fetch().state == "done"


def test_a_log_that_comes_damaged_again_and_again_is_not_kept(bench: Bench) -> None:
    def damages(name: str) -> Value:
        answer = bench.robot.file_store.answer(name)
        return b"x" + answer[1:] if name == "log/a.mcap/0" and isinstance(answer, bytes) else answer

    bench.robot.answer = damages
    progress = bench.fetch()
    assert (progress.state, progress.why) == ("failed", "a.mcap is not what the robot has, twice; try again")
    assert list(bench.place.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "answer", "why"),
    [
        ("log/a.mcap/0", b"", "the robot has no more of a.mcap at byte 0: it was deleted or shortened"),
        ("log/a.mcap/0", None, "the robot has no more of a.mcap at byte 0: it was deleted or shortened"),
        ("log/a.mcap/0", "text", "the robot has no more of a.mcap at byte 0: it was deleted or shortened"),
        (f"sha256/a.mcap/{len(CONTENT)}", None, "the robot has no SHA-256 of a.mcap: it is gone"),
        (f"sha256/a.mcap/{len(CONTENT)}", "failed: x", "the robot has no SHA-256 of a.mcap: failed: x"),
        ("logs", ["b 1 1"], "the robot has no log a.mcap any more"),
        ("logs", "text", "the archive of robot /alice returns no list of logs"),
        ("logs", [f"a.mcap {2**40} 1"], "a.mcap has 1099511627776 bytes, more than the"),
    ],
)
def test_invalid_archive_answer_fails_fetch_with_reason(bench: Bench, name: str, answer: Value, why: str) -> None:
    bench.robot.answer = lambda asked: answer if asked == name else bench.robot.file_store.answer(asked)
    progress = bench.fetch()
    assert progress.state == "failed"
    assert progress.why.startswith(why.partition(";")[0])


def test_more_than_was_listed_is_not_kept(bench: Bench) -> None:
    bench.robot.answer = lambda name: ["a.mcap 10 5"] if name == "logs" else bench.robot.file_store.answer(name)
    assert bench.fetch() == Progress("done", 10, 10)
    assert (bench.place / "a.mcap").read_bytes() == CONTENT[:10]


def test_the_oldest_logs_give_way_and_a_full_disk_takes_none(bench: Bench) -> None:
    for age, name in enumerate(("b", "c", "d")):
        (bench.robot.logs / name).write_bytes(CONTENT)
        os.utime(bench.robot.logs / name, ns=(0, 10**18 + age))
        assert bench.fetch(name).state == "done"
    assert sorted(path.name for path in bench.place.iterdir()) == ["c", "d"]
    client = ArchiveClient(bench.robot, bench.folder, free_bytes=lambda _: 256 * 1024**2)
    bench.client = client
    assert "the station's disk has no room for a.mcap" in bench.fetch().why


def test_too_many_fetches_at_once_are_refused_and_the_end_ends_them(bench: Bench) -> None:
    bench.robot.answer = lambda name: (
        [f"{n} 1 1" for n in range(40)] if name == "logs" else "busy" if name.startswith("sha") else b"x"
    )
    for number in range(16):
        bench.client.begin("/alice", str(number))
    bench.client.begin("/alice", "0")  # again: the same
    with pytest.raises(NobodyListensError, match="16 logs are being fetched already"):
        bench.client.begin("/alice", "17")
    bench.client.close()
    assert bench.robot.is_closed
    assert bench.client.progress("/alice")["0"].why == "the station ends"
    with pytest.raises(NobodyListensError):
        bench.client.begin("/alice", "18")


class _Station:
    def fleet(self) -> FleetView:
        return FleetView(time_s=1.0, robots=[RobotView(robot="/alice", mode="ARMED"), RobotView(robot="/bob")])

    def events(self, after: int) -> list[EventView]:
        robots = ("/alice", "/bob", "")
        return [
            EventView(number=n, wall_ns=0, robot=robot, text=f"of {robot}") for n, robot in enumerate(robots, after)
        ]

    def refused(self) -> Mapping[str, int]:
        return {}


@contextlib.contextmanager
def _bundle(bench: Bench, folder: Path) -> Iterator[zipfile.ZipFile]:
    folder.mkdir()
    (folder / "audit.jsonl").write_text('{"who": "ann"}\n')
    (folder / "access.json").write_text("hashes")
    make = StationBundle(_Station(), bench.client.bundle, folder, folder / "logs", lambda: 0)
    with make("/alice") as stream, zipfile.ZipFile(stream) as archive:
        yield archive


def test_a_stations_bundle_has_the_robots_and_what_the_station_knows_of_it(bench: Bench, tmp_path: Path) -> None:
    with _bundle(bench, tmp_path / "station") as archive:
        names = archive.namelist()
        with archive.open("robot-support.zip") as own, zipfile.ZipFile(own) as inner:
            assert inner.read("hello") == b"from the robot"
        assert b'"/alice"' in archive.read("robots.json")
        assert b"/bob" not in archive.read("robots.json")
        assert archive.read("events.jsonl").count(b"\n") == 2
        assert b"of /bob" not in archive.read("events.jsonl")
        assert archive.read("audit/audit.jsonl") == b'{"who": "ann"}\n'
    assert "versions.json" in names
    assert not any("access" in name for name in names)
    # Nothing is left behind.
    assert sorted(path.name for path in (tmp_path / "station").iterdir()) == ["access.json", "audit.jsonl"]
    assert list(bench.folder.iterdir()) == []


def test_missing_robot_bundle_is_noted_in_station_bundle(bench: Bench, tmp_path: Path) -> None:
    def absent(_name: str) -> Value:
        raise NobodyListensError("robot /alice hands out nothing")

    bench.robot.answer = absent
    with _bundle(bench, tmp_path / "station") as archive:
        assert "robot-support.zip" not in archive.namelist()
        assert b"robot /alice hands out nothing" in archive.read("MANIFEST.json")
        assert b"ann" in archive.read("audit/audit.jsonl")


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ("failed: no room", "the robot made no bundle: no room"),
        (f"b.zip {2**60} {'0' * 64}", "the robot's bundle has"),
        (f"robot.zip 5 {'0' * 64}", "the robot's bundle came damaged; try again"),
        (None, "the robot made no bundle: it gives no reason"),
        (f"../b {5} {'0' * 64}", "the robot made no bundle"),
    ],
)
def test_failed_bundle_raises_and_leaves_no_file(bench: Bench, answer: Value, why: str) -> None:
    bench.robot.answer = lambda name: answer if name in {"bundle", "bundle/make"} else b"12345"
    with pytest.raises(NobodyListensError, match=why):
        bench.client.bundle("/alice")
    assert list(bench.folder.iterdir()) == []


def test_the_end_ends_a_bundle_that_is_waited_for(bench: Bench) -> None:
    asked = threading.Event()

    def never(_name: str) -> Value:
        asked.set()
        return "busy"

    bench.robot.answer = never

    def end() -> None:
        asked.wait(PATIENCE_S)
        bench.client.close()

    ending = threading.Thread(target=end)
    ending.start()
    with pytest.raises(NobodyListensError, match="the station ends"):
        bench.client.bundle("/alice")
    ending.join()
    bench.client.close()


def test_bundles_of_a_station_that_was_killed_are_removed(bench: Bench) -> None:
    bench.folder.mkdir(exist_ok=True)
    (bench.folder / ".support-1.zip.part").write_bytes(b"half")
    (bench.folder / "%2Falice").mkdir()
    (bench.folder / "%2Falice" / ".a.mcap.part").write_bytes(b"half")
    ArchiveClient(bench.robot, bench.folder)
    assert [path.name for path in bench.folder.rglob("*.part")] == [".a.mcap.part"]
