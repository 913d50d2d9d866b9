# SPDX-License-Identifier: MIT
"""`segway-ecc plant`: the other end of the bus."""

import csv
import importlib.resources
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.drives.wheel_board.serial_codec import BoardSerialCodec
from segway_ecc.firmware_io.imus.icm42688_bridge.frames import BridgeCodec
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.local_bus import LocalBus
from tests.patience import PATIENCE_S

pytestmark = pytest.mark.real_time

Run = Callable[..., Any]
BOARD_SESSION = 0x131
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


def test_link_that_is_not_its_own_is_refused_and_kept(segway_ecc: Run, tmp_path: Path) -> None:
    link = tmp_path / "usb-FTDI_FT232R_A1B2C3-if00-port0"
    link.symlink_to("../../ttyUSB0")
    outcome = segway_ecc("plant", "cart-can", "--serial", str(link))

    assert outcome.code == 2
    assert one_line(outcome) == (
        f"segway-ecc: cannot make a serial line at {link}: it exists and is not a link that a plant made; "
        "name another path, or remove it yourself"
    )
    assert str(link.readlink()) == "../../ttyUSB0"


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
    assert message.arbitration_id in {0x120, 0x121, 0x130, BOARD_SESSION}
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


def test_plant_answers_on_a_real_serial_port(tmp_path: Path) -> None:
    channel, codec = f"plant_serial_{os.getpid()}", BoardSerialCodec()
    robot, device = os.openpty()
    link = tmp_path / "usb-FTDI_FT232R_A1B2C3-if00-port0"
    link.symlink_to(os.ttyname(device))
    words = ["plant", "cart-can", "--interface", "local", "--channel", channel, "--serial", str(link)]
    with LocalBus(channel) as bus:
        command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as plant:
            assert bus.recv(PATIENCE_S) is not None  # its port is open by now
            os.write(robot, codec.request())
            received: list[int] = []
            while BOARD_SESSION not in received and select.select([robot], [], [], PATIENCE_S)[0]:
                received += [frame.arbitration_id for frame in codec.decode(os.read(robot, 4096), 0)]
            plant.send_signal(signal.SIGINT)
            plant.communicate(timeout=PATIENCE_S)
    os.close(device)
    os.close(robot)

    assert received == [0x120, 0x121, 0x130, BOARD_SESSION]
    assert plant.returncode == 0
    assert link.is_symlink()


def test_a_plant_makes_the_line_of_an_imu_where_it_is_told_to(tmp_path: Path) -> None:
    lines = {"--serial": tmp_path / "drives", "--imu-serial": tmp_path / "imu"}
    words = ["plant", "segway-hoverboard", *(str(word) for line in lines.items() for word in line)]
    codec, received = BridgeCodec(), list[Frame]()
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as plant:
        deadline = time.monotonic() + PATIENCE_S
        while not all(line.exists() for line in lines.values()) and time.monotonic() < deadline:
            time.sleep(0.02)
        port = os.open(lines["--imu-serial"], os.O_RDONLY | os.O_NOCTTY)
        while not received and select.select([port], [], [], PATIENCE_S)[0]:
            received += codec.decode(os.read(port, 4096), 0)
        os.close(port)
        plant.send_signal(signal.SIGINT)
        plant.communicate(timeout=PATIENCE_S)

    assert received
    assert plant.returncode == 0
    assert not any(line.is_symlink() for line in lines.values()), "they go with the plant"
