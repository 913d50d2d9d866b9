"""`segway-ecc plant ROBOT`: the other end of the robot's bus, simulated in real time."""

import argparse
import contextlib
import csv
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from hil.real_time import RealTimePlant
from hil.simulation import Observer, simulated_bus, simulated_plant
from node.cli.options import (
    add_json,
    add_robot,
    ask_for_real_time,
    print_json,
    print_table,
    robot_file,
    stopped_by_signals,
)
from node.cycle.clock import RealClock
from node.errors import ConfigurationError
from node.logs import messages
from node.robot import can_link

_logger = logging.getLogger(__name__)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `plant`."""
    add_robot(parser)
    add_json(parser)
    parser.add_argument("--truth", type=Path, metavar="FILE", help="write the plant's outputs at each tick, as CSV")


def run(options: argparse.Namespace) -> int:
    """Run the plant until it is stopped."""
    file, clock = robot_file(options), RealClock()
    plant = RealTimePlant(can_link(simulated_bus(file), clock), simulated_plant(file), clock)
    with messages(), stopped_by_signals(plant.stop), contextlib.ExitStack() as stack:
        observe = None if options.truth is None else _truth_file(stack.enter_context(_open(options.truth)), plant)
        plant.open()
        _logger.info("plant of '%s' on %s", options.robot, plant.description)
        ask_for_real_time()
        plant.run(observe)
    result = {"ticks": plant.ticks, "late": plant.late, "refused_frames": plant.refused_frames}
    if options.json:
        print_json(result)
    else:
        print_table({name: str(count) for name, count in result.items()})
    return 0


def _open(path: Path) -> IO[str]:
    try:
        return path.open("w", newline="", encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error


def _truth_file(file: IO[str], plant: RealTimePlant) -> Observer:
    writer = csv.writer(file)
    writer.writerow(["wall_ns", *plant.output_names])

    def observe(wall_ns: int, outputs: Sequence[float]) -> None:
        writer.writerow([wall_ns, *outputs])

    return observe
