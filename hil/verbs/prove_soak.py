# SPDX-License-Identifier: MIT
"""`segway-ecc prove soak`: long runs, in lock step and in real time; memory, files and threads must not grow."""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from segway_ecc.hil.progress import OnProgress, show_progress
from segway_ecc.hil.soak import real_time, simulated
from segway_ecc.hil.soak.watching import WARM_UP, Series, Verdict, Watching, figure, judge
from segway_ecc.hil.text_table import aligned
from segway_ecc.hil.verbs.proofs import add_packaged_robot, claims_out, write_report
from segway_ecc.node.cli.options import add_json, output_folder, print_json
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.ros.runtime import missing_packages

ROBOT: Final = "segway"
_SIMULATED_H: Final = 4.0
_REAL_MIN: Final = 30.0
_FRAME_LOSS: Final = 0.01
_SAMPLES: Final = 360
_MOST_EVERY_S: Final = 5.0
_LEAST_SIMULATED_S: Final = 600.0
_LEAST_REAL_S: Final = 120.0
"""In less the warm-up is not over."""
_DRIVEN: Final = 0.9
"""Share of the messages of its mode in which a robot is driving: one that stands in FAULT proves little."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `soak`."""
    add_packaged_robot(parser, ROBOT)
    parser.add_argument(
        "--simulated", type=float, default=_SIMULATED_H, metavar="H", help="simulated hours; 0 for none (default: 4)"
    )
    parser.add_argument(
        "--real-time",
        type=float,
        default=_REAL_MIN,
        metavar="MIN",
        help="minutes on the clock; 0 for none (default: 30)",
    )
    parser.add_argument("--out", type=output_folder, metavar="FOLDER", help="write soak.json and soak-*.svg there")
    add_json(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Run, watch and judge: 0 where nothing grew and nothing failed, else 1."""
    simulated_s, real_s = options.simulated * 3600.0, options.real_time * 60.0
    _check("--simulated", simulated_s, _LEAST_SIMULATED_S)
    _check("--real-time", real_s, _LEAST_REAL_S)
    if not simulated_s and not real_s:
        raise ConfigurationError("--simulated 0 and --real-time 0 leave nothing to run")
    document: dict[str, Any] = {}
    found: dict[str, Sequence[Series]] = {}
    for name, duration_s, soak in (("simulated", simulated_s, _simulated), ("real_time", real_s, _real_time)):
        if duration_s:
            begun_s = time.monotonic()
            with (
                tempfile.TemporaryDirectory(prefix="segway-ecc-soak-") as folder,
                show_progress(name.replace("_", " "), round(duration_s)) as on_progress,
            ):
                watching = Watching(Path(folder))
                part = soak(options.robot, duration_s, watching, on_progress)
            found[name] = watching.series
            verdicts = [judge(series) for series in found[name]]
            document[name] = part | {"took_s": time.monotonic() - begun_s, "verdicts": msgspec.to_builtins(verdicts)}
            if not options.json:
                sys.stdout.write(text(name.replace("_", " "), part, verdicts))

    def draw() -> dict[str, bytes | str]:
        return {f"soak-{name.replace('_', '-')}.svg": figure(series) for name, series in found.items()}

    write_report(options.out, "soak", {"found": document, "series": found}, draw)
    if options.json:
        print_json(options, document)
    return 1 if any(map(is_bad, document.values())) else 0


def is_bad(part: dict[str, Any]) -> bool:
    """Whether anything grew, or the robot did anything but drive."""
    return bool(part["failure"]) or any(verdict["is_growing"] for verdict in part["verdicts"])


def text(name: str, part: dict[str, Any], verdicts: Sequence[Verdict]) -> str:
    """A table of one part."""
    head_line = f"{name}: {part['duration_s'] / 60.0:g} min, {part['cycles']} cycles"
    head_line += f", {part['late']} late, {part['skipped']} skipped" if "late" in part else ""
    lines = [f"{head_line}; {part['failure'] or 'no fault'}"]
    head = ("process", "quantity", "at first", "at last", "largest", "growth", "allowed", "")
    lines += aligned([head, *map(_row, verdicts)])
    lines.append(f"growth is judged after the first {WARM_UP:.0%} of the time")
    return "\n  ".join(lines) + "\n"


def _row(verdict: Verdict) -> tuple[str, ...]:
    allowed = "-" if verdict.allowed is None else f"{verdict.allowed:g}"
    if verdict.most is not None:
        allowed = f"at most {verdict.most:g}"
    return (
        verdict.process,
        f"{verdict.quantity}{f', {verdict.unit}' if verdict.unit else ''}",
        f"{verdict.at_first:.6g}",
        f"{verdict.at_last:.6g}",
        f"{verdict.largest:.6g}",
        f"{verdict.growth:.4g}",
        allowed,
        "GROWS" if verdict.is_growing else "",
    )


def _simulated(robot: str, duration_s: float, watching: Watching, on_progress: OnProgress) -> dict[str, Any]:
    job = simulated.SimulatedSoak(robot, duration_s, _FRAME_LOSS, str(watching.folder / "soak.mcap"))
    ended = simulated.soak(job, watching, lambda s: on_progress(round(s), round(duration_s)))
    return {"duration_s": ended.time_s, "cycles": ended.cycles, "failure": ended.trip}


def _real_time(robot: str, duration_s: float, watching: Watching, on_progress: OnProgress) -> dict[str, Any]:
    ros = not missing_packages()
    run = real_time.RealTimeSoak(robot, duration_s, min(duration_s / _SAMPLES * 3.0, _MOST_EVERY_S), ros=ros)
    ran = real_time.soak(run, watching, lambda s: on_progress(round(s), round(duration_s)))
    driven = sum(count for mode, count in ran.modes.items() if mode.startswith("ARMED"))
    failure = ""  # a fault that was cleared is none: here it is growth that counts
    if ros and driven <= _DRIVEN * sum(ran.modes.values()):
        others = (f"{mode} ({count} times)" for mode, count in ran.modes.items() if not mode.startswith("ARMED"))
        failure = f"it seldom drove: {'; '.join(others) or 'no message of its mode arrived'}"
    return {
        "duration_s": duration_s,
        "ros": ros,
        **{name: ran.node[name] for name in ("cycles", "late", "overrun", "skipped", "mean_rate_hz")},
        "modes": ran.modes,
        "failure": failure,
    }


def _check(option: str, duration_s: float, least_s: float) -> None:
    if duration_s and not least_s <= duration_s <= 1e7:  # noqa: PLR2004 - four months
        raise ConfigurationError(f"{option} must be 0, or {least_s:g} s at least and four months at most")
