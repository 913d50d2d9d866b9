# SPDX-License-Identifier: MIT
"""What a robot's archive answers."""

import hashlib
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.deploy.support.archive_files import PIECE_BYTES, Value, finished_bundle_of
from segway_ecc.deploy.support.file_store import FileStore
from tests.patience import PATIENCE_S

CONTENT = bytes(range(256)) * 512
NS_PER_S = 1_000_000_000


def when_done(ask: Callable[[], Value]) -> Value:
    deadline_s = time.monotonic() + PATIENCE_S
    while (answer := ask()) == "busy" and time.monotonic() < deadline_s:
        time.sleep(0.005)
    return answer


class Bench:
    def __init__(self, folder: Path) -> None:
        self.logs, self.work = folder / "logs", folder / "work"
        self.logs.mkdir()
        self.work.mkdir()
        (self.logs / "a.mcap").write_bytes(CONTENT)
        (folder / "secret").write_text("secret")
        (self.logs / "link").symlink_to(folder / "secret")
        self.now_ns = 0
        self.count = 0
        self.go_on = threading.Event()
        self.go_on.set()
        self.file_store = FileStore(self.logs, self.work, self.make, lambda: self.now_ns)

    def make(self, place: Path) -> Path:
        assert self.go_on.wait(PATIENCE_S)
        self.count += 1
        path = place / f"{self.count}.zip"
        path.write_bytes(b"zip %d" % self.count)
        return path

    def ask(self, name: str) -> Value:
        return when_done(lambda: self.file_store.answer(name))

    def bundle(self) -> Value:
        self.file_store.answer("bundle/make")
        return self.ask("bundle")


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_logs_are_listed(bench: Bench) -> None:
    answer = bench.ask("logs")
    assert isinstance(answer, list)
    assert [line.split()[:2] for line in answer] == [["a.mcap", str(len(CONTENT))]]


def test_a_log_comes_in_pieces_to_its_end(bench: Bench) -> None:
    found = b""
    while piece := bench.ask(f"log/a.mcap/{len(found)}"):
        assert isinstance(piece, bytes)
        assert len(piece) <= PIECE_BYTES
        found += piece
    assert found == CONTENT
    assert bench.ask(f"log/a.mcap/{2**62}") == b""


@pytest.mark.parametrize(
    "name",
    ["log/link/0", "log/../secret/0", "log/gone/0", "bundle/a.mcap/0", "sha256/link/1", "x", "", "bundle/../x/0"],
)
def test_what_is_no_log_is_not_set(bench: Bench, name: str) -> None:
    assert bench.ask(name) is None


def test_the_beginning_of_a_log_that_grows_is_hashed(bench: Bench) -> None:
    size = len(CONTENT)
    with (bench.logs / "a.mcap").open("ab") as stream:
        stream.write(b"more")
    assert bench.ask(f"sha256/a.mcap/{size}") == hashlib.sha256(CONTENT).hexdigest()
    assert bench.ask(f"sha256/a.mcap/{size + 4}") == hashlib.sha256(CONTENT + b"more").hexdigest()
    assert bench.ask(f"sha256/a.mcap/{size + 5}") is None


def test_a_bundle_is_made_when_it_is_asked_for_and_comes_in_pieces(bench: Bench) -> None:
    assert bench.ask("bundle") == "none"
    answer = bench.bundle()
    assert isinstance(answer, str)
    made = finished_bundle_of(answer)
    assert made is not None
    assert (made.name, made.size, made.sha256) == ("1.zip", 5, hashlib.sha256(b"zip 1").hexdigest())
    assert bench.ask("bundle/1.zip/0") == b"zip 1"
    assert bench.ask("bundle/1.zip/3") == b" 1"
    assert bench.ask("log/1.zip/0") is None
    (bench.work / "other").write_bytes(b"nothing for others")
    assert bench.ask("bundle/other/0") is None


def test_one_bundle_is_made_for_all_who_ask_within_half_a_minute_and_one_is_kept(bench: Bench) -> None:
    first = bench.bundle()
    assert bench.bundle() == first
    bench.now_ns += 31 * NS_PER_S
    assert str(bench.bundle()).startswith("2.zip ")
    assert bench.ask("bundle/1.zip/0") is None
    assert [path.name for path in bench.work.iterdir()] == ["2.zip"]


def test_while_a_bundle_is_made_pieces_are_still_handed_out(bench: Bench) -> None:
    bench.go_on.clear()
    assert bench.file_store.answer("bundle/make") == "busy"
    assert bench.file_store.answer("bundle") == "busy"
    assert bench.file_store.answer("log/a.mcap/0") == CONTENT[:PIECE_BYTES]
    assert bench.file_store.answer("sha256/a.mcap/1") == "busy"
    bench.go_on.set()
    assert str(bench.ask("bundle")).startswith("1.zip ")
    assert bench.ask("sha256/a.mcap/1") == hashlib.sha256(CONTENT[:1]).hexdigest()
    assert bench.count == 1


def test_a_bundle_asked_for_while_a_log_is_hashed_is_made_afterwards(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    hash_it = hashlib.sha256

    def slow(*words: bytes) -> object:
        assert bench.go_on.wait(PATIENCE_S)
        return hash_it(*words)

    bench.go_on.clear()
    monkeypatch.setattr("segway_ecc.deploy.support.file_store.hashlib.sha256", slow)
    assert bench.file_store.answer("sha256/a.mcap/1") == "busy"
    assert bench.file_store.answer("bundle/make") == "busy"
    bench.go_on.set()
    assert str(bench.ask("bundle")).startswith("1.zip ")


def test_failed_bundle_reports_the_reason_and_can_be_retried(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", lambda _path, _bytes: (_ for _ in ()).throw(OSError(28, "no room")))
        assert bench.bundle() == "failed: no room"
    assert str(bench.bundle()).startswith("2.zip ")


def test_only_the_logs_of_its_own_robot_are_handed_out(bench: Bench) -> None:
    mine, theirs = "cart-20261126T101500Z-12.mcap", "arm-20261126T101500Z-13.mcap"
    for name in (mine, theirs):
        (bench.logs / name).write_bytes(b"0")
    bench.file_store = FileStore(bench.logs, bench.work, bench.make, lambda: bench.now_ns, robots=("cart",))
    answer = bench.ask("logs")
    assert isinstance(answer, list)
    assert {line.split()[0] for line in answer} == {mine, "a.mcap"}
    assert bench.ask(f"log/{mine}/0") == b"0"
    assert bench.ask(f"log/{theirs}/0") is None
    assert bench.ask(f"sha256/{theirs}/1") is None
