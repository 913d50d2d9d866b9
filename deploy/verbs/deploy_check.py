# SPDX-License-Identifier: MIT
"""`segway-ecc deploy check ROBOT`: whether a robot file loads here, with its model; no bus is opened."""

import argparse

from segway_ecc.firmware_io.clock import NS_PER_S, RealClock
from segway_ecc.node.cli.options import add_json, add_robot, print_found, robot_file
from segway_ecc.node.robot import build_robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `deploy check`."""
    add_robot(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Load the robot file and its model."""
    file = robot_file(options)
    rate_hz = NS_PER_S / build_robot(file, RealClock()).period_ns
    text = f"{file.name} loads, and runs at {rate_hz:g} Hz\n"
    print_found(options, {"robot": file.name, "rate_hz": rate_hz}, text)
    return 0
