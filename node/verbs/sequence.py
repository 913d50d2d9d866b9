# SPDX-License-Identifier: MIT
"""`segway-ecc sequence`: sequence control, a node of its own."""

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Final

from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, add_namespace, print_found, stopped_by_signals, write_csv
from segway_ecc.node.errors import ConfigurationError, SequenceError
from segway_ecc.node.ros.commander import Commander
from segway_ecc.node.ros.runtime import connections, ros_node
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Odometry, Player, load_manoeuvre, single_segment

_THREE: Final = 3
_BAR: Final = 30


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
    parser.add_argument("--node", default="model", help="name of the model node (default: model)")
    parser.add_argument("--arm", action="store_true", help="arm the robot first")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the odometry that was received")


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Play the sequence to its end."""
    player = Player(_manoeuvre(options.what))
    stop: list[str] = []
    with (
        stopped_by_signals(stop.append),
        ros_node("sequence_control", options.namespace, options.ros_arguments) as node,
    ):
        commander = Commander(node, options.node, lambda: stop[0] if stop else None)
        commander.wait_for_robot(options.wait, arm=options.arm)
        commander.play(player, _show_progress, options.wait)
        graph = connections(node, node.get_namespace())
    if options.csv is not None:
        if player.missing:
            raise SequenceError(
                f"the odometry of {player.missing} cycles was lost on the way, and {options.csv} was not written: this "
                "machine is too busy; the robot's own log has all of them"
            )
        write_csv(options.csv, Odometry._fields, player.received)
    _report(options, player, [asdict(c) for c in graph])
    return 0


def _manoeuvre(what: list[str]) -> Manoeuvre:
    if len(what) == 1:
        return load_manoeuvre(what[0])
    if len(what) != _THREE:
        raise ConfigurationError("give LINEAR ANGULAR DURATION, or one file")
    try:
        linear, angular, duration = map(float, what)
    except ValueError as error:
        raise ConfigurationError(f"LINEAR ANGULAR DURATION must be numbers: {error}") from error
    return single_segment(linear, angular, duration)


def _show_progress(fraction: float) -> None:
    if sys.stderr.isatty():
        done = round(fraction * _BAR)
        end = "\n" if fraction >= 1.0 else ""
        sys.stderr.write(f"\r[{'#' * done}{'.' * (_BAR - done)}] {fraction:4.0%}{end}")
        sys.stderr.flush()


def _report(options: argparse.Namespace, player: Player, graph: list[dict[str, str]]) -> None:
    last = next((odometry for odometry in reversed(player.received) if odometry.stamp_ns == player.end_ns), None)
    if last is None:
        raise SequenceError("the odometry of the last cycle was lost on the way: this machine is too busy; try again")
    document = {"start_ns": player.start_ns, "end_ns": player.end_ns, "end": last._asdict(), "graph": graph}
    seconds = player.manoeuvre.duration_ns * 1e-9
    text = f"after {seconds:g} s at x {last.x:.4f} m, y {last.y:.4f} m, heading {last.heading:.4f} rad\n"
    print_found(options, document, text)
