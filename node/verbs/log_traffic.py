# SPDX-License-Identifier: MIT
"""`segway-ecc log traffic ROBOT --out FILE`: the raw traffic on a robot's bus, as a candump log."""

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, add_robot, check_seconds, print_found, robot_file, stopped_by_signals
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.recording.log_quota import MB
from segway_ecc.node.recording.traffic import CandumpLog, listen

_LONGEST_S: Final = 1e9
_SMALLEST_MB: Final = 0.01


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `traffic`."""
    add_robot(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the log; the older half is FILE.1")
    parser.add_argument("--duration", type=float, metavar="S", help="end after this long; else on Ctrl-C")
    parser.add_argument(
        "--limit", type=float, default=1000.0, metavar="MB", help="room for both files (default: %(default)g)"
    )
    add_json(parser)


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Record until stopped."""
    check_seconds(options, "duration", _LONGEST_S)
    if not _SMALLEST_MB <= options.limit <= _LONGEST_S:
        raise ConfigurationError(f"--limit must be {_SMALLEST_MB:g} MB at least")
    file = robot_file(options)
    if not isinstance(file.hardware, BusSettings):
        raise ConfigurationError(f"robot '{file.name}' is on no CAN bus")
    bus = file.hardware.can
    end_s = None if options.duration is None else time.monotonic() + options.duration
    reasons: list[str] = []
    with CandumpLog(options.out, round(options.limit * MB)) as log, stopped_by_signals(reasons.append):
        sys.stderr.write(f"segway-ecc: bus traffic: {options.out}\n")
        listen(
            bus,
            log,
            lambda: bool(reasons) or (end_s is not None and time.monotonic() >= end_s),
        )
    print_found(options, {"frames": log.frames}, f"{log.frames} frames\n")
    return 0
