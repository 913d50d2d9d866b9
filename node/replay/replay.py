# SPDX-License-Identifier: MIT
"""A log fed to the same model and safety code; every command, port and mode compared."""

import struct
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from msgspec.structs import replace

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.node.cycle.interfaces import MODEL_CALL, CycleRecord, NoRecorder
from segway_ecc.node.cycle.state import FAILURES, Snapshot, compare_snapshots, restore_snapshot
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.errors import ModelFailedError, RecordingError
from segway_ecc.node.model.declared import declared_variables
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.models.load import load_model, locate, locate_recorded
from segway_ecc.node.recording.layout import CycleLayout, surroundings
from segway_ecc.node.recording.robot_provenance import model_hash
from segway_ecc.node.replay.recorded import RecordedRobot, RecordedRun, writes_in
from segway_ecc.node.robot import Robot
from segway_ecc.node.watchdog.watchdog import ModelWatchdog, step_limit_s

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
        duration_s: From the log's first cycle to the last of them, s.
        difference: The first; None where all is identical.
        others: What else differs in that cycle.
        around: The cycles around the difference: as recorded and as computed.
        stretches: The cycles that were compared, each time the first and the last of them.
        gap: What is missing first in the log; None where nothing is.
        behind: How many cycles are in the log behind a gap and before the next snapshot, and were not compared.
        refusal: Why a snapshot could not be used; empty where all could.
        missing: The cycles that are missing, each time the first and the last of them.
        damage: What is damaged in the log's files.
        is_cut: Whether the log ends before its time; what came before was compared all the same.
        is_other_model: Whether the model is not the one that ran.
        units: Of the model's outputs, by name.
    """

    duration_s: float = 0.0
    stretches: list[tuple[int, int]] = field(default_factory=list)
    difference: Difference | None = None
    others: Sequence[Difference] = ()
    around: list[tuple[CycleRecord, CycleRecord]] = field(default_factory=list)
    gap: str | None = None
    behind: int = 0
    refusal: str = ""
    missing: Sequence[tuple[int, int]] = ()
    damage: Sequence[str] = ()
    is_cut: bool = False
    is_other_model: bool = False
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def cycles(self) -> int:
        """How many were compared, and were identical."""
        return sum(last - first + 1 for first, last in self.stretches)

    def add(self, cycle: int) -> None:
        """Add one to them."""
        first = self.stretches.pop()[0] if self.stretches and self.stretches[-1][1] == cycle - 1 else cycle
        self.stretches.append((first, cycle))

    @property
    def is_identical(self) -> bool:
        """Whether every cycle came out as recorded, and there was one."""
        return self.difference is None and self.cycles > 0

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing or damaged in the log."""
        return self.gap is None and not self.damage and not self.is_cut


def replay(
    path: Path,
    model: str | None = None,
    look: Callable[[CycleRecord, CycleRecord], None] | None = None,
    watchdog: ModelWatchdog | None = None,
) -> Outcome:
    """Replay a log up to the first difference; behind cycles that are missing, from the next snapshot of the state.

    Args:
        path: The log; of a run in several files, the first that is there.
        model: The model's source in place of the one that the log names, where it has moved.
        look: Called with each cycle, as recorded and as computed.
        watchdog: Watches the calls into the model.

    Raises:
        RecordingError: The log cannot be read, or is none of a run.
        ModelError: The model cannot be loaded.
    """
    run = RecordedRun(path)
    player = _Player(run, model, watchdog)
    outcome = Outcome()
    last: deque[tuple[CycleRecord, CycleRecord]] = deque(maxlen=_BEFORE)
    first_ns, after = None, 0
    for record in run.cycles():
        first_ns = record.start_ns if first_ns is None else first_ns
        time_s = (record.start_ns - first_ns) * _NS
        if outcome.difference is not None:
            after += 1
            if after > _AFTER:
                break
        try:
            what_differs = player.play(record)
        except ModelFailedError as error:
            failed = Difference(record.cycle, time_s, "model", "a step", str(error))
            outcome.difference = outcome.difference or failed
            break
        if what_differs is None:
            outcome.behind += 1
            continue
        pair = record, player.keeper.record
        if look is not None:
            look(*pair)
        if outcome.difference is not None:
            outcome.around.append(pair)
            continue
        outcome.duration_s = time_s
        found = [Difference(record.cycle, time_s, *what) for what in what_differs]
        last.append(pair)
        if found:
            outcome.difference, *outcome.others = found
            outcome.around = list(last)
        else:
            outcome.add(record.cycle)
    outcome.gap, outcome.missing, outcome.refusal = run.gap, run.missing, player.refusal
    outcome.damage, outcome.is_cut, outcome.is_other_model = run.damage, run.is_cut, player.is_other_model
    outcome.units = player.units
    return outcome


class _Player:
    """The robot of a run, which is made anew where its state has to be put back.

    Attributes:
        keeper: Keeps the newest cycle as computed.
        is_other_model: Whether the model is not the one that ran.
        units: Of the model's outputs, by name.
        refusal: Why a snapshot could not be put back; empty where all could.
        cycle: The number of the present cycle.
    """

    def __init__(self, run: RecordedRun, model: str | None, watchdog: ModelWatchdog | None) -> None:
        """Make the robot, with the model that is there now."""
        self.refusal = ""
        self.units: Mapping[str, str] = {}
        self.cycle = 0
        self._watchdog = watchdog
        self._run = run
        folders = (run.path.resolve().parent, Path())
        source = locate_recorded(run.robot.model.source, folders) if model is None else locate(model, folders)
        self.is_other_model = False
        self._file = replace(run.robot, model=replace(run.robot.model, source=source))
        self._is_known = self._is_restored = False

    def play(self, record: CycleRecord) -> list[tuple[str, str, str]] | None:
        """Run a cycle; what differs before it and in it, or None where the state before it is not known.

        Raises:
            ModelFailedError: The model's equations raised, as they had not.
        """
        self.cycle = record.cycle
        try:
            reached = self._reach(record)
            return None if reached is None else [*reached, *self._run_again(record)]
        except ModelFailedError:
            raise
        except (*FAILURES, struct.error) as error:
            if not self._is_restored:
                raise
            self._run.damage.append(f"the state that cycle {record.cycle} goes on from is none of this robot: {error}")
            self._is_known = False
            return None

    def _run_again(self, record: CycleRecord) -> list[tuple[str, str, str]]:
        self._recorded.pass_to(record)
        found: list[tuple[str, str, str]] = []
        try:
            if record.cycle == 0:  # what is written in the first cycle was written before the initial equations
                found = _write_again(self._cycle.writer, record)
                self._cycle.start()
            # The line of stamps is a clock's matter: it lies where it lay.
            self._cycle.time_base.anchor(record.cycle, record.stamp_ns)
            self._cycle.run(record.cycle, record.lateness_ns)
        except ModelFailedError:
            if all(answer.call != MODEL_CALL for answer in record.answers):
                raise
        return [*found, *differences(self._run.layout, record, self.keeper.record)]

    def _reach(self, record: CycleRecord) -> list[tuple[str, str, str]] | None:
        """Bring the robot to where it was before a cycle; what differs from the snapshot there."""
        run, snapshot, now = self._run, self._run.snapshot, surroundings()["software"]["segway-ecc"]
        if snapshot is not None and run.version != now:
            self.refusal = f"the state is of version {run.version or 'unknown'} of segway-ecc, this is {now}"
            snapshot = None
        self._is_known = self._is_known and run.is_joined and run.is_complete
        if not run.is_complete or (snapshot is None and not self._is_known and record.cycle > 0):
            return None
        if self._is_known:
            return [] if snapshot is None else self._compare(snapshot, record.cycle)
        try:
            self._make(record)
            if record.cycle > 0 and snapshot is not None:
                self._is_restored = True
                self._cycle.start()
                restore_snapshot(self._cycle, self._model, snapshot)
        except (ModelFailedError, RecordingError) as error:
            self.refusal = self.refusal or str(error)
            return None
        self._is_known = True
        return []

    def _compare(self, snapshot: Snapshot, cycle: int) -> list[tuple[str, str, str]]:
        try:
            return list(compare_snapshots(snapshot, self._cycle.take_state(cycle)))
        except RecordingError as error:
            self._run.damage.append(str(error))
            return []

    def _make(self, record: CycleRecord) -> None:
        """Make the robot anew, to begin with a cycle."""
        section = self._file.model
        if self._watchdog is not None:
            self._watchdog.load(section.source)
        self._model = load_model(section.source, section.parameters, method=section.method, step_size=section.step_size)
        if self._watchdog is not None:
            limit_s = step_limit_s(section.step_limit_s, self._model.step_size)
            self._model = watched = self._watchdog.watch(self._model, round(limit_s * NS_PER_S))
            watched.counter = self
        self.is_other_model = self._run.model_hash != model_hash(section.source)  # of a model that is loaded
        self.units = {variable.name: variable.unit for variable in self._model.outputs}
        self._recorded, self.keeper = RecordedRobot(self._run.layout), _Keeper()
        self._recorded.pass_to(record)
        declared = declared_variables(self._model, section.ranges, section.tunable_while_armed)
        wiring = wire(self._model, self._recorded, self._file.wiring, declared, self._file.controller_mixers)
        robot = Robot(self._file, self._model, self._recorded, wiring, self._recorded)
        self._cycle = robot.cycle(self._recorded, self.keeper)


def _write_again(writer: VariableWriter, record: CycleRecord) -> list[tuple[str, str, str]]:
    """Write what was written before the first cycle; returns the writes that are answered otherwise now."""
    otherwise = []
    for values, refusal in writes_in(record.inbox.written) if record.inbox is not None else ():
        now = writer.write(values)
        if bool(now) is not bool(refusal):
            names = ", ".join(name for name, _ in values)
            otherwise.append((f"write of {names}", refusal or "accepted", now or "accepted"))
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
    before, after = ([] if each.inbox is None else each.inbox.written for each in (recorded, computed))
    for was, now in zip(before, after, strict=False):
        if bool(was.refusal) is not bool(now.refusal):
            yield f"write of {was.name}", was.refusal or "accepted", now.refusal or "accepted"
    failure, failure_now = (
        next((answer.reasons[0] for answer in record.answers if answer.call == MODEL_CALL), "")
        for record in (recorded, computed)
    )
    if bool(failure) is not bool(failure_now):
        yield "model", failure or "a step", failure_now or "a step"
    if recorded.mode is not computed.mode:
        yield "mode", str(recorded.mode), str(computed.mode)
    yield from _changed(recorded, computed)


def _changed(recorded: CycleRecord, computed: CycleRecord) -> Iterator[tuple[str, str, str]]:
    """Where the posture that was entered differs, or what the residual monitor warns of."""
    if recorded.posture != computed.posture:
        old_posture, new_posture = (
            str(each.posture) if each else "as before" for each in (recorded.posture, computed.posture)
        )
        yield "posture", old_posture, new_posture
    if recorded.warning != computed.warning:
        yield "warning", recorded.warning or "none", computed.warning or "none"


def same(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether numbers are the same bit for bit; what is not a number is the same as what is none."""
    if len(a) != len(b):
        return False
    layout = struct.Struct(f"{len(a)}d")
    if layout.pack(*a) == layout.pack(*b):
        return True
    pairs = zip(a, b, strict=True)
    return all((x != x and y != y) or struct.pack("d", x) == struct.pack("d", y) for x, y in pairs)  # noqa: PLR0124 - NaN
