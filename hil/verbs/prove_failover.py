"""`segway-ecc prove failover`: lose the bus in every way there is, and measure when the serial line takes over."""

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.links.can_interfaces import resolve
from segway_ecc.hil.drill.failover import CAUSES, INTERFACE_DOWN, Failover, FailoverResult
from segway_ecc.node.cli.options import add_json, add_robot, print_json, robot_file
from segway_ecc.node.config import NoHardwareSection, RobotFile

_WIDTHS: Final = (18, 37, 10, 10, 10, 10)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `failover`."""
    add_robot(parser)
    add_json(parser)
    parser.add_argument("--cause", action="append", choices=CAUSES, help="only this one (may be given again)")


def run(options: argparse.Namespace) -> int:
    """Lose the bus in one way after the other, and print the table."""
    file = robot_file(options)
    with tempfile.TemporaryDirectory(prefix="segway-ecc-failover-") as folder:
        failover = Failover(options.robot, file, Path(folder))
        trials = []
        for cause in options.cause or _causes(file):
            sys.stderr.write(f"segway-ecc: {cause}\n")
            trials.append(failover.run(cause))
    if options.json:
        print_json({"trials": [dataclasses.asdict(trial) for trial in trials]})
    else:
        sys.stdout.write(_table(trials))
    return 0


def _causes(file: RobotFile) -> list[str]:
    """All causes that this machine can make; only the kernel's own interfaces can be set down."""
    hardware = file.hardware
    is_kernels = not isinstance(hardware, NoHardwareSection) and (
        resolve(hardware.can.interface, hardware.can.channel)[0] == "socketcan"
    )
    return [cause for cause in CAUSES if is_kernels or cause != INTERFACE_DOWN]


def _table(trials: list[FailoverResult]) -> str:
    head = ("cause", "seen as", "telemetry", "torque", "off course", "odometry")
    units = ("", "", "gap, ms", "gap, ms", "m", "step, m")
    rows = [head, units, *(_row(trial) for trial in trials)]
    return "".join(_line(row) for row in rows)


def _line(row: Sequence[str]) -> str:
    return "  ".join(f"{text:<{width}}" for text, width in zip(row, _WIDTHS, strict=True)).rstrip() + "\n"


def _row(trial: FailoverResult) -> tuple[str, ...]:
    return (
        trial.cause,
        trial.seen_as or f"not at all: {trial.end}",
        _ms(trial.telemetry_gap_s),
        _ms(trial.torque_gap_s),
        f"{trial.off_course_m:.3f}",
        f"{trial.odometry_step_m:.3f}",
    )


def _ms(duration_s: float | None) -> str:
    return "never" if duration_s is None else f"{duration_s * 1e3:.1f}"
