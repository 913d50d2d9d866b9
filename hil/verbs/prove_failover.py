# SPDX-License-Identifier: MIT
"""`segway-ecc prove failover`: lose the bus in every way there is, and measure when the serial line takes over."""

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.links.can_interfaces import resolve
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.hil.drill.failover import CAUSES, INTERFACE_DOWN, Failover, FailoverResult
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.cli.options import add_json, add_robot, print_found, robot_file

_HEAD: Final = (
    ("cause", "seen as", "telemetry", "torque", "off course", "odometry"),
    ("", "", "gap, ms", "gap, ms", "m", "step, m"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `failover`."""
    add_robot(parser)
    add_json(parser)
    parser.add_argument("--cause", action="append", choices=CAUSES, help="only this one (may be given again)")


def run(options: argparse.Namespace) -> int:
    """Lose the bus in one way after the other, and print the table."""
    file = robot_file(options)
    hardware = file.hardware
    # Only the kernel's own interfaces can be set down.
    is_kernels = isinstance(hardware, BusSettings) and (
        resolve(hardware.can.interface, hardware.can.channel)[0] == "socketcan"
    )
    causes = options.cause or [cause for cause in CAUSES if is_kernels or cause != INTERFACE_DOWN]
    with tempfile.TemporaryDirectory(prefix="segway-ecc-failover-") as folder:
        failover = Failover(options.robot, file, Path(folder))
        trials = []
        for cause in causes:
            sys.stderr.write(f"segway-ecc: {cause}\n")
            trials.append(failover.run(cause))
    document = {"trials": [dataclasses.asdict(trial) for trial in trials]}
    print_found(options, document, "".join(f"{line}\n" for line in aligned([*_HEAD, *map(_row, trials)])))
    return 0


def _row(trial: FailoverResult) -> tuple[str, ...]:
    return (
        trial.cause,
        trial.seen_as or f"not at all: {trial.end}",
        *("never" if gap_s is None else f"{gap_s * 1e3:.1f}" for gap_s in (trial.telemetry_gap_s, trial.torque_gap_s)),
        f"{trial.off_course_m:.3f}",
        f"{trial.odometry_step_m:.3f}",
    )
