# SPDX-License-Identifier: MIT
"""`segway-ecc log replay LOG`: a recorded run through the same model and safety code again, compared to the last bit.

Exit codes: 0 the log is whole and every cycle identical; 1 one differs; 2 arguments; 3 the model cannot be loaded, or
ends its process; 9 the log cannot be read or replayed, is damaged, lacks cycles or ends before its time (what was
compared is identical); 134 the model does not return from a call, else 128 + N as it crashes by signal N.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.cli.options import add_json, drawing_file, print_found
from segway_ecc.node.cli.panels import Signal, draw_panels
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.signals import axis_unit
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.replay.replay import Outcome, replay
from segway_ecc.node.watchdog.apart import run_apart
from segway_ecc.node.watchdog.watchdog import model_watchdog

_DIFFERS: Final = 1
_AHEAD: Final = "  "
_NS: Final = 1e-9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `replay`."""
    parser.add_argument("log", type=Path, metavar="LOG", help="the log of a run (MCAP); of several files, the first")
    parser.add_argument("--model", metavar="SOURCE", help="where the model is now, in place of where it was")
    parser.add_argument(
        "--plot",
        type=drawing_file,
        metavar="FILE",
        help="draw commands, or the outputs of a model that sends none, as recorded and as computed (PNG, SVG)",
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Replay, and report the outcome."""
    log = RecordedRun(options.log)
    names, source = log.layout.commands, options.model or log.robot.model.source
    outcome, pairs = run_apart(lambda: _replay_watched(options, source))
    if pairs:
        times = [(recorded.start_ns - pairs[0][0].start_ns) * _NS for recorded, _ in pairs]
        draw_panels(options.plot, times, _drawn(log.layout, outcome.units, pairs), ("recorded", "computed"))
    warnings = ["the model is not the one that ran: its files have another content"] if outcome.is_other_model else []
    warnings += outcome.damage
    if not outcome.cycles and not outcome.behind and outcome.difference is None:
        warnings.append("there is no cycle in the log")
    warnings += [] if outcome.gap is None else [outcome.gap]
    warnings += [f"cycles {first} to {last} are missing too" for first, last in outcome.missing[1:]]
    if outcome.behind:
        known = "the state is not known before the next snapshot"
        warnings.append(f"{outcome.behind} cycles are whole and could not be compared: {outcome.refusal or known}")
    elif outcome.refusal:
        warnings.append(f"snapshots of the state were not compared: {outcome.refusal}")
    if outcome.is_cut:
        warnings.append("the log ends before its time, as after a power cut or a killed node: replayed up to there")
    if options.plot is not None and not pairs:
        warnings.append(f"nothing was compared, so {options.plot} is not drawn")
    for warning in warnings:
        sys.stderr.write(f"segway-ecc: {warning}\n")
    document = {
        "identical": outcome.is_identical,
        "cycles": outcome.cycles,
        "stretches": outcome.stretches,
        "duration_s": outcome.duration_s,
        "difference": None if outcome.difference is None else outcome.difference._asdict(),
        "others": [other._asdict() for other in outcome.others],
        "gap": outcome.gap,
        "behind": outcome.behind,
        "refusal": outcome.refusal,
        "missing": outcome.missing,
        "damage": outcome.damage,
        "cut": outcome.is_cut,
        "other_model": outcome.is_other_model,
    }
    print_found(options, document, "\n".join(_lines(outcome, names)) + "\n")
    if outcome.difference is not None:
        return _DIFFERS
    return 0 if outcome.is_whole and outcome.cycles else RecordingError.exit_code


def _replay_watched(options: argparse.Namespace, source: str) -> tuple[Outcome, list[tuple[CycleRecord, CycleRecord]]]:
    """The outcome, and the cycles where they are to be drawn."""
    pairs: list[tuple[CycleRecord, CycleRecord]] = []

    def keep(recorded: CycleRecord, computed: CycleRecord) -> None:
        pairs.append((recorded, computed))

    with model_watchdog(source) as watchdog:
        return replay(options.log, options.model, None if options.plot is None else keep, watchdog), pairs


def _drawn(
    layout: CycleLayout, units: Mapping[str, str], pairs: Sequence[tuple[CycleRecord, CycleRecord]]
) -> list[Signal]:
    """What is drawn: the commands, else what the model gives; `units` are those of its outputs, by name."""
    if layout.commands:
        names, values = layout.commands, [(was.commands, now.commands) for was, now in pairs]
        units = {name: axis_unit(name) for name in names}
    else:
        names, values = layout.outputs, [(was.y, now.y) for was, now in pairs]
    return [
        Signal(name, units.get(name, ""), [[pair[layer][index] for pair in values] for layer in range(2)])
        for index, name in enumerate(names)
    ]


def _lines(outcome: Outcome, names: Sequence[str]) -> list[str]:
    difference = outcome.difference
    if difference is None:
        compared = [f"{first} to {last}" for first, last in outcome.stretches]
        if not compared:
            return ["nothing was compared"]
        where = [] if outcome.gap is None else [f"compared: cycles {', '.join(compared)}"]
        return [f"identical: {outcome.cycles} cycles, {outcome.duration_s:.3f} s", *where]
    lines = [
        str(difference),
        *(f"{_AHEAD}also {other.port}: {other.recorded}, {other.computed}" for other in outcome.others),
    ]
    lines += [f"{outcome.cycles} cycles before it are identical", "", f"commands: {', '.join(names)}"]
    for recorded, computed in outcome.around:
        was, now = (
            f"{each.mode} {', '.join(f'{value:.9g}' for value in each.commands)}" for each in (recorded, computed)
        )
        lines.append(f"{_AHEAD}{recorded.cycle}: recorded {was}, computed {now}")
    return lines
