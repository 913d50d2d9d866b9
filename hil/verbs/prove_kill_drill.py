# SPDX-License-Identifier: MIT
"""`segway-ecc prove kill-drill`: kill, stop and cut every part of a driving robot; time to zero torque."""

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.build import serial_of, takes_serial
from segway_ecc.firmware_io.settings import BusSettings
from segway_ecc.hil.drill import trial
from segway_ecc.hil.drill.parts import DrillSetup, lines_of_its_own
from segway_ecc.hil.drill.trial import FAULTS, DrillFault, DrillOutcome, DrillResult, why_not_down
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.hil.text_table import aligned
from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot, packaged_robots
from segway_ecc.node.errors import ConfigurationError

ROBOT: Final = "cart-can"
_MOST: Final = 1000
_HEAD: Final = ("fault", "expected", "measured", "last torque, ms", "zero from, ms", "gap, ms", "guard", "verdict")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `kill-drill`."""
    names = ", ".join(packaged_robots())
    parser.add_argument("robot", nargs="?", default=ROBOT, help=f"a robot file, or one of {names} (default: {ROBOT})")
    parser.add_argument("--interface", default="local", help="python-can interface (default: local, this machine only)")
    parser.add_argument("--channel", help="CAN channel (default: one of our own)")
    parser.add_argument("--fault", action="append", choices=list(FAULTS), help="only this one (may be given again)")
    parser.add_argument(
        "--repeat", type=int, default=1, metavar="N", help="do each fault so often; the worst is reported"
    )
    parser.add_argument("--no-guard", action="store_true", help="without the guard: the drives' own watchdog alone")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Do every fault that the robot can have, and print the table; 1 where something was not as expected."""
    if not 1 <= options.repeat <= _MOST:
        raise ConfigurationError(f"--repeat must be 1 to {_MOST}")
    chosen, left_out = _choose(options, load_robot(options.robot))
    rows: list[list[DrillResult]] = []
    with tempfile.TemporaryDirectory(prefix="segway-ecc-drill-") as folder:
        for number, fault in enumerate(chosen):
            sys.stderr.write(f"segway-ecc: {fault.name}\n")
            rows.append([_drill(options, fault, Path(folder) / f"{number}_{n}") for n in range(options.repeat)])
    faults = [
        {
            **asdict(worst := trial.worst(row)),
            "outcome": worst.outcome,
            "as_expected": all(t.is_as_expected for t in row),
            "repeats": len(row),
            "last_torque_s": [None if t.torque is None else t.torque.last_s for t in row],
        }
        for row in rows
    ]
    print_found(options, {"faults": faults, "left_out": left_out}, _table(rows, left_out))
    return 0 if all(t.is_as_expected for row in rows for t in row) else 1


def _drill(options: argparse.Namespace, fault: DrillFault, folder: Path) -> DrillResult:
    folder.mkdir()
    channel = options.channel or f"drill_{os.getpid()}_{folder.name}"
    bus = ["--interface", options.interface, "--channel", channel]
    lines = lines_of_its_own(hardware_of(load_robot(options.robot)), folder, bus)
    setup = DrillSetup(options.robot, lines, fault.serial, not options.no_guard, fault.stepped, folder)
    return trial.run(fault, setup)


def _choose(options: argparse.Namespace, file: RobotFile) -> tuple[list[DrillFault], dict[str, str]]:
    """The faults that this robot can have here, and why it cannot have the others."""
    if isinstance(file.hardware, NoHardwareSection):
        raise ConfigurationError(f"robot '{file.name}' is all model: it has no drives to be cut off from")
    if serial_of(file.hardware) is not None:
        raise ConfigurationError(f"robot '{file.name}' names a serial line: take it out, the drill makes its own")
    can_serial = isinstance(file.hardware, BusSettings) and takes_serial(file.hardware)
    no_interface = why_not_down(options.channel or "")
    if options.interface != "socketcan" or options.channel is None:
        no_interface = "it needs a network interface: --interface socketcan --channel vcan0"
    faults = [FAULTS[name] for name in options.fault or FAULTS]
    if file.hardware.external_imu is not None:  # which no serial line of the drives reaches
        faults = [
            replace(fault, expected=DrillOutcome.ENDS, silences=True) if fault.serial else fault for fault in faults
        ]
    left_out = {f.name: "there is no guard" for f in faults if f.guard and options.no_guard}
    left_out |= {f.name: "its drives have no serial line" for f in faults if f.serial and not can_serial}
    left_out |= {f.name: no_interface for f in faults if f.interface and no_interface is not None}
    return [fault for fault in faults if fault.name not in left_out], left_out


def _table(rows: Sequence[Sequence[DrillResult]], left_out: dict[str, str]) -> str:
    head, *lines = aligned([_HEAD, *(_row(trial.worst(row), len(row)) for row in rows)])
    text = head + "\n"
    for line, row in zip(lines, rows, strict=True):
        worst = trial.worst(row)
        notes = [f"({worst.note})"] if worst.note else []
        notes += [f"robot: {message}" for message in worst.messages]
        text += f"{line}\n" + "".join(f"    {note}\n" for note in notes or ["robot: nothing"])
    return text + "".join(f"{name}: left out, {why}\n" for name, why in left_out.items())


def _row(worst: DrillResult, repeats: int) -> tuple[str, ...]:
    torque, expected = worst.torque, str(worst.expected)
    if worst.expected is DrillOutcome.ENDS:
        expected += f", {worst.within_s * 1e3:.0f} ms"
    ended = torque is not None and torque.zero_s is not None
    return (
        worst.fault + (f" x{repeats}" if repeats > 1 else ""),
        expected,
        worst.outcome,
        _ms(torque.last_s) if torque is not None and ended else "-",
        _ms(torque.zero_s) if torque is not None else "-",
        _ms(torque.gap_s) if torque is not None and not ended else "-",
        "ran" if worst.guard else "no",
        "as expected" if worst.is_as_expected else "NOT as expected",
    )


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1e3:.1f}"
