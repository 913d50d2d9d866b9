# SPDX-License-Identifier: MIT
"""`segway-ecc prove growth`: what a cycle costs as the robot grows, and where that stops being linear."""

import argparse
import os
import platform
import sys
import time

import msgspec

from segway_ecc.hil.growth.study import QUICK, SIZES, conduct, figure, render, text, verdict
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.proofs import add_study, claims_out, write_report
from segway_ecc.node.cli.options import print_found
from segway_ecc.node.ros.runtime import missing_packages


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `prove growth`."""
    add_study(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Conduct the study, print its tables and write its report."""
    begun_s = time.monotonic()
    with show_progress("growth") as on_progress:
        found = conduct(QUICK if options.quick else SIZES, on_progress)
    took_s = time.monotonic() - begun_s

    def draw() -> dict[str, str | bytes]:
        facts = {
            "Machine": f"{platform.machine()}, {len(os.sched_getaffinity(0))} processors, Linux {platform.release()}",
            "Python": platform.python_version(),
            "Time": f"{took_s:.1f} s",
        }
        return {"growth.html": render(found, facts), "growth.svg": figure(found)}

    write_report(options.out, "growth", found, draw)
    document = {"growth": msgspec.to_builtins(found), "verdicts": [verdict(grown) for grown in found]}
    print_found(options, document, text(found))
    sys.stderr.write(f"segway-ecc: the study took {took_s:.1f} s\n")
    if missing_packages() and not options.quick:
        sys.stderr.write("segway-ecc: ROS 2 is not available here: no subscribers, and no robots side by side\n")
    return 0
