# SPDX-License-Identifier: MIT
"""A log in which one byte is another: what it costs, and that it is never silent."""

import json
from bisect import bisect_right
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.robot import build_robot
from segway_ecc.testing import ScriptedClock, ScriptedStage

Run = Callable[..., Any]
CYCLES = 300
FLUSHED_EVERY = 25
SNAPSHOT_EVERY = 100


class Flushing(CycleLog):
    """A log whose chunks are as short as those of a robot's."""

    def write(self, record: CycleRecord) -> None:
        super().write(record)
        if record.cycle % FLUSHED_EVERY == FLUSHED_EVERY - 1:
            self.flush()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a cart that is sent a set-point now and then."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    stage = ScriptedStage(ScriptedClock())
    for cycle in range(10, CYCLES, 40):
        stage.send_setpoint(cycle, Setpoint(0.001 * cycle, 0.1))
    robot.loop(stage, Flushing(path, layout_of(robot), provenance_of(robot.file))).run(CYCLES)
    return path


def chunks_of(log: Path) -> list[tuple[int, int]]:
    """Where each chunk with cycles begins and ends; after them is one with diagnostics alone."""
    with log.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [(c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in summary.chunk_indexes][
        : CYCLES // FLUSHED_EVERY
    ]


def check_flips(segway_ecc: Run, log: Path, flips: int, seed: int) -> dict[str, int]:
    """Flip so many bytes, one at a time; how often that cost a chunk, and how often the log was reported as whole."""
    data, chunks, figures = log.read_bytes(), chunks_of(log), {"flips": flips, "chunks lost": 0, "exit code 0": 0}
    broken, generator = log.with_name("flipped.mcap"), np.random.default_rng(seed)
    for _ in range(flips):
        place, mask = int(generator.integers(len(data))), int(generator.integers(1, 256))
        broken.write_bytes(data[:place] + bytes([data[place] ^ mask]) + data[place + 1 :])
        hit = bisect_right(chunks, (place, len(data))) - 1
        first = hit * FLUSHED_EVERY if hit >= 0 and place < chunks[hit][1] else CYCLES
        inside = set(range(first, min(first + FLUSHED_EVERY, CYCLES)))
        found = [record.cycle for record in RecordedRun(broken).cycles()]
        # LZ4 may refer to equal bytes in another place, and mean the same.
        assert set(range(CYCLES)) - set(found) in (inside, set()), (place, mask)
        outcome = segway_ecc("log", "replay", str(broken), "--json")
        report = json.loads(outcome.out)
        assert report["cycles"] + report["behind"] == len(found)
        known = -(-(first + FLUSHED_EVERY) // SNAPSHOT_EVERY) * SNAPSHOT_EVERY
        assert report["cycles"] == (CYCLES if len(found) == CYCLES else first + max(0, CYCLES - known))
        assert report["difference"] is None
        assert outcome.errors
        figures["chunks lost"] += len(found) < CYCLES
        figures["exit code 0"] += outcome.code == 0
        assert outcome.code in {0, 9}
    return figures


def test_a_flipped_byte_costs_its_chunk_and_is_always_reported(segway_ecc: Run, log: Path) -> None:
    assert segway_ecc("log", "replay", str(log)).code == 0
    figures = check_flips(segway_ecc, log, 30, seed=1)

    assert figures["exit code 0"] == 0
    assert figures["chunks lost"] > 0


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(2, 6))
def test_a_hundred_flipped_bytes(segway_ecc: Run, log: Path, seed: int) -> None:
    figures = check_flips(segway_ecc, log, 100, seed)
    print(f"seed {seed}: {figures}")

    assert figures["exit code 0"] == 0


def test_the_cycles_of_the_last_chunk_are_reported_as_missing(segway_ecc: Run, log: Path) -> None:
    data, (begin, end) = log.read_bytes(), chunks_of(log)[-1]
    broken = log.with_name("last.mcap")
    broken.write_bytes(data[: begin + 60] + bytes(100) + data[begin + 160 :])
    outcome = segway_ecc("log", "replay", str(broken))

    assert outcome.code == 9
    assert outcome.errors == [
        f"segway-ecc: last.mcap: bytes {begin} to {end - 1} are damaged",
        "segway-ecc: last.mcap: 1 of 9 messages on /cycle_events, "
        + ", ".join(f"25 of 300 messages on {topic}" for topic in ("/cycle", "/setpoint", "/odom", "/joint_states"))
        + " are missing",
        "segway-ecc: cycles 275 to 299 are missing in the log",
    ]
