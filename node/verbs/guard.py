# SPDX-License-Identifier: MIT
"""`segway-ecc guard ROBOT`: disables the drives when the node's heartbeats stop, whatever became of it."""

import argparse
import gc
from typing import Final

from segway_ecc.firmware_io.build import guard_link
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.guard.guard import Guard, describe, stopper_of
from segway_ecc.firmware_io.guard.watch import LIMIT_NS, Watch
from segway_ecc.firmware_io.heartbeat import HeartbeatListener
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.options import add_json, add_robot, print_found, real_time, robot_file, stopped_by_signals
from segway_ecc.node.config import NoHardwareSection
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.logs import messages

_LIMITS_S: Final = (0.01, 0.2)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `guard`."""
    add_robot(parser)
    add_json(parser)
    default = LIMIT_NS / 1e9
    text = f"heartbeats silent for longer have stopped; at least three periods of the loop (default {default:g})"
    parser.add_argument("--limit", type=float, default=default, metavar="S", help=text)


@ends_at_once()
def run(options: argparse.Namespace) -> int:
    """Guard the robot until stopped."""
    file, clock = robot_file(options), RealClock()
    if isinstance(file.hardware, NoHardwareSection):
        raise ConfigurationError(f"robot '{file.name}' has no drives: there is nothing to guard")
    if not _LIMITS_S[0] <= options.limit <= _LIMITS_S[1]:
        raise ConfigurationError(f"--limit must be from {_LIMITS_S[0]:g} to {_LIMITS_S[1]:g} s")
    watch = Watch(stopper_of(file.hardware), clock.now_ns(), round(options.limit * 1e9))
    link, beats = guard_link(file.hardware, clock), HeartbeatListener(file.hardware.line)
    guard = Guard(link, beats, watch, clock)
    gc.collect()
    gc.freeze()
    with messages(), stopped_by_signals(guard.stop), real_time():
        guard.run()
    wall_ns = clock.wall_ns() - clock.now_ns()
    interventions = []
    for each in watch.interventions:  # stamps on the wall clock, ns, by what it leads the monotonic one
        last_ns = each.last_alive_ns
        interventions.append(
            {
                "cause": each.cause,
                "last_heartbeat_wall_ns": None if last_ns is None else last_ns + wall_ns,
                "first_stop_wall_ns": each.first_ns + wall_ns,
                "reaction_ms": None if last_ns is None else (each.first_ns - last_ns) * 1e-6,
                "lasted_ms": (each.last_ns - each.first_ns) * 1e-6,
                "frames": each.frames,
                "end": each.end,
            }
        )
    document = {
        "bus": link.description,
        "limit_s": options.limit,
        "frames": link.counters.received,
        "commands": watch.commands,
        "strange_commands": watch.strange,
        "heartbeats": watch.heartbeats,
        "refused_heartbeats": beats.refused,
        "longest_gap_ms": watch.longest_gap_ns * 1e-6,
        "intervened": watch.intervened,
        "interventions": interventions,
    }
    rows = {
        "frames": f"{link.counters.received}, {watch.commands} of them commands, {watch.strange} strange",
        "heartbeats": f"{watch.heartbeats}, and {beats.refused} refused",
        "longest gap": f"{watch.longest_gap_ns * 1e-6:.1f} ms while a drive followed",
        "intervened": str(watch.intervened),
        **{f"{n}": describe(intervention) for n, intervention in enumerate(watch.interventions, 1)},
    }
    print_found(options, document, rows)
    return 0
