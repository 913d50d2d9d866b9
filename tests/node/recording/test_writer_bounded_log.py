# SPDX-License-Identifier: MIT
"""A log in files of a size, within bounds, and past a full disk."""

import os
import resource
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.codec import CYCLE, CycleCodec, RecorderSettings
from segway_ecc.node.recording.layout import CycleLayout, LogEnd, LogPart, Provenance
from segway_ecc.node.recording.log_quota import LogQuota
from segway_ecc.node.recording.salvage import Salvage
from segway_ecc.node.recording.writer import BoundedLog

PROVENANCE = Provenance({"robot.json": "{}"}, {})
KB = 1000


class Feed:
    """Hands cycles to a log as the writer does, and flushes as often as it is asked to."""

    def __init__(self, log: BoundedLog, layout: CycleLayout, record: Callable[[int], CycleRecord]) -> None:
        self._log = log
        self._codec = CycleCodec(layout)
        self._record = record
        self.cycle = 0

    def __call__(self, cycles: int, *, flush_every: int = 20) -> None:
        for _ in range(cycles):
            _, message = self._codec.messages(self._record(self.cycle))
            self._log.write(CYCLE, message)
            self.cycle += 1
            if self.cycle % flush_every == 0:
                self._log.flush()


@pytest.fixture
def messages() -> list[str]:
    return []


@pytest.fixture
def small_files() -> Iterator[Callable[[int | None], None]]:
    """Called with the size beyond which the kernel lets no file of this process grow; None for any."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size: int | None) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft if size is None else size, hard))

    yield limit
    limit(None)


def cycles(path: Path) -> list[int]:
    """The cycles in a log; their stamps are ten milliseconds apart."""
    stamps = [message.log_time for topic, message in Salvage(path).messages() if topic == "/cycle"]
    return [(stamp - 1_700_000_000_000_000_000) // 10_000_000 for stamp in stamps]


def test_a_long_run_is_in_files_that_each_stand_alone(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord], messages: list[str]
) -> None:
    path = tmp_path / "run.mcap"
    log = BoundedLog(RecorderSettings(str(path), layout, PROVENANCE, LogQuota(1000 * KB, 20 * KB)), messages.append)
    Feed(log, layout, record)(600)
    log.close()
    files = sorted(tmp_path.iterdir(), key=lambda found: (len(found.name), found.name))

    assert [found.name for found in files[:2]] == ["run.mcap", "run-0002.mcap"]
    assert len(files) > 3
    parts = []
    assert [cycle for found in files for cycle in cycles(found)] == list(range(600))
    for found in files:
        with found.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            attached = {attached.name: attached.data for attached in reader.iter_attachments()}
        assert attached.keys() - {"end.json"} == {"layout.json", "robot.json", "part.json"}
        parts.append(msgspec.json.decode(attached["part.json"], type=LogPart))
        assert ("end.json" in attached) == (found == files[-1])
    assert [part.number for part in parts] == list(range(1, len(files) + 1))
    assert len({part.run for part in parts}) == 1
    assert msgspec.json.decode(attached["end.json"], type=LogEnd) == LogEnd(parts[-1].run, len(files), 599)
    assert messages == []


def test_the_files_together_stay_within_the_bound_and_the_newest_stay(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord], messages: list[str]
) -> None:
    path = tmp_path / "run.mcap"
    bound = 100 * KB
    log = BoundedLog(RecorderSettings(str(path), layout, PROVENANCE, LogQuota(bound, 20 * KB)), messages.append)
    feed = Feed(log, layout, record)
    for _ in range(60):
        feed(20, flush_every=20)
        assert sum(found.stat().st_size for found in tmp_path.iterdir()) <= bound
    log.close()
    kept = sorted(cycle for found in tmp_path.iterdir() for cycle in cycles(found))

    assert not path.exists()
    assert kept == list(range(kept[0], 1200))
    assert kept[0] < 1100


def test_a_full_disk_costs_what_comes_while_it_is_full(
    tmp_path: Path,
    layout: CycleLayout,
    record: Callable[[int], CycleRecord],
    messages: list[str],
    small_files: Callable[[int | None], None],
) -> None:
    path = tmp_path / "run.mcap"
    log = BoundedLog(RecorderSettings(str(path), layout, PROVENANCE, LogQuota()), messages.append)
    feed = Feed(log, layout, record)
    feed(40)
    small_files(100)  # less than what a file begins with
    feed(60)
    while_full = [found.name for found in tmp_path.iterdir()]
    small_files(None)
    feed(20)  # which is lost too, and the flush at their end finds that there is room
    feed(30)
    log.close()

    assert while_full == ["run.mcap"]
    assert cycles(path) == list(range(40))
    assert cycles(tmp_path / "run-0002.mcap") == list(range(120, 150))
    assert len(messages) == 2
    assert messages[0].startswith(f"Writing the log {path} failed ([Errno 27] File too large)")
    assert messages[1] == f"the log goes on in {tmp_path / 'run-0002.mcap'}; 80 messages before it are missing"


def test_a_disk_that_stays_full_is_reported_at_the_end(
    tmp_path: Path,
    layout: CycleLayout,
    record: Callable[[int], CycleRecord],
    messages: list[str],
    small_files: Callable[[int | None], None],
) -> None:
    log = BoundedLog(RecorderSettings(str(tmp_path / "run.mcap"), layout, PROVENANCE, LogQuota()), messages.append)
    feed = Feed(log, layout, record)
    feed(20)
    small_files(100)
    feed(50)
    small_files(None)

    with pytest.raises(RecordingError, match=r"50 messages at the end of the log .*run\.mcap are missing"):
        log.close()
    assert len(messages) == 1


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount")
def test_a_small_file_system_that_fills_up_keeps_what_was_on_it(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord], messages: list[str]
) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["/bin/mount", "-t", "tmpfs", "-o", "size=256k", "none", str(disk)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("no tmpfs can be mounted here")
    try:
        log = BoundedLog(RecorderSettings(str(disk / "run.mcap"), layout, PROVENANCE, LogQuota()), messages.append)
        ballast = disk / "ballast"
        ballast.write_bytes(bytes(200 * KB))
        feed = Feed(log, layout, record)
        feed(2000)
        ballast.unlink()
        feed(200)
        log.close()
        first, second = cycles(disk / "run.mcap"), cycles(disk / "run-0002.mcap")
    finally:
        subprocess.run(["/bin/umount", str(disk)], check=True)

    # What had been flushed when it filled up is there, and everything since there was room again.
    assert first == list(range(len(first)))
    assert len(first) >= 20
    assert second == list(range(2200 - len(second), 2200))
    assert len(second) >= 160
    assert ["No space left" in text for text in messages] == [True, False]
