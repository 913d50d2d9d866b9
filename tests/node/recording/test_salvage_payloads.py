# SPDX-License-Identifier: MIT
"""The messages of a chunk as bytes are those that `messages` gives."""

from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cdr import diagnostic_array, read_diagnostic_array
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.recording.salvage import Salvage

CYCLES = 30
TOPICS = ("/cycle", "/setpoint")


@pytest.fixture
def path(tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]) -> Path:
    with CycleLog(tmp_path / "run.mcap", layout) as log:
        for cycle in range(CYCLES):
            log.write(record(cycle))
            if cycle % 10 == 9:
                log.flush()
    return tmp_path / "run.mcap"


def test_payloads_of_all_chunks_are_all_messages_of_their_topics(path: Path) -> None:
    source = Salvage(path)
    assert source.chunk_count >= 3
    found = [each for chunk in range(source.chunk_count) for each in source.payloads(chunk, TOPICS)]
    assert found == [(topic, message.data) for topic, message in source.messages() if topic in TOPICS]
    assert len(found) == 2 * CYCLES


def test_log_is_read_from_an_open_file_which_stays_open(path: Path) -> None:
    with path.open("rb") as stream:
        source = Salvage(Path("called so"), stream.fileno())
        assert source.is_whole
        assert not stream.closed
        assert stream.seek(0) == 0
    assert len(list(source.payloads(0, ("/cycle",)))) == 10


def test_chunk_that_was_overwritten_since_is_refused(path: Path) -> None:
    source = Salvage(path)
    size = path.stat().st_size
    with path.open("r+b") as stream:
        stream.write(bytes(size))
    with pytest.raises(RecordingError, match="has changed while it was read"):
        list(source.payloads(1, TOPICS))


def test_diagnostics_are_read_as_they_were_written() -> None:
    statuses = [
        DiagnosticStatus(Level.OK, "a: mode", "ARMED", {"mode": "ARMED", "reason": "asked to \u00e4rm"}),
        DiagnosticStatus(Level.WARN, "a: timing", "", {}),
    ]
    data = diagnostic_array(5_000_000_123, "frame", statuses)
    assert read_diagnostic_array(data) == (5_000_000_123, [(each.name, dict(each.values)) for each in statuses])


@pytest.mark.parametrize("length", [0, 10, 30, 60])
def test_diagnostics_that_are_cut_off_are_refused(length: int) -> None:
    data = diagnostic_array(1, "", [DiagnosticStatus(Level.OK, "a: mode", "ARMED", {"mode": "ARMED"})])
    with pytest.raises(RecordingError, match="diagnostics is damaged"):
        read_diagnostic_array(data[:length])
