# SPDX-License-Identifier: MIT
"""Logs are read by a process of their own, whose end costs one answer and nothing else."""

import asyncio
import os
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
import pytest

from segway_ecc.deploy.station.playback import log_reader
from segway_ecc.deploy.station.playback.log_reader import LogReader, LogReadingError
from segway_ecc.deploy.station.playback.reading_process import OpenLogs, ReadRequest
from segway_ecc.deploy.station.playback.views import LogRowsView, LogView
from tests.deploy.station.playback.log_maker import record, story, write_log
from tests.open_files import open_files


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path / "run.mcap", story(3.0))


def run(scenario: Callable[[LogReader], Awaitable[None]]) -> None:
    async def with_reader() -> None:
        reader = LogReader()
        try:
            await scenario(reader)
        finally:
            reader.close()

    before = open_files()
    asyncio.run(with_reader())
    assert open_files() == before


def ask(reader: LogReader, path: Path, rows: tuple[float, float, int] | None = None) -> Awaitable[bytes]:
    return reader.read(os.open(path, os.O_RDONLY), ReadRequest(name=path.name, rows=rows))


def test_log_is_read_as_a_whole_and_in_rows(log: Path) -> None:
    async def scenario(reader: LogReader) -> None:
        view = msgspec.json.decode(await ask(reader, log), type=LogView)
        assert (view.robot, view.cycles) == ("Alice", 600)
        rows = msgspec.json.decode(await ask(reader, log, (1.0, 1.01, 100)), type=LogRowsView)
        assert rows.cycle == [200, 201, 202]

    run(scenario)


def test_file_that_is_no_log_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "notes.mcap").write_text("no log")

    async def scenario(reader: LogReader) -> None:
        with pytest.raises(LogReadingError, match=r"notes\.mcap is no log of a run") as refused:
            await ask(reader, tmp_path / "notes.mcap")
        assert not refused.value.is_busy

    run(scenario)


def test_log_that_is_cut_short_while_it_is_read_ends_no_more_than_one_answer(log: Path, tmp_path: Path) -> None:
    other = write_log(tmp_path / "other.mcap", story(2.0))
    size = log.stat().st_size

    async def scenario(reader: LogReader) -> None:
        await ask(reader, log)
        os.truncate(log, 100)
        os.truncate(log, size)  # as long as before, and zeros where its cycles were
        with pytest.raises(LogReadingError):
            await ask(reader, log, (0.0, 3.0, 100))
        os.truncate(log, 0)  # what is mapped is no longer there, for which the kernel ends who reads it
        with pytest.raises(LogReadingError):
            await ask(reader, log)
        assert msgspec.json.decode(await ask(reader, other), type=LogView).cycles == 400

    run(scenario)


def test_process_that_dies_is_started_again(log: Path) -> None:
    async def scenario(reader: LogReader) -> None:
        await ask(reader, log)
        assert reader._process is not None
        reader._process[0].kill()
        reader._process[0].wait()
        with pytest.raises(LogReadingError, match=r"reading run\.mcap failed, try again") as failed:
            await ask(reader, log)
        assert failed.value.is_busy
        assert msgspec.json.decode(await ask(reader, log), type=LogView).cycles == 600

    run(scenario)


def test_more_requests_than_may_wait_are_refused(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_reader, "_MOST_WAITING", 2)

    async def scenario(reader: LogReader) -> None:
        answers = await asyncio.gather(*(ask(reader, log) for _ in range(4)), return_exceptions=True)
        assert [isinstance(answer, bytes) for answer in answers] == [True, True, False, False]
        assert isinstance(answers[2], LogReadingError)
        assert answers[2].is_busy

    run(scenario)


def test_log_that_has_grown_is_read_anew_as_a_whole_and_its_rows_go_on(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    logs = OpenLogs()

    def whole() -> LogView:
        with path.open("rb") as stream:
            return msgspec.json.decode(logs.answer(ReadRequest(name="run"), stream.fileno()), type=LogView)

    write_log(path, story(2.0))
    assert whole().cycles == 400
    content = write_log(tmp_path / "longer.mcap", [record(each) for each in range(600)]).read_bytes()
    path.write_bytes(content)
    assert whole().cycles == 600
    with path.open("rb") as stream:
        rows = logs.answer(ReadRequest(name="run", rows=(2.99, 2.999, 10)), stream.fileno())
    assert msgspec.json.decode(rows, type=LogRowsView).cycle == [598, 599]


def test_few_logs_stay_open(tmp_path: Path) -> None:
    logs = OpenLogs()
    for number in range(5):
        path = write_log(tmp_path / f"{number}.mcap", story(1.0))
        with path.open("rb") as stream:
            logs.answer(ReadRequest(name="run"), stream.fileno())
    assert len(logs._logs) == 3
