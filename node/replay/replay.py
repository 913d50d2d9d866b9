# SPDX-License-Identifier: MIT
"""A log fed to the same model and safety code; every command, port and mode compared."""

import struct
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import replace

from segway_ecc.node.cycle.cycle import Cycle
from segway_ecc.node.cycle.interfaces import MODEL_CALL, CycleRecord, NoRecorder
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.errors import ModelFailedError
from segway_ecc.node.model.model import Model, write_variable
from segway_ecc.node.models.load import load_model, locate, locate_recorded
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.recording.robot_provenance import model_hash
from segway_ecc.node.replay.recorded import RecordedRobot, RecordedRun
from segway_ecc.node.robot import Robot

_BEFORE: Final = 5
_AFTER: Final = 5
_NS: Final = 1e-9


class Difference(NamedTuple):
    """What differs in a cycle: a command, a model's port or the mode; the time is since the first cycle."""

    cycle: int
    time_s: float
    port: str
    recorded: str
    computed: str

    def __str__(self) -> str:
        return (
            f"cycle {self.cycle} (t = {self.time_s:.3f} s): {self.port} {self.recorded} was recorded, "
            f"{self.computed} is computed"
        )


@dataclass(slots=True)
class Outcome:
    """What came of a replay.

    Attributes:
        cycles: How many were compared.
        duration_s: From the first to the last of them, s.
        difference: The first; None where all is identical.
        others: What else differs in that cycle.
        around: The cycles around the difference: as recorded and as computed.
        gap: What is missing in the log, where the replay had to stop: the model's state is not known behind it; None
            where nothing is.
        behind: How many cycles are in the log behind the gap, and were not compared.
        missing: The cycles that are missing, each time the first and the last of them.
        damage: What is damaged in the log's files.
        is_cut: Whether the log ends before its time; what came before was compared all the same.
        is_other_model: Whether the model is not the one that ran.
    """

    cycles: int = 0
    duration_s: float = 0.0
    difference: Difference | None = None
    others: Sequence[Difference] = ()
    around: list[tuple[CycleRecord, CycleRecord]] = field(default_factory=list)
    gap: str | None = None
    behind: int = 0
    missing: Sequence[tuple[int, int]] = ()
    damage: Sequence[str] = ()
    is_cut: bool = False
    is_other_model: bool = False

    @property
    def is_identical(self) -> bool:
        """Whether every cycle came out as recorded, and there was one."""
        return self.difference is None and self.cycles > 0

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing or damaged in the log."""
        return self.gap is None and not self.damage and not self.is_cut


def replay(
    path: Path, model: str | None = None, look: Callable[[CycleRecord, CycleRecord], None] | None = None
) -> Outcome:
    """Replay a log up to the first difference.

    Args:
        path: The log; of a run in several files, the first.
        model: The model's source in place of the one that the log names, where it has moved.
        look: Called with each cycle, as recorded and as computed.

    Raises:
        RecordingError: The log cannot be read, or is none of a run.
        ModelError: The model cannot be loaded.
    """
    run = RecordedRun(path)
    recorded = RecordedRobot(run.layout)
    robot = _build(run, recorded, model)
    loaded = robot.model
    outcome = Outcome(is_other_model=run.model_hash != model_hash(robot.file.model.source))
    keeper = _Keeper()
    cycle = robot.cycle(recorded, keeper)
    last: deque[tuple[CycleRecord, CycleRecord]] = deque(maxlen=_BEFORE)
    first_ns, after = 0, 0
    for count, record in enumerate(run.cycles_before_gap()):
        recorded.pass_to(record)
        if outcome.difference is not None:
            after += 1
            if after > _AFTER:
                break
        answered_otherwise = list[tuple[str, str, str]]()
        try:
            if count == 0:
                first_ns = record.start_ns
                cycle.start()
            answered_otherwise += _run_again(cycle, loaded, record)
        except ModelFailedError as error:
            if all(answer.call != MODEL_CALL for answer in record.answers):
                time_s = (record.start_ns - first_ns) * _NS
                failed = Difference(record.cycle, time_s, "model", "a step", str(error))
                outcome.difference = outcome.difference or failed
                break
        pair = record, keeper.record
        if look is not None:
            look(*pair)
        if outcome.difference is not None:
            outcome.around.append(pair)
            continue
        outcome.duration_s = (record.start_ns - first_ns) * _NS
        what_differs = (*answered_otherwise, *differences(run.layout, *pair))
        found = [Difference(record.cycle, outcome.duration_s, *what) for what in what_differs]
        last.append(pair)
        if found:
            outcome.difference, *outcome.others = found
            outcome.around = list(last)
        else:
            outcome.cycles += 1
    outcome.gap, outcome.behind, outcome.missing = run.gap, run.behind, run.missing
    outcome.damage, outcome.is_cut = run.damage, run.is_cut
    return outcome


def _build(run: RecordedRun, recorded: RecordedRobot, model: str | None) -> Robot:
    """The robot that ran, with the model that is there now."""
    folders = (run.path.resolve().parent, Path())
    source = locate_recorded(run.robot.model.source, folders) if model is None else locate(model, folders)
    section = replace(run.robot.model, source=source)
    loaded = load_model(section.source, section.parameters, method=section.method, step_size=section.step_size)
    file = replace(run.robot, model=section)
    return Robot(file, loaded, recorded, wire(loaded, recorded, file.wiring), recorded)


def _run_again(cycle: Cycle, model: Model, record: CycleRecord) -> list[tuple[str, str, str]]:
    """Run a cycle with what was written before it; returns the writes that the model answers otherwise now."""
    otherwise = []
    for name, value, refusal in record.inbox.written if record.inbox is not None else ():
        now = write_variable(model, name, value)
        if bool(now) is not bool(refusal):
            otherwise.append((f"write of {name}", refusal or "accepted", now or "accepted"))
    # The line of stamps is a clock's matter: it lies where it lay.
    cycle.time_base.anchor(record.cycle, record.stamp_ns)
    cycle.run(record.cycle, record.lateness_ns)
    return otherwise


class _Keeper(NoRecorder):
    """Keeps the newest cycle."""

    record: CycleRecord

    def write(self, record: CycleRecord) -> None:
        """Keep it, with copies of what may change."""
        self.record = replace(record, u=tuple(record.u), y=tuple(record.y), commands=tuple(record.commands))


def differences(layout: CycleLayout, recorded: CycleRecord, computed: CycleRecord) -> Iterator[tuple[str, str, str]]:
    """What differs between a cycle as recorded and as computed: the port and both values; commands first."""
    pairs = (
        ("command", layout.commands, recorded.commands, computed.commands),
        ("model input", layout.inputs, recorded.u, computed.u),
        ("model output", layout.outputs, recorded.y, computed.y),
        ("set-point", recorded.setpoint._fields, recorded.setpoint, computed.setpoint),
        ("published", layout.published, recorded.published, computed.published),
    )
    for kind, names, old, new in pairs:
        if same(old, new):
            continue
        for name, a, b in zip(names, old, new, strict=True):
            if not same((a,), (b,)):
                yield f"{kind} {name}", repr(float(a)), repr(float(b))
    failure, failure_now = (
        next((answer.reasons[0] for answer in record.answers if answer.call == MODEL_CALL), "")
        for record in (recorded, computed)
    )
    if bool(failure) is not bool(failure_now):
        yield "model", failure or "a step", failure_now or "a step"
    if recorded.mode is not computed.mode:
        yield "mode", str(recorded.mode), str(computed.mode)


def same(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether numbers are the same bit for bit; what is not a number is the same as what is none."""
    if len(a) != len(b):
        return False
    layout = struct.Struct(f"{len(a)}d")
    if layout.pack(*a) == layout.pack(*b):
        return True
    pairs = zip(a, b, strict=True)
    return all((x != x and y != y) or struct.pack("d", x) == struct.pack("d", y) for x, y in pairs)  # noqa: PLR0124 - NaN
