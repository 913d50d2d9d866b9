"""`segway-ecc study growth`: what a cycle costs as the robot grows, and where that stops being linear."""

import argparse
import os
import platform
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from node.cli.options import print_json
from node.cli.report_folder import has_figures, writing_to
from node.growth.study import QUICK, SIZES, Grown, conduct
from node.growth.table import text, verdict
from node.progress import show_progress
from node.ros.runtime import missing_packages


def run(options: argparse.Namespace) -> int:
    """Conduct the study, print its tables and write its report."""
    begun_s = time.monotonic()
    with show_progress("growth") as on_progress:
        found = conduct(QUICK if options.quick else SIZES, on_progress)
    took_s = time.monotonic() - begun_s
    if options.out is not None:
        _write(options.out, found, _facts(took_s))
    if options.json:
        print_json({"growth": msgspec.to_builtins(found), "verdicts": [verdict(grown) for grown in found]})
    else:
        sys.stdout.write(text(found))
    sys.stderr.write(f"segway-ecc: the study took {took_s:.1f} s\n")
    if missing_packages() and not options.quick:
        sys.stderr.write("segway-ecc: ROS 2 is not available here: no subscribers, and no robots side by side\n")
    return 0


def _facts(took_s: float) -> dict[str, str]:
    return {
        "Machine": f"{platform.machine()}, {len(os.sched_getaffinity(0))} processors, Linux {platform.release()}",
        "Python": platform.python_version(),
        "Time": f"{took_s:.1f} s",
    }


def _write(folder: Path, found: Sequence[Grown], facts: Mapping[str, str]) -> None:
    with writing_to(folder):
        (folder / "growth.json").write_bytes(msgspec.json.format(msgspec.json.encode(found)))
        if not has_figures():
            return
        from node.growth.report import figure, render  # noqa: PLC0415 - an extra that the rest of this verb does without

        (folder / "growth.html").write_text(render(found, facts), encoding="utf-8")
        (folder / "growth.svg").write_bytes(figure(found))
    sys.stderr.write(f"segway-ecc: report: {folder / 'growth.html'}\n")
