# SPDX-License-Identifier: MIT
"""`segway-ecc plant`: the other end of the bus."""

import csv
import importlib.resources
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.links.local_bus import LocalBus
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.real_time

Run = Callable[..., Any]
BOARD_STATUS = 0x130
TICK_NS = 5_000_000


def one_line(outcome: Any) -> str:
    assert outcome.out == ""
    (line,) = outcome.errors
    assert line.startswith("segway-ecc: ")
    return str(line)


def test_a_robot_that_is_all_model_has_nothing_to_simulate(segway_ecc: Run) -> None:
    outcome = segway_ecc("plant", "cart")

    assert outcome.code == 8
    assert one_line(outcome) == "segway-ecc: robot 'cart' has no hardware that could be simulated: it is all model"


def test_a_robot_file_without_a_plant_is_refused_with_what_to_add(segway_ecc: Run, tmp_path: Path) -> None:
    text = importlib.resources.files("segway_ecc.node").joinpath("robots/cart-can.yaml").read_text("utf-8")
    path = tmp_path / "plantless.yaml"
    path.write_text(text.partition("simulation:")[0], "utf-8")
    outcome = segway_ecc("plant", str(path))

    assert outcome.code == 8
    assert "add simulation.plant" in one_line(outcome)


def test_a_bus_that_is_not_there_is_reported(segway_ecc: Run) -> None:
    outcome = segway_ecc("plant", "cart-can", "--interface", "socketcan", "--channel", "nosuch0")

    assert outcome.code == 4
    assert one_line(outcome).startswith("segway-ecc: no CAN interface is called 'nosuch0'; ")


def test_a_truth_file_that_cannot_be_written_is_reported(segway_ecc: Run, tmp_path: Path) -> None:
    outcome = segway_ecc("plant", "cart-can", "--truth", str(tmp_path / "no" / "truth.csv"))

    assert outcome.code == 2
    assert one_line(outcome) == f"segway-ecc: cannot write {tmp_path}/no/truth.csv: No such file or directory"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_plant_sends_until_it_is_stopped_and_prints_its_counts(tmp_path: Path, number: signal.Signals) -> None:
    channel, truth = f"plant_{os.getpid()}", tmp_path / "truth.csv"
    words = ["plant", "cart-can", "--interface", "local", "--channel", channel, "--truth", str(truth), "--json"]
    with LocalBus(channel) as bus:
        command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as plant:
            message = bus.recv(PATIENCE_S)
            plant.send_signal(number)
            out, errors = plant.communicate(timeout=PATIENCE_S)

    assert message is not None
    assert message.arbitration_id in {0x120, 0x121, BOARD_STATUS}
    assert plant.returncode == 0
    assert errors == f"segway-ecc: plant of 'cart-can' on local {channel}\n"
    result = json.loads(out)
    assert set(result) == {"ticks", "late", "refused_frames"}
    assert result["ticks"] > 0
    assert result["refused_frames"] == 0
    with truth.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header[0] == "wall_ns"
    assert {"truth.x", "truth.y", "truth.heading", "left.velocity"} <= set(header)
    assert len(rows) == result["ticks"]
    stamps = [int(row[0]) for row in rows]
    # Stamps are those of the ticks' deadlines, as nearly as two readings of two clocks allow.
    assert all(abs(later - earlier - TICK_NS) < TICK_NS for earlier, later in pairwise(stamps))
    carried = header.index("imu.linear_acceleration_z")
    assert {row[carried] for row in rows} == {"9.80665"}
    assert {float(value) for row in rows for value in row[1:carried]} == {0.0}
