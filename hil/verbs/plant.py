# SPDX-License-Identifier: MIT
"""`segway-ecc plant ROBOT`: the other end of the robot's bus, simulated in real time."""

import argparse
import contextlib
import csv
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from segway_ecc.firmware_io.build import imu_line, serial_of
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.hil.drill.plant_control import DisturbedLink, DisturbedPort, LineReader, PlantControl, trace_writer
from segway_ecc.hil.rig.simulated_serial import serve_serial
from segway_ecc.hil.rig.simulation import Observer, RealTimePlant, Trace, devices_link, hardware_of, simulated_robot
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import (
    add_json,
    add_robot,
    output_of,
    print_found,
    real_time,
    robot_file,
    stopped_by_signals,
)
from segway_ecc.node.config import RobotFile
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages

_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `plant`."""
    add_robot(parser)
    add_json(parser)
    parser.add_argument("--truth", type=Path, metavar="FILE", help="write the plant's outputs at each tick, as CSV")
    parser.add_argument("--trace", type=Path, metavar="FILE", help="write what the motors give at each tick, as CSV")
    parser.add_argument(
        "--control",
        action="store_true",
        help="take faults from standard input until it ends: "
        "mute, cut, freeze WHAT, add WHAT AMOUNT, heal, write NAME VALUE, driven",
    )


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Run the plant until it is stopped."""
    file, clock = robot_file(options), RealClock()
    link = DisturbedLink(devices_link(hardware_of(file), clock))
    with messages(), contextlib.ExitStack() as stack:
        plant = RealTimePlant(
            simulated_robot(file, link, _serial_port(file, link, stack), _imu_port(file, stack)), clock
        )
        stack.enter_context(stopped_by_signals(plant.stop))
        observe = None if options.truth is None else _truth_file(stack.enter_context(_open(options.truth)), plant)
        traces = list[Trace]()
        if options.trace is not None:
            names = [v.name for v in plant.robot.plant.inputs]
            traces.append(trace_writer(stack.enter_context(_open(options.trace)), names))
        reader = None
        if options.control:
            control = PlantControl(plant.robot, link, plant.robot.plant, clock)
            traces.append(control.note_torque)
            # The plant ends with whoever controls it.
            reader = LineReader(sys.stdin.fileno(), output_of(options).fileno(), control.obey, plant.stop)
            stack.enter_context(contextlib.closing(reader))
        plant.robot.link.open()
        line = hardware_of(file).line
        on = f"serial {line.port}" if isinstance(line, PortSettings) else link.description
        _logger.info("plant of '%s' on %s", options.robot, on)
        with real_time():
            plant.run(observe, _all_of(traces), reader)
    result = {"ticks": plant.ticks, "late": plant.late, "refused_frames": plant.robot.refused_frames}
    print_found(options, result, {name: str(count) for name, count in result.items()})
    return 0


def _all_of(traces: Sequence[Trace]) -> Trace | None:
    if len(traces) < 2:  # noqa: PLR2004 - a pair needs both called
        return traces[0] if traces else None

    def trace(monotonic_ns: int, wall_ns: int, values: Sequence[float]) -> None:
        for each in traces:
            each(monotonic_ns, wall_ns, values)

    return trace


def _serial_port(file: RobotFile, link: DisturbedLink, stack: contextlib.ExitStack) -> Port | None:
    """The drives' end of the serial line that the robot's file names: one in place of a bus is disturbed as that is."""
    hardware = hardware_of(file)
    line = hardware.line
    if isinstance(line, PortSettings):
        return DisturbedPort(stack.enter_context(contextlib.closing(serve_serial(line))), link)
    serial = serial_of(hardware)
    return None if serial is None else stack.enter_context(contextlib.closing(serve_serial(serial)))


def _imu_port(file: RobotFile, stack: contextlib.ExitStack) -> Port | None:
    """The IMU's end of its own serial line, where the robot's file names one."""
    imu = imu_line(hardware_of(file))
    return None if imu is None else stack.enter_context(contextlib.closing(serve_serial(imu.serial)))


def _open(path: Path) -> IO[str]:
    try:
        return path.open("w", newline="", encoding="utf-8", buffering=1)
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error


def _truth_file(file: IO[str], plant: RealTimePlant) -> Observer:
    writer = csv.writer(file)
    writer.writerow(["wall_ns", *plant.robot.output_names])

    def observe(wall_ns: int, outputs: Sequence[float]) -> None:
        writer.writerow([wall_ns, *outputs])

    return observe
