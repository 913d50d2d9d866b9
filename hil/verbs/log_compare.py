# SPDX-License-Identifier: MIT
"""`segway-ecc log compare LOG`: a recorded run beside the simulation of the same commands.

A robot that balances falls at once where its commands are given to a plant that differs in the least. It is simulated
in windows, each of which begins in the logged motion.

Exit codes: 0 compared; 2 arguments; 3 the plant cannot be loaded; 8 the robot file in the log names no plant, or one
that does not fit; 9 the log cannot be read or has no commands, or pieces of it are missing or damaged (what is there
is compared).
"""

import argparse
import sys
from pathlib import Path
from typing import Final

from segway_ecc.hil.comparison import report
from segway_ecc.hil.comparison.compare import DEFAULT_WINDOW_S, compare
from segway_ecc.hil.comparison.logged import read_run
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.progress import show_progress
from segway_ecc.hil.verbs.proofs import claims_out, write_report
from segway_ecc.node.cli.options import add_json, drawing_file, output_folder, print_found
from segway_ecc.node.cli.panels import Signal, draw_panels
from segway_ecc.node.errors import ConfigurationError, RecordingError
from segway_ecc.node.models.load import load_model, locate, locate_recorded

_LONGEST_S: Final = 1e6
_LONGEST_DELAY_MS: Final = 100.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `compare`."""
    parser.add_argument("log", type=Path, metavar="LOG", help="the log of a run (MCAP); of several files, the first")
    parser.add_argument("--plant", metavar="SOURCE", help="another plant, in place of the one in the log's robot file")
    parser.add_argument(
        "--window",
        type=float,
        metavar="S",
        help=f"simulate in pieces of this length (default: {DEFAULT_WINDOW_S:g} where the robot balances, else all)",
    )
    parser.add_argument(
        "--delay", type=float, metavar="MS", help="of the commands (default: the one with which least differs)"
    )
    parser.add_argument("--begin", type=float, default=0.0, metavar="S", help="leave out what comes before")
    parser.add_argument("--end", type=float, default=_LONGEST_S, metavar="S", help="leave out what comes after")
    parser.add_argument("--plot", type=drawing_file, metavar="FILE", help="draw both, signal by signal (PNG, SVG)")
    parser.add_argument(
        "--out", type=output_folder, metavar="FOLDER", help="write the report there, and the figures as JSON"
    )
    add_json(parser)


@claims_out
def run(options: argparse.Namespace) -> int:
    """Compare, and print the residuals."""
    _check_ranges(options)
    run = read_run(options.log, options.begin, options.end)
    if run.file.simulation is None and options.plant is None:
        raise NoSimulationError(
            f"robot '{run.file.name}' has no plant in {options.log}: name one with --plant, or record with "
            "simulation.plant in the robot file"
        )
    folders = (options.log.resolve().parent, Path())
    parameters = {} if run.file.simulation is None else run.file.simulation.parameters
    if options.plant is not None:
        source = locate(options.plant, folders)
    elif run.file.simulation is not None:
        source = locate_recorded(run.file.simulation.plant, folders)
    with show_progress("compare") as on_progress:
        delay_s = None if options.delay is None else options.delay * 1e-3
        found = compare(run, load_model(source, parameters), options.window, delay_s, on_progress)
    if options.plot is not None:
        times, drawn = report.curves(found)
        signals = [Signal(name, unit, [logged.tolist(), now.tolist()]) for name, unit, logged, now in drawn]
        draw_panels(options.plot, times.tolist(), signals, ("logged", "simulated"))
    for damage in run.damage:
        sys.stderr.write(f"segway-ecc: {damage}\n")
    document = report.document(found)
    print_found(options, document, report.text(found))
    write_report(options.out, "compare", document, lambda: {"report.html": report.render(found)})
    return RecordingError.exit_code if run.damage else 0


def _check_ranges(options: argparse.Namespace) -> None:
    """Refuse times that are out of range.

    Raises:
        ConfigurationError: One is.
    """
    if options.window is not None and not 0.0 < options.window <= _LONGEST_S:
        raise ConfigurationError(f"--window must be more than 0 s and at most {_LONGEST_S:g} s")
    if options.delay is not None and not 0.0 <= options.delay <= _LONGEST_DELAY_MS:
        raise ConfigurationError(f"--delay must be 0 to {_LONGEST_DELAY_MS:g} ms")
    if not 0.0 <= options.begin < options.end:
        raise ConfigurationError("--begin must be 0 s or more, and less than --end")
