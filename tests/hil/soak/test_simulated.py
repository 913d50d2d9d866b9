# SPDX-License-Identifier: MIT
"""A short drive in lock step with the recorder on, watched from outside."""

import time
from pathlib import Path

import pytest

from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.hil.soak.simulated import PatientRecorder, SimulatedSoak, soak
from segway_ecc.hil.soak.watching import Watching
from segway_ecc.node.cycle.interfaces import CycleRecord


def test_every_ten_simulated_seconds_all_is_looked_at(tmp_path: Path) -> None:
    watching, told = Watching(tmp_path), list[float]()
    said = soak(SimulatedSoak("cart-can", 31.0, 0.01, str(tmp_path / "soak.mcap")), watching, told.append)
    assert (said.trip, said.cycles) == ("", 3100)
    assert told == pytest.approx([10.0, 20.0, 30.0], abs=0.011)
    by_name = {(s.process, s.quantity): s.values for s in watching.series}
    assert by_name["simulated", "threads"] == [1, 1, 1]
    assert len(by_name["recorder", "open files"]) == 3
    assert min(by_name["simulated", "blocks of memory"]) > 0
    assert (tmp_path / "soak.mcap").stat().st_size > 0


def test_a_robot_that_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ProcessFailedError, match="no-such-robot"):
        soak(
            SimulatedSoak("no-such-robot", 30.0, 0.0, str(tmp_path / "soak.mcap")),
            Watching(tmp_path),
            lambda _: None,
        )


class Full:
    """A recorder that drops every second record."""

    dropped = 0
    written = 0

    def write(self, _record: object) -> None:
        self.written += 1
        self.dropped += self.written % 2 == 0


def test_the_writer_is_given_time_after_each_record_that_was_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr(time, "sleep", slept.append)
    recorder = PatientRecorder(Full())  # type: ignore[arg-type]  # what is used of one
    for _ in range(5):
        recorder.write(CycleRecord)  # type: ignore[arg-type]  # it is not looked at
    assert len(slept) == recorder.dropped == 2
