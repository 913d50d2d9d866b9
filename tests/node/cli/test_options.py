# SPDX-License-Identifier: MIT
import argparse

import pytest

from segway_ecc.firmware_io.build import serial_of
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.node.cli.options import robot_file
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.errors import ConfigurationError


def read(robot: str, **wanted: str) -> RobotFile:
    """The robot file with what the command line wants instead."""
    return robot_file(argparse.Namespace(robot=robot, **{"interface": None, "channel": None, "serial": None, **wanted}))


def test_without_options_it_is_the_robot_file() -> None:
    assert read("cart-can") == load_robot("cart-can")


def test_the_bus_and_the_line_of_the_command_line_are_taken() -> None:
    hardware = read("cart-can", channel="can7", serial="/dev/bench").hardware
    own = load_robot("cart-can").hardware
    assert not isinstance(hardware, NoHardwareSection)
    assert not isinstance(own, NoHardwareSection)
    assert (hardware.can.interface, hardware.can.channel) == (own.can.interface, "can7")
    assert serial_of(hardware) == SerialSettings(port="/dev/bench")


@pytest.mark.parametrize(
    ("robot", "wanted", "message"),
    [
        ("cart", {"channel": "can7"}, r"^--channel: robot 'cart' is on no CAN bus$"),
        ("cart-cia402", {"serial": "/dev/x"}, r"^--serial: the drives of robot 'cart-cia402' have no serial line$"),
    ],
)
def test_what_the_robot_does_not_have_is_refused(robot: str, wanted: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        read(robot, **wanted)
