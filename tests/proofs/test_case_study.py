# SPDX-License-Identifier: MIT
"""The longer proofs of the case study, run by `make prove`; figures that depend on the machine are printed."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.case_study.can import RealTimeCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat, Repeats, RosSeat, SeatRunner, conduct
from segway_ecc.hil.case_study.study import Seat, Study, worst_difference

pytestmark = pytest.mark.proof
RUNS = 10


def study(folder: Path, *runners: SeatRunner) -> Study:
    def on_progress(seat: Seat, done: int, total: int) -> None:
        sys.stderr.write(f"{folder.name}: {seat}: {done} of {total}\n")

    # A run that was repeated is named, and counts: what is proved is how a run ends.
    return conduct(
        runners, {}, on_progress, Repeats(lambda cause: sys.stderr.write(f"{folder.name}: repeated: {cause}\n"))
    )


@pytest.mark.ros
@pytest.mark.parametrize("run", range(RUNS))
def test_ros_equals_offline_to_the_last_bit(run: int, tmp_path: Path) -> None:
    del run
    found = study(tmp_path, OfflineSeat(tmp_path), RosSeat(tmp_path, tmp_path))
    assert [c.positions[Seat.ROS] for c in found.cells] == [c.positions[Seat.OFFLINE] for c in found.cells]


def test_can_in_real_time_is_close_to_the_thesis(tmp_path: Path) -> None:
    found = study(tmp_path, RealTimeCanSeat(tmp_path, tmp_path))
    worst = worst_difference(found.cells, Seat.CAN)
    sys.stderr.write(f"worst difference over CAN: {worst:.4f} m\n")
    assert worst <= 0.12


def test_every_cycle_of_ten_minutes_is_accounted_for(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "run", "cart", "--duration", "600", "--json"]
    output = subprocess.run([*command, "--log", str(tmp_path / "log.mcap")], stdout=subprocess.PIPE, check=True).stdout
    result: dict[str, Any] = json.loads(output)
    timing = result["diagnostics"]["cart: timing"]
    sys.stderr.write(f"ten minutes: {json.dumps({**timing, 'mean_rate_hz': result['mean_rate_hz']}, indent=2)}\n")
    assert result["cycles"] == 60_000
    assert (timing["late"], timing["skipped"]) == (str(result["late"]), str(result["skipped"]))
    assert result["timing"]["lateness"]["count"] == result["cycles"]
