# SPDX-License-Identifier: MIT
"""`segway-ecc case-study`: the thesis' tables and figures through each seat."""

import argparse
import dataclasses
import importlib.metadata
import platform
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.firmware_io.build import make_link
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.hil.case_study.can import IN_REAL_TIME, ROBOT, LockstepCanSeat, RealTimeCanSeat, run_in_real_time
from segway_ecc.hil.case_study.seats import (
    SUBMODEL_CART,
    OfflineSeat,
    Repeats,
    RosSeat,
    SeatRunner,
    conduct,
)
from segway_ecc.hil.case_study.study import Seat, Study, table
from segway_ecc.hil.errors import RunFailedError
from segway_ecc.hil.progress import show_all_progress
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.hil.verbs.proofs import check_counts, claims_out, has_figures, writing_to
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, output_folder, print_found
from segway_ecc.node.config import load_robot
from segway_ecc.node.native.compile import missing_compiler
from segway_ecc.node.ros.runtime import missing_packages

NEXT: Final = (
    ("play segway", "a simulated robot that balances, driven with the arrow keys"),
    ("prove fault can-cut", "the cable is cut while the robot drives: how soon that is detected, and torque zero"),
    ("model inspect FOLDER", "your own model: ports, parameters and states"),
)
"""What to type after a case study."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `case-study`."""
    parser.add_argument(
        "--seat",
        choices=[*map(str, Seat), "all"],
        action="append",
        help="where the model runs; may be given several times (default: all)",
    )
    add_json(parser)
    parser.add_argument(
        "--real-time",
        action=argparse.BooleanOptionalAction,
        help="all of the can seat in real time, or nothing of it (default: its table in lock step, and one run)",
    )
    parser.add_argument("--robot", default=ROBOT, help="the robot of the can seat (default: %(default)s)")
    parser.add_argument(
        "--channel",
        help="CAN interface of the can seat (default: in lock step a simulated bus, in real time the first there is)",
    )
    parser.add_argument("--plant-channel", metavar="CHANNEL", help="CAN interface of its plant (default: the same)")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="run the seats N times and compare them")
    parser.add_argument(
        "--out", type=output_folder, default=Path("out/case-study"), help="folder for the report and the logs"
    )


@ends_at_once()
@claims_out
def run(options: argparse.Namespace) -> int:
    """Conduct the study, write its report, and print its table.

    Raises:
        RunFailedError: A run in real time failed although repeated, and not because the machine stalled.
    """
    check_counts(options, "repeat")
    seats = _seats(options.seat)
    studies, reports = [], []
    for number in range(options.repeat):
        folder = options.out if options.repeat == 1 else options.out / f"run_{number + 1}"
        studies.append(_conduct(seats, folder, options))
        reports += _write_report(studies[-1], folder)
    cells = [
        {
            "linear": cell.linear,
            "angular": cell.angular,
            "offline_20sim": list(cell.thesis_offline),
            "standalone_ros_2019": list(cell.thesis_ros),
            **{str(seat): list(position) for seat, position in cell.positions.items()},
        }
        for cell in studies[-1].cells
    ]
    real = studies[-1].real_time
    in_real_time = real and dataclasses.asdict(real) | {"timing": real.timing and real.timing._asdict()}
    document = {"cells": cells, "real_time": in_real_time, "repeated": list(studies[-1].repeated)}
    print_found(options, document, table(studies[-1].cells, list(Seat)) + (f"\n{real.text}\n\n" if real else "\n"))
    sys.stdout.flush()  # what follows stands below it, wherever both go
    if len(studies) > 1:
        for seat in studies[0].seats:
            positions = [[cell.positions[seat] for cell in study.cells] for study in studies]
            same = sum(ran == positions[0] for ran in positions)
            sys.stderr.write(f"segway-ecc: {seat}: {same} of {len(studies)} runs gave the same bits\n")
    sys.stderr.writelines(f"segway-ecc: report: {report}\n" for report in reports)
    for study in studies:
        if study.real_time is not None and study.real_time.failure and not study.real_time.is_spoiled:
            raise RunFailedError(study.real_time.failure)
    if not options.json:
        sys.stderr.write("Try next:\n" + "".join(f"  {_program()} {words:<24}{what}\n" for words, what in NEXT))
    return 0


def _conduct(seats: list[Seat], folder: Path, options: argparse.Namespace) -> Study:
    repeats = Repeats(lambda cause: sys.stderr.write(f"segway-ecc: repeated: {cause}\n"))
    logs, messages = folder / "logs", folder / "messages"
    with writing_to(folder):
        for made in (logs, messages):
            made.mkdir(parents=True, exist_ok=True)
    channels = options.channel, options.plant_channel
    on_a_bus = options.channel and (options.channel, options.plant_channel or options.channel)
    real = RealTimeCanSeat(messages, logs, options.robot, channels)
    lockstep = LockstepCanSeat(logs, options.robot, on_a_bus)
    makers: dict[Seat, Callable[[], SeatRunner]] = {
        Seat.OFFLINE: lambda: OfflineSeat(logs),
        Seat.SUBMODEL: lambda: OfflineSeat(logs, Seat.SUBMODEL, SUBMODEL_CART),
        Seat.ROS: lambda: RosSeat(messages, logs),
        Seat.CAN: lambda: real if options.real_time else lockstep,
    }
    with show_all_progress(lines=True) as on_progress:
        study = conduct([makers[seat]() for seat in seats], _facts(folder, options), on_progress, repeats)
        if Seat.CAN in seats and options.real_time:
            study = dataclasses.replace(study, real_time=study.real_time or real.worst())
        elif Seat.CAN in seats and options.real_time is None:
            on_progress(IN_REAL_TIME, 0, 1)
            study = dataclasses.replace(study, real_time=run_in_real_time(real, lockstep, repeats))
            on_progress(IN_REAL_TIME, 1, 1)
    return study


def _program() -> str:
    """What to type for this tool: its name where a shell finds it, else how it was called."""
    name = "segway-ecc"
    return sys.argv[0] if Path(sys.argv[0]).name == name and not shutil.which(name) else name


def _seats(names: Sequence[str] | None) -> list[Seat]:
    """The seats to run, in their order; all of them means those that can."""
    if names and "all" not in names:
        return [seat for seat in Seat if seat in names]
    left_out = {}
    if missing_packages():
        left_out[Seat.ROS] = f"no ROS 2 here (no {', '.join(missing_packages())})"
    if (lack := missing_compiler()) is not None:
        left_out[Seat.SUBMODEL] = lack
    for seat, reason in left_out.items():
        sys.stderr.write(f"segway-ecc: the {seat} seat is left out: {reason}\n")
    return [seat for seat in Seat if seat not in left_out]


def _facts(folder: Path, options: argparse.Namespace) -> dict[str, str]:
    real = options.channel or make_link(hardware_of(load_robot(options.robot)), RealClock()).description
    lockstep = f"{options.channel or 'simulated'} in lock step"
    bus = {True: f"{real} in real time", False: lockstep, None: f"{lockstep}; {real} in real time"}[options.real_time]
    rclpy = "none"
    if not missing_packages():
        try:
            rclpy = f"rclpy {importlib.metadata.version('rclpy')}"
        except importlib.metadata.PackageNotFoundError:
            rclpy = "rclpy of the sourced installation"
    return {
        "segway-ecc": importlib.metadata.version("segway-ecc"),
        "Python": platform.python_version(),
        "ROS 2": rclpy,
        "Machine": f"{platform.machine()}, {platform.system()} {platform.release()}",
        "Robot on CAN": options.robot,
        "CAN bus": bus,
        "Logs (MCAP)": str(folder / "logs"),
    }


def _write_report(study: Study, folder: Path) -> list[Path]:
    """Write it where figures can be drawn; the files written."""
    if not has_figures():
        return []
    from segway_ecc.hil.case_study.report import render  # noqa: PLC0415 - an extra that the rest of this verb does without

    path = folder / "report.html"
    path.write_text(render(study), encoding="utf-8")
    return [path]
