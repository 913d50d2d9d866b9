# SPDX-License-Identifier: MIT
"""`segway-ecc case-study`: the thesis' tables and figures through each seat."""

import argparse
import importlib.metadata
import importlib.util
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from segway_ecc.firmware_io.build import can_link
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.hil.case_study.can import ROBOT, LockstepCanSeat, RealTimeCanSeat
from segway_ecc.hil.case_study.seats import SUBMODEL_CART, OfflineSeat, RosSeat, SeatRunner, conduct, has_compiler
from segway_ecc.hil.case_study.study import Seat, Study, table
from segway_ecc.hil.progress import show_all_progress
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.hil.verbs.proofs import check_counts, has_figures, print_found, writing_to
from segway_ecc.node.cli.options import add_json
from segway_ecc.node.config import load_robot
from segway_ecc.node.ros.runtime import missing_packages


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `case-study`."""
    parser.add_argument(
        "--seat",
        choices=[*map(str, Seat), "all"],
        action="append",
        help="where the model runs; may be given several times (default: all)",
    )
    add_json(parser)
    parser.add_argument("--lock-step", action="store_true", help="the can seat on a simulated clock")
    parser.add_argument("--robot", default=ROBOT, help="the robot of the can seat (default: %(default)s)")
    parser.add_argument(
        "--channel", help="CAN interface of the can seat (default: the first there is, or a simulated bus)"
    )
    parser.add_argument("--plant-channel", metavar="CHANNEL", help="CAN interface of its plant (default: the same)")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="run the seats N times and compare them")
    parser.add_argument("--out", type=Path, default=Path("out/case-study"), help="folder for the report and the logs")


def run(options: argparse.Namespace) -> int:
    """Conduct the study, print its table and write its report."""
    check_counts(options, "repeat")
    seats = _seats(options.seat)
    studies = []
    for number in range(options.repeat):
        folder = options.out if options.repeat == 1 else options.out / f"run_{number + 1}"
        with show_all_progress(lines=True) as on_progress:
            study = conduct(_runners(seats, folder, options), _facts(folder, options.robot), on_progress)
        _write_report(study, folder)
        studies.append(study)
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
    print_found(options, {"cells": cells}, table(studies[-1].cells, list(Seat)) + "\n")
    if len(studies) > 1:
        for seat in studies[0].seats:
            positions = [[cell.positions[seat] for cell in study.cells] for study in studies]
            same = sum(ran == positions[0] for ran in positions)
            sys.stderr.write(f"segway-ecc: {seat}: {same} of {len(studies)} runs gave the same bits\n")
    return 0


def _seats(names: Sequence[str] | None) -> list[Seat]:
    """The seats to run, in their order; all of them means those that can."""
    if names and "all" not in names:
        return [seat for seat in Seat if seat in names]
    left_out = {}
    if missing_packages():
        left_out[Seat.ROS] = f"no ROS 2 here (no {', '.join(missing_packages())})"
    if not has_compiler():
        left_out[Seat.SUBMODEL] = "no C compiler here (sudo apt-get install gcc)"
    for seat, reason in left_out.items():
        sys.stderr.write(f"segway-ecc: {reason}: the {seat} seat is left out\n")
    return [seat for seat in Seat if seat not in left_out]


def _runners(seats: list[Seat], folder: Path, options: argparse.Namespace) -> list[SeatRunner]:
    logs, messages = folder / "logs", folder / "messages"
    with writing_to(folder):
        for made in (logs, messages):
            made.mkdir(parents=True, exist_ok=True)

    def can_seat() -> SeatRunner:
        if options.lock_step:
            on_a_bus = options.channel and (options.channel, options.plant_channel or options.channel)
            return LockstepCanSeat(logs, options.robot, on_a_bus)
        return RealTimeCanSeat(messages, logs, options.robot, (options.channel, options.plant_channel))

    makers: dict[Seat, Callable[[], SeatRunner]] = {
        Seat.OFFLINE: lambda: OfflineSeat(logs),
        Seat.SUBMODEL: lambda: OfflineSeat(logs, Seat.SUBMODEL, SUBMODEL_CART),
        Seat.ROS: lambda: RosSeat(messages, logs),
        Seat.CAN: can_seat,
    }
    return [makers[seat]() for seat in seats]


def _facts(folder: Path, robot: str) -> dict[str, str]:
    bus = can_link(hardware_of(load_robot(robot)).can, RealClock()).description
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
        "Robot on CAN": robot,
        "CAN bus": bus,
        "Logs (MCAP)": str(folder / "logs"),
    }


def _write_report(study: Study, folder: Path) -> None:
    if not has_figures():
        return
    from segway_ecc.hil.case_study.report import render  # noqa: PLC0415 - an extra that the rest of this verb does without

    path = folder / "report.html"
    path.write_text(render(study), encoding="utf-8")
    sys.stderr.write(f"segway-ecc: report: {path}\n")
