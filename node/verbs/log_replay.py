"""`segway-ecc log replay LOG`: a recorded run through the same model and safety code again, compared to the last bit.

Exit codes: 0 every cycle in the log is identical; 1 one differs; 2 arguments; 3 the model cannot be loaded; 9 the log
cannot be read or replayed, or cycles are missing in it (those before them are identical).
"""

import argparse
import dataclasses
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.cli.options import add_json, print_json
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import ConfigurationError, RecordingError
from segway_ecc.node.replay.log import RecordedRun
from segway_ecc.node.replay.replay import Outcome, replay

_DIFFERS: Final = 1
_AHEAD: Final = "  "


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `replay`."""
    parser.add_argument("log", type=Path, metavar="LOG", help="the log of a run (MCAP); of several files, the first")
    parser.add_argument("--model", metavar="SOURCE", help="where the model is now, in place of where it was")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw commands as recorded and as computed (PNG, SVG)"
    )
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Replay, and tell what came of it."""
    names = RecordedRun(options.log).layout.commands
    drawing = None if options.plot is None else _Drawing(options.plot, names)
    outcome = replay(options.log, options.model, None if drawing is None else drawing.look)
    if drawing is not None:
        drawing.write()
    for warning in _warnings(outcome):
        sys.stderr.write(f"segway-ecc: {warning}\n")
    if options.json:
        print_json(_document(outcome))
    else:
        sys.stdout.write("\n".join(_lines(outcome, names)) + "\n")
    if outcome.difference is not None:
        return _DIFFERS
    return RecordingError.exit_code if outcome.gap is not None or outcome.cycles == 0 else 0


def _warnings(outcome: Outcome) -> list[str]:
    said = []
    if outcome.is_other_model:
        said.append("the model is not the one that ran: its files have another content")
    if outcome.gap is not None:
        said.append(f"{outcome.gap}: replayed up to there")
    elif outcome.is_cut:
        said.append("the log ends before its time, as after a power cut: replayed up to there")
    return said


def _lines(outcome: Outcome, names: Sequence[str]) -> list[str]:
    difference = outcome.difference
    if difference is None:
        return [f"identical: {outcome.cycles} cycles, {outcome.duration_s:.3f} s"]
    lines = [
        str(difference),
        *(f"{_AHEAD}also {other.port}: {other.recorded}, {other.computed}" for other in outcome.others),
    ]
    lines += [f"{outcome.cycles} cycles before it are identical", "", f"commands: {', '.join(names)}"]
    lines += [f"{_AHEAD}{_row(recorded, computed)}" for recorded, computed in outcome.around]
    return lines


def _row(recorded: CycleRecord, computed: CycleRecord) -> str:
    return (
        f"{recorded.cycle}: recorded {recorded.mode} {_numbers(recorded.commands)}, "
        f"computed {computed.mode} {_numbers(computed.commands)}"
    )


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.9g}" for value in values)


def _document(outcome: Outcome) -> dict[str, object]:
    return {
        "identical": outcome.is_identical,
        "cycles": outcome.cycles,
        "duration_s": outcome.duration_s,
        "difference": None if outcome.difference is None else outcome.difference._asdict(),
        "others": [other._asdict() for other in outcome.others],
        "gap": outcome.gap,
        "cut": outcome.is_cut,
        "other_model": outcome.is_other_model,
    }


@dataclasses.dataclass(slots=True)
class _Drawing:
    """Commands over time, as recorded and as computed."""

    path: Path
    names: Sequence[str]
    times: list[float] = dataclasses.field(default_factory=list)
    recorded: list[Sequence[float]] = dataclasses.field(default_factory=list)
    computed: list[Sequence[float]] = dataclasses.field(default_factory=list)

    def look(self, recorded: CycleRecord, computed: CycleRecord) -> None:
        """Take one cycle."""
        self.times.append(recorded.start_ns * 1e-9)
        self.recorded.append(recorded.commands)
        self.computed.append(computed.commands)

    def write(self) -> None:
        """Draw the file."""
        if importlib.util.find_spec("matplotlib") is None:
            raise ConfigurationError("--plot needs a drawing library: install 'segway-ecc[report]'")
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra that the rest of this verb does without

        figure = Figure(figsize=(8, 1.2 + 1.8 * len(self.names)), layout="constrained")
        panels = figure.subplots(max(len(self.names), 1), 1, sharex=True, squeeze=False)[:, 0]
        times = [time - self.times[0] for time in self.times]
        for index, (panel, name) in enumerate(zip(panels, self.names, strict=False)):
            panel.plot(times, [values[index] for values in self.recorded], linewidth=2.5, label="recorded")
            panel.plot(times, [values[index] for values in self.computed], linewidth=1.0, label="computed")
            panel.set_ylabel(name)
            panel.grid(visible=True)
            panel.legend()
        panels[-1].set_xlabel("time, s")
        try:
            figure.savefig(self.path)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"cannot draw {self.path}: {error}") from error
