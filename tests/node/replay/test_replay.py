# SPDX-License-Identifier: MIT
"""A recorded run through the same model and safety code again."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import (
    CycleRecord,
    Heartbeat,
    Inbox,
    NoStage,
    Request,
    SetValue,
    StampedSetpoint,
    Written,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory
from segway_ecc.node.errors import ModelFailedError, RecordingError
from segway_ecc.node.models.cart import Cart
from segway_ecc.node.recording import cdr
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import CycleLayout, Provenance, layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.replay.replay import replay
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.testing import ScriptedClock, ScriptedStage
from tests.node.replay.conftest import InParts

Run = Callable[..., Path]
CYCLES = 80


def setpoint(linear: float, stamp_ns: int | None = None) -> Inbox:
    return Inbox(setpoints=[StampedSetpoint(Setpoint(linear, 0.1), stamp_ns)])


MANOEUVRE = Trajectory(0, (TimedSetpoint(0, Setpoint(0.2, 0.1)), TimedSetpoint(50_000_000, Setpoint(0.0, 0.0))))


def asked(*actions: Action) -> Inbox:
    return Inbox(requests=[Request(action, lambda _answer: None) for action in actions])


def test_everything_that_an_operator_does_comes_out_the_same(path: Path, run: Run) -> None:
    inboxes = {
        20: asked(Action.STOP),
        22: asked(Action.ARM, Action.CLEAR_FAULT, Action.ARM),
        24: Inbox(setpoints=[StampedSetpoint(Setpoint(math.nan, 0.0), None), StampedSetpoint(Setpoint(0.3, 0.0), 1)]),
        30: Inbox(setpoints=[StampedSetpoint(Setpoint(0.7, 0.0), 1_700_000_000_000_000_000 + 400_000_000)]),
        50: asked(Action.DISARM),
        52: asked(Action.ARM),
        60: setpoint(0.5),
        62: Inbox(stations=[Heartbeat("desk", 7)], trajectories=[MANOEUVRE]),
    }
    modes: list[Mode] = []
    followed: set[Setpoint] = set()

    def look(recorded: CycleRecord, computed: CycleRecord) -> None:
        modes.append(recorded.mode)
        followed.add(computed.setpoint)

    run(path, inboxes)
    outcome = replay(path, look=look)

    assert (outcome.cycles, outcome.difference, outcome.gap) == (CYCLES, None, None)
    assert {Mode.ARMED, Mode.FAULT, Mode.DISARMED} <= set(modes)
    assert Setpoint(0.2, 0.1) in followed


def test_a_parameter_that_was_written_while_it_ran_is_written_again(path: Path, run: Run) -> None:
    written = Inbox(written=[Written("FeedbackGain", 0.05)])
    run(path, {30: written})
    outcome = replay(path)

    assert (outcome.cycles, outcome.difference) == (CYCLES, None)

    forget = run(
        path, {30: written}, change=lambda record: replace(record, inbox=None) if record.cycle == 30 else record
    )
    difference = replay(forget).difference
    assert difference is not None
    assert difference.cycle == 30


def test_a_write_that_the_model_refused_is_in_the_log_and_refused_again(path: Path, run: Run) -> None:
    written = [Written("Track", 0.4), Written("FeedbackGain", math.nan), Written("FeedbackGain", 0.05)]
    run(path, {30: Inbox(written=written)})
    kept = [record.inbox.written for record in RecordedRun(path).cycles() if record.inbox and record.inbox.written]

    assert [(each.name, bool(each.refusal)) for each in kept[0]] == [
        ("Track", True),
        ("FeedbackGain", True),
        ("FeedbackGain", False),
    ]
    assert kept[0][0].refusal == "'Track' is not tunable while the robot is armed: disarm it first"
    assert (replay(path).cycles, replay(path).difference) == (CYCLES, None)


def test_a_write_that_is_answered_otherwise_now_is_a_difference(path: Path, run: Run) -> None:
    def refused(record: CycleRecord) -> CycleRecord:
        inbox = Inbox(written=[Written("AssumedTrack", 0.3, "too narrow")])
        return replace(record, inbox=inbox) if record.cycle == 30 else record

    difference = replay(run(path, {30: Inbox(written=[Written("AssumedTrack", 0.3)])}, change=refused)).difference

    assert difference is not None
    assert (difference.cycle, *difference[2:]) == (30, "write of AssumedTrack", "too narrow", "accepted")


class Placed(Cart):
    """A cart that starts one track ahead."""

    def initial(self) -> None:
        super().initial()
        self.s[[state.name for state in self.states].index("PoseX")] = self.p["Track"]


def test_what_was_written_before_the_first_cycle_is_in_the_initial_equations_of_a_replay(path: Path, run: Run) -> None:
    robot = dataclasses.replace(build_robot(load_robot("cart"), LockstepRig(500_000)), model=Placed())
    robot.model.write("Track", 0.4)
    outcome = replay(run(path, {0: Inbox(written=[Written("Track", 0.4)])}, robot=robot), f"{__name__}:Placed")

    assert (outcome.cycles, outcome.difference) == (CYCLES, None)


class Fragile(Cart):
    """A cart whose equations fail some steps after its track was written."""

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        1.0 / (self.p["AssumedTrack"] - 0.4 if t > 0.34 else 1.0)
        return super().dynamic(t, s)


def test_what_made_the_model_fail_is_in_the_log_and_makes_it_fail_again(path: Path, run: Run) -> None:
    robot = dataclasses.replace(build_robot(load_robot("cart"), LockstepRig(500_000)), model=Fragile())
    with pytest.raises(ModelFailedError):
        run(path, {30: Inbox(written=[Written("AssumedTrack", 0.4)])}, robot=robot)
    records = list(RecordedRun(path).cycles())
    last = records[-1]
    healthy = replay(path)
    outcome = replay(path, f"{__name__}:Fragile")

    assert records[30].inbox is not None
    assert records[30].inbox.written == [Written("AssumedTrack", 0.4)]
    assert [answer.call for answer in last.answers] == ["model"]
    assert "ZeroDivisionError" in last.answers[0].reasons[0]
    assert (outcome.cycles, outcome.difference) == (last.cycle + 1, None)
    assert healthy.difference is not None
    assert "model" in {each.port for each in (healthy.difference, *healthy.others)}


def test_the_first_difference_is_reported_with_the_cycles_around(path: Path, run: Run) -> None:
    def disturb(record: CycleRecord) -> CycleRecord:
        if record.cycle < 40:
            return record
        y = (math.nextafter(record.y[0], math.inf), *record.y[1:])
        return replace(record, y=y)

    outcome = replay(run(path, change=disturb))

    assert outcome.cycles == 40
    assert outcome.difference is not None
    assert (outcome.difference.cycle, outcome.difference.port) == (40, "model output X")
    assert outcome.difference.time_s == pytest.approx(0.4)
    assert float(outcome.difference.recorded) == math.nextafter(float(outcome.difference.computed), math.inf)
    assert [recorded.cycle for recorded, _ in outcome.around] == [36, 37, 38, 39, 40, 41, 42, 43, 44, 45]


def test_another_mode_is_reported(path: Path, run: Run) -> None:
    def disturb(record: CycleRecord) -> CycleRecord:
        return replace(record, mode=Mode.HOLD) if record.cycle == 7 else record

    difference = replay(run(path, change=disturb)).difference

    assert difference is not None
    assert difference._replace(time_s=0.07) == (7, 0.07, "mode", "HOLD", "ARMED")


def test_a_cycle_that_is_missing_ends_the_replay_there_where_no_snapshot_follows(path: Path, run: Run) -> None:
    outcome = replay(run(path, change=lambda record: None if record.cycle in {33, 34} else record))

    assert (outcome.cycles, outcome.difference) == (33, None)
    assert outcome.gap == "cycles 33 to 34 are missing in the log"


def test_a_log_that_begins_in_mid_run_and_has_no_snapshot_cannot_be_replayed(path: Path, run: Run) -> None:
    outcome = replay(run(path, change=lambda record: record if record.cycle >= 5 else None))

    assert (outcome.cycles, outcome.is_identical) == (0, False)
    assert (outcome.gap, outcome.behind) == ("the log begins with cycle 5", CYCLES - 5)


def test_a_log_that_is_cut_off_is_replayed_as_far_as_it_goes(recorded: Callable[..., Path]) -> None:
    log = recorded()
    whole = replay(log)
    data = log.read_bytes()
    log.write_bytes(data[: len(data) - 100])  # in the summary at the end
    cut = replay(log)

    assert (whole.is_cut, cut.is_cut) == (False, True)
    assert (cut.cycles, cut.difference, cut.gap) == (whole.cycles, None, None)


def test_another_model_is_reported(path: Path, run: Run) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    provenance = provenance_of(robot.file)
    other = Provenance(provenance.attachments, {"model": {"source": robot.file.model.source, "sha256": "0"}})
    log = CycleLog(path, layout_of(robot), other)
    robot.loop(NoStage(), log).run(5)

    assert replay(path).is_other_model
    assert not replay(run(path)).is_other_model


def test_parameters_of_the_robot_file_are_those_of_the_log(path: Path, run: Run) -> None:
    file = load_robot("cart")
    model = msgspec.structs.replace(file.model, parameters={**file.model.parameters, "WheelRadius": 0.0623})
    changed = msgspec.structs.replace(file, model=model)

    assert replay(run(path, robot=build_robot(changed, LockstepRig(500_000)))).is_identical


def test_a_run_in_several_files_is_replayed_through_all_of_them(path: Path) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    robot.loop(NoStage(), InParts(path, robot, CYCLES // 2)).run(CYCLES)

    assert (replay(path).cycles, replay(path).is_whole) == (CYCLES, True)
    path.with_name("run-0002.mcap").unlink()
    lacking = replay(path)
    assert (lacking.cycles, lacking.is_cut, lacking.is_whole) == (CYCLES // 2, True, False)


def test_a_value_that_somebody_sets_is_set_again(path: Path, run: Run) -> None:
    file = load_robot("segway")
    robot = build_robot(file, LockstepRig(500_000))
    names = robot.wiring.set_names
    assert names, "the segway has a value that anybody may set"
    run(path, {20: Inbox(values=[SetValue(0, 0.0), SetValue(0, math.inf)])}, robot=robot)

    assert replay(path).cycles == CYCLES


def test_a_log_of_the_writer_is_replayed_too(path: Path) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    recorder = ProcessRecorder(path, layout_of(robot), provenance_of(robot.file))
    robot.loop(NoStage(), recorder).run(CYCLES)

    assert replay(path).cycles == CYCLES


def test_a_declared_fault_of_the_bus_is_replayed(recorded: Callable[..., Path]) -> None:
    log = recorded(Fault(target="can", type="off", at_s=0.2))
    modes: list[Mode] = []
    outcome = replay(log, look=lambda _recorded, computed: modes.append(computed.mode))

    assert outcome.is_identical
    assert modes[-1] is Mode.FAULT


def test_what_is_no_log_of_a_run_is_refused(path: Path, tmp_path: Path) -> None:
    path.write_bytes(b"not a log")
    with pytest.raises(RecordingError, match=r"cannot be replayed: it is no log of a run"):
        RecordedRun(path)
    with pytest.raises(RecordingError, match="No such file"):
        RecordedRun(tmp_path / "no.mcap")
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    CycleLog(path, layout_of(robot), Provenance({"robot.json": '{"name": 1}'}, {})).close()
    with pytest.raises(RecordingError, match=r"its robot\.json is of another version of segway-ecc"):
        RecordedRun(path)


def test_the_layout_of_a_log_is_read_back(path: Path, run: Run) -> None:
    run(path)
    layout = RecordedRun(path).layout

    assert isinstance(layout, CycleLayout)
    assert (layout.robot, layout.period_ns) == ("cart", 10_000_000)


class Forgetful(CycleLog):
    """A log that lacks what happened in its later cycles, though not that something did."""

    def write_events(self, message: bytes) -> None:
        if cdr.read_cycle_events(message)[0] == 0:
            super().write_events(message)


def test_the_replay_ends_where_events_are_missing(path: Path) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    stage = ScriptedStage(ScriptedClock())
    stage.send_setpoint(10, Setpoint(1.0, 0.1))
    stage.send_setpoint(10, Setpoint(0.9, 0.1))
    robot.loop(stage, Forgetful(path, layout_of(robot), provenance_of(robot.file))).run(CYCLES)
    outcome = replay(path)

    assert (outcome.cycles, outcome.difference) == (10, None)
    assert outcome.gap == "of what happened in cycle 10 only 0 of 2 are in the log"
