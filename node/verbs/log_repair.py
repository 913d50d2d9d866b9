# SPDX-License-Identifier: MIT
"""`segway-ecc log repair LOG`: a whole log, with summary and index, of what is left of one.

Exit codes: 0 all that was written is in it, or the log is whole already; 2 arguments; 9 pieces of the log are damaged
and left out, or it cannot be read or written.
"""

import argparse
import sys
from pathlib import Path

from segway_ecc.node.cli.options import add_json, print_found
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.salvage import Salvage, repair_log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `repair`."""
    parser.add_argument("log", type=Path, metavar="LOG", help="the log (MCAP); of several files, one")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the whole log (default: LOG.whole.mcap beside it)")
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Repair, and report what is missing."""
    source = Salvage(options.log)
    out, count = options.out or options.log.with_suffix(".whole.mcap"), 0
    if not source.is_whole:
        count = repair_log(source, out)
    for text in source.damage:
        sys.stderr.write(f"segway-ecc: {text}\n")
    if source.is_cut:
        sys.stderr.write("segway-ecc: the log ends before its time, as after a power cut\n")
    file = None if source.is_whole else str(out)
    document = {"file": file, "messages": count, "damage": source.damage, "cut": source.is_cut}
    print_found(options, document, "the log is whole\n" if source.is_whole else f"{out}: {count} messages\n")
    return RecordingError.exit_code if source.damage else 0
