# SPDX-License-Identifier: MIT
"""`segway-ecc sequence`: sequence control, a node of its own."""

import argparse
import sys
from dataclasses import asdict
from typing import Final

from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import (
    add_json,
    add_namespace,
    check_seconds,
    output_file,
    print_found,
    ros_name,
    write_csv,
)
from segway_ecc.node.cli.worker import Worker, run_in_worker
from segway_ecc.node.errors import ConfigurationError, SequenceError, plain_number
from segway_ecc.node.ros.commander import Commander
from segway_ecc.node.ros.runtime import connections, ros_node, steady_executor
from segway_ecc.node.sequence.manoeuvre import LONGEST_S, Manoeuvre, Odometry, Player, load_manoeuvre, single_segment

_THREE: Final = 3
_BAR: Final = 30
_LATE_S: Final = 0.2
"""What the way from the robot to here may add to how long a sequence took."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `sequence`."""
    parser.add_argument(
        "what",
        nargs="+",
        metavar="LINEAR ANGULAR DURATION | FILE",
        help="set-points in m/s and rad/s held for some seconds, or a YAML file with a list of segments",
    )
    add_namespace(parser)
    add_json(parser)
    parser.add_argument("--wait", type=float, default=10.0, metavar="S", help="how long to wait for the model node")
    parser.add_argument("--node", type=ros_name, default="model", help="name of the model node (default: model)")
    parser.add_argument("--arm", action="store_true", help="arm the robot first")
    parser.add_argument("--csv", type=output_file, metavar="FILE", help="write the odometry that was received")


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Play the sequence to its end."""
    check_seconds(options, "wait", LONGEST_S)
    manoeuvre = _manoeuvre(options.what)
    document, text, warning = run_in_worker(lambda worker: _play(options, manoeuvre, worker))
    sys.stderr.write(warning)
    print_found(options, document, text)
    return 0


def _play(options: argparse.Namespace, manoeuvre: Manoeuvre, worker: Worker) -> None:
    player = Player(manoeuvre)
    with (
        ros_node("sequence_control", options.namespace, options.ros_arguments) as node,
        steady_executor(node) as executor,
        worker.reporting(),
    ):
        commander = Commander(node, executor, options.node, worker.stopped)
        commander.wait_for_robot(options.wait, arm=options.arm)
        commander.play(player, _show_progress, options.wait)
        graph = connections(node, node.get_namespace())
        if options.csv is not None:
            if player.missing:
                raise SequenceError(
                    f"the odometry of {player.missing} cycles was lost, and {options.csv} was not written: "
                    f"{commander.loss}; the robot played the sequence to its end, and its own log has all of them"
                )
            write_csv(options.csv, Odometry._fields, player.received)
        worker.finish(_found(player, [asdict(c) for c in graph], commander))


def _manoeuvre(what: list[str]) -> Manoeuvre:
    if len(what) == 1:
        return load_manoeuvre(what[0])
    if len(what) != _THREE:
        raise ConfigurationError("give LINEAR ANGULAR DURATION, or one file")
    try:
        linear, angular, duration = map(plain_number, what)
    except ValueError as error:
        raise ConfigurationError(f"LINEAR ANGULAR DURATION must be numbers: {error}") from error
    return single_segment(linear, angular, duration)


def _show_progress(fraction: float) -> None:
    if sys.stderr.isatty():
        done = round(fraction * _BAR)
        end = "\n" if fraction >= 1.0 else ""
        sys.stderr.write(f"\r[{'#' * done}{'.' * (_BAR - done)}] {fraction:4.0%}{end}")
        sys.stderr.flush()


def _found(player: Player, graph: list[dict[str, str]], commander: Commander) -> tuple[dict[str, object], str, str]:
    """What to print: the JSON document, the text instead of it, and the warning on standard error, if any."""
    last = next((odometry for odometry in reversed(player.received) if odometry.stamp_ns == player.end_ns), None)
    if last is None:
        raise SequenceError(
            f"the odometry of the last cycle was lost: {commander.loss}; the robot played the sequence to its end, and "
            "its own log has where it came to"
        )
    seconds = ((player.end_ns or 0) - (player.start_ns or 0)) * 1e-9  # as driven, in whole cycles
    took_s = max(commander.took_s, seconds)  # less is counted where this process was stopped
    document: dict[str, object] = {
        "start_ns": player.start_ns,
        "end_ns": player.end_ns,
        "took_s": round(took_s, 3),
        "end": last._asdict(),
        "graph": graph,
    }
    text = f"after {seconds:g} s at x {last.x:.4f} m, y {last.y:.4f} m, heading {last.heading:.4f} rad\n"
    return document, text, _lateness(seconds, took_s)


def _lateness(seconds: float, took_s: float) -> str:
    if took_s - seconds <= _LATE_S:
        return ""
    return (
        f"segway-ecc: the sequence took {took_s:.1f} s instead of {seconds:g} s: the robot's loop was late, or its "
        "messages were; it drove all of it, and its stamps count cycles\n"
    )
