# SPDX-License-Identifier: MIT
import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.build import imu_line, serial_of
from segway_ecc.firmware_io.links.settings import PortSettings, SerialSettings
from segway_ecc.firmware_io.settings import BusSettings, SerialOnlySettings
from segway_ecc.node.cli.options import add_robot, drawing_file, lines_of, output_file, output_folder, robot_file
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.errors import ConfigurationError


def read(robot: str, **wanted: str) -> RobotFile:
    """The robot file with what the command line wants instead."""
    lines = dict.fromkeys(("interface", "channel", "serial", "imu_serial"))
    return robot_file(argparse.Namespace(robot=robot, **{**lines, **wanted}))


def test_without_options_it_is_the_robot_file() -> None:
    assert read("cart-can") == load_robot("cart-can")


def test_the_bus_and_the_line_of_the_command_line_are_taken() -> None:
    hardware = read("cart-can", channel="can7", serial="/dev/bench").hardware
    own = load_robot("cart-can").hardware
    assert isinstance(hardware, BusSettings)
    assert isinstance(own, BusSettings)
    assert (hardware.can.interface, hardware.can.channel) == (own.can.interface, "can7")
    assert serial_of(hardware) == SerialSettings(port="/dev/bench")


def test_the_only_line_of_a_robot_is_named_like_one_to_fall_back_on() -> None:
    hardware = read("cart-hoverboard", serial="/dev/bench").hardware
    assert isinstance(hardware, SerialOnlySettings)
    assert hardware.line == PortSettings(port="/dev/bench", baudrate=115_200)


def test_the_line_of_an_imu_is_named_beside_that_of_the_drives() -> None:
    hardware = read("segway-hoverboard", imu_serial="/dev/imu").hardware
    own = load_robot("segway-hoverboard").hardware
    assert isinstance(hardware, SerialOnlySettings)
    assert isinstance(own, SerialOnlySettings)
    line = imu_line(hardware)
    assert line is not None
    assert line.serial == PortSettings(port="/dev/imu", baudrate=460_800)
    assert hardware.line == own.line
    both = read("segway-hoverboard", imu_serial="/dev/imu", serial="/dev/bench").hardware
    assert isinstance(both, SerialOnlySettings)
    assert (both.line.port, both.external_imu) == ("/dev/bench", line)


@pytest.mark.parametrize(
    ("robot", "wanted", "message"),
    [
        (
            "segway-odrive",
            {"imu_serial": "/dev/x"},
            r"^--imu-serial: robot 'segway-odrive' has no IMU on a serial line of its own$",
        ),
        (
            "cart-can",
            {"imu_serial": "/dev/x", "channel": "can7"},
            r"^--imu-serial: robot 'cart-can' has no IMU on a serial line of its own$",
        ),
        ("cart", {"channel": "can7"}, r"^--channel: robot 'cart' is on no CAN bus$"),
        (
            "cart-hoverboard",
            {"interface": "local", "serial": "/dev/x"},
            r"^--interface: robot 'cart-hoverboard' is on no CAN bus; name its serial line by --serial$",
        ),
        ("cart-cia402", {"serial": "/dev/x"}, r"^--serial: the drives of robot 'cart-cia402' have no serial line$"),
    ],
)
def test_what_the_robot_does_not_have_is_refused(robot: str, wanted: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        read(robot, **wanted)


def test_lines_are_handed_on_to_another_process_as_they_were_given() -> None:
    parser = argparse.ArgumentParser()
    add_robot(parser)
    words = ["--interface", "local", "--serial", "/dev/bench", "--imu-serial", "/dev/imu"]
    assert lines_of(parser.parse_args(["segway-hoverboard", *words])) == words
    assert lines_of(parser.parse_args(["segway-hoverboard"])) == []


def test_a_file_that_can_be_written_is_left_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "old.csv").write_text("kept")

    assert output_file(str(tmp_path / "new.csv")) == tmp_path / "new.csv"
    assert output_file(str(tmp_path / "old.csv")).read_text() == "kept"
    assert [path.name for path in tmp_path.iterdir()] == ["old.csv"]


def test_link_to_a_file_that_is_not_there_stays(tmp_path: Path) -> None:
    (tmp_path / "link.csv").symlink_to("new.csv")

    assert output_file(str(tmp_path / "link.csv")) == tmp_path / "link.csv"
    assert [path.name for path in tmp_path.iterdir()] == ["link.csv"]


def test_a_pipe_is_not_opened_before_it_is_written(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")

    assert output_file(str(tmp_path / "pipe")) == tmp_path / "pipe"


@pytest.mark.parametrize(
    "words",
    [
        ("sequence", "1", "0", "1", "--csv"),
        ("log", "replay", "no.mcap", "--plot"),
        ("model", "simulate", "no.Model", "--duration", "1", "--mcap"),
    ],
    ids=" ".join,
)
def test_a_file_that_cannot_be_written_is_refused_before_anything_is_done(
    segway_ecc: Callable[..., Any], words: tuple[str, ...]
) -> None:
    outcome = segway_ecc(*words, "/nowhere/x.png")

    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.errors == ["segway-ecc: cannot write /nowhere/x.png: No such file or directory"]


def test_a_drawing_in_a_format_that_there_is_not_is_refused_before(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot draw .*x\.doc: the formats are .*png"):
        drawing_file(str(tmp_path / "x.doc"))


def test_without_the_drawing_library_a_drawing_is_refused_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(ConfigurationError, match="--plot needs a drawing library"):
        drawing_file("x.png")


def test_a_folder_without_a_name_is_not_the_current_one() -> None:
    assert output_folder(".") == Path()
    with pytest.raises(ConfigurationError, match="empty"):
        output_folder("")
