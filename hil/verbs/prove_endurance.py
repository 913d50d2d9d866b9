# SPDX-License-Identifier: MIT
"""`segway-ecc prove endurance`: hours of normal driving in lock step with lost frames: any trip is a false one."""

import argparse
import time
from collections.abc import Sequence
from typing import Any, Final

from segway_ecc.hil.endurance.endurance import EndurancePlan, Stretch, endure
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.proofs import add_count, add_packaged_robot, check_counts
from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ConfigurationError

ROBOT: Final = "segway"
_HOUR_S: Final = 3600.0
_MOST_HOURS: Final = 10_000.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `endurance`."""
    add_packaged_robot(parser, ROBOT)
    parser.add_argument("--hours", type=float, default=1.0, metavar="H", help="simulated hours in all (default: 1)")
    parser.add_argument(
        "--frame-loss", type=float, default=0.01, metavar="P", help="share of frames lost either way (default: 0.01)"
    )
    add_count(parser, "seeds", "robots that share the hours")
    add_count(parser, "jobs")
    parser.add_argument(
        "--channel", help="SocketCAN interface of robot and plant, theirs alone (default: a simulated bus)"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Drive, and print what was seen: 0 where nothing tripped, 1 where anything did."""
    if not 0.0 < options.hours <= _MOST_HOURS:
        raise ConfigurationError(f"--hours must be more than 0 and at most {_MOST_HOURS:g}, not {options.hours:g}")
    if not 0.0 <= options.frame_loss < 1.0:
        raise ConfigurationError(f"--frame-loss must be from 0 to less than 1, not {options.frame_loss:g}")
    check_counts(options, "seeds", "jobs")
    file, duration_s = load_robot(options.robot), options.hours * _HOUR_S
    plan = EndurancePlan(file, duration_s, options.frame_loss, options.seeds, channel=options.channel)
    begun_s = time.monotonic()
    total_s = round(plan.duration_s)
    with show_progress("driving, s", total_s) as on_progress:
        stretches = endure(plan, min(options.jobs, options.seeds), lambda s: on_progress(round(s), total_s))
    document = summary(stretches, time.monotonic() - begun_s)
    print_found(options, document, _rows(document))
    return 1 if document["trips"] else 0


def summary(stretches: Sequence[Stretch], took_s: float) -> dict[str, Any]:
    """What was seen, of all stretches together; `took_s` is how long they took."""
    simulated_s = sum(stretch.simulated_s for stretch in stretches)
    trips = [{"seed": s.seed, **s.trip._asdict()} for s in stretches if s.trip is not None]
    return {
        "simulated_hours": simulated_s / _HOUR_S,
        "cycles": sum(stretch.cycles for stretch in stretches),
        "trips": len(trips),
        "why": trips,
        "max_tilt_rad": max(stretch.max_tilt_rad for stretch in stretches),
        "max_velocity_error": max(stretch.max_velocity_error for stretch in stretches),
        "max_yaw_rate_error": max(stretch.max_yaw_rate_error for stretch in stretches),
        "frames": sum(stretch.frames for stretch in stretches),
        "frames_lost": sum(stretch.lost for stretch in stretches),
        "frames_refused": sum(stretch.refused for stretch in stretches),
        "times_real_time": simulated_s / took_s,
    }


def _rows(document: dict[str, Any]) -> dict[str, str]:
    lost, frames = document["frames_lost"], document["frames"]
    rows = {
        "simulated": f"{document['simulated_hours']:.2f} h, {document['cycles']} cycles",
        "trips": str(document["trips"]),
        "largest tilt": f"{document['max_tilt_rad']:.3f} rad",
        "largest error of velocity": f"{document['max_velocity_error']:.3f} m/s",
        "largest error of yaw rate": f"{document['max_yaw_rate_error']:.4f} rad/s",
        "frames lost": f"{lost} of {frames} ({lost / max(frames, 1):.2%})",
        "frames refused": str(document["frames_refused"]),
        "speed": f"{document['times_real_time']:.1f} times real time",
    }
    for place, trip in enumerate(document["why"], 1):
        rows[f"trip {place}"] = f"{trip['mode']} at {trip['at_s']:.3f} s, seed {trip['seed']}: {trip['reason']}"
    return rows
