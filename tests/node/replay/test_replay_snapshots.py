# SPDX-License-Identifier: MIT
"""A replay goes on from snapshots of the state behind what is missing, and is compared with them on the way."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from msgspec.structs import replace

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioRun
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import ModelSection, load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Heartbeat, Inbox, NoStage, Request, VariableWrite, Written
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.models.cart import Cart
from segway_ecc.node.recording import cycle_log
from segway_ecc.node.recording.codec import STATE, CycleCodec, unpack_state
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.recorder import ProcessRecorder
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.replay.replay import Outcome, replay
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.settings import StationSettings
from segway_ecc.node.sequence.manoeuvre import Segment
from tests.fixtures.noisy import DRAWS, noisy
from tests.fixtures.twenty_sim.maker import Maker
from tests.node.replay.conftest import InParts, Script

CYCLES = 420
PERIOD_S = 0.01
MANOEUVRE = Trajectory(
    0,
    (
        *(TimedSetpoint(n * 10_000_000, Setpoint(0.001 * n, 0.1)) for n in range(350)),
        TimedSetpoint(3_500_000_000, Setpoint(0.0, 0.0)),
    ),
)


class Lossy(CycleLog):
    """A log that lacks cycles, and whose snapshots may be changed."""

    def __init__(
        self,
        path: Path,
        robot: Robot,
        lost: set[int],
        change: Callable[[Snapshot], Snapshot | None] = lambda taken: taken,
    ) -> None:
        super().__init__(path, layout_of(robot), provenance_of(robot.file))
        self._lost = lost
        self._change = change

    def write(self, record: CycleRecord) -> None:
        if record.cycle not in self._lost:
            super().write(record)
        if record.cycle % 50 == 0:
            self.flush()

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        changed = self._change(take())
        if changed is not None:
            super().write_state(lambda: changed)


def drive(path: Path, lost: set[int], robot: Robot | None = None, cycles: int = CYCLES, **changes: Any) -> Path:
    """The log of a drive in which something of everything happens."""
    file = replace(load_robot("cart"), station=StationSettings(timeout_s=1.0, names=("desk",)))
    robot = robot or build_robot(file, LockstepRig(500_000))
    inboxes = {
        10: Inbox(trajectories=[MANOEUVRE], stations=[Heartbeat("desk", 7)]),
        150: Inbox(written=[Written("AssumedTrack", 0.4)] if isinstance(robot.model, Cart) else []),
        390: Inbox(requests=[Request(Action.STOP, lambda _answer: None)]),
    } | {beat: Inbox(stations=[Heartbeat("desk", beat)]) for beat in (50, 100)}
    robot.loop(Script(inboxes), Lossy(path, robot, lost, **changes)).run(cycles)
    return path


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Maker:
    """Models as 20-sim writes them."""
    return Maker(lambda: tmp_path_factory.mktemp("model"))


def stretches(lost: set[int], cycles: int, every: int) -> list[tuple[int, int]]:
    """What can be compared, with a snapshot each so many cycles."""
    found, known = list[tuple[int, int]](), True
    for cycle in range(cycles):
        known = cycle not in lost and (known or (cycle % every == 0))
        if known:
            first = found.pop()[0] if found and found[-1][1] == cycle - 1 else cycle
            found.append((first, cycle))
    return found


LOST = [{5}, {0}, {99, 100}, {250}, {5, 120, 350}]


@pytest.mark.parametrize("lost", LOST, ids=str)
def test_all_cycles_but_those_before_the_next_snapshot_are_compared(path: Path, lost: set[int]) -> None:
    seen: dict[int, CycleRecord] = {}
    drive(path, lost)
    outcome = replay(path, look=lambda recorded, computed: seen.update({recorded.cycle: computed}))

    assert (outcome.difference, outcome.damage, outcome.refusal) == (None, [], "")
    assert outcome.stretches == stretches(lost, CYCLES, 100)
    assert outcome.cycles + outcome.behind + len(lost) == CYCLES
    assert not outcome.is_whole
    assert {record.mode for record in seen.values()} >= {Mode.ARMED, Mode.FAULT}
    assert seen[300].mode is Mode.HOLD, "the station fell silent while the manoeuvre was followed"


def test_a_whole_log_is_compared_with_every_snapshot(path: Path) -> None:
    taken: list[int] = []

    def note(snapshot: Snapshot) -> Snapshot:
        taken.append(snapshot.cycle)
        return snapshot

    outcome = replay(drive(path, set(), change=note))

    assert (outcome.stretches, outcome.is_whole, outcome.refusal) == ([(0, CYCLES - 1)], True, "")
    assert taken == [100, 200, 300, 400]


@pytest.mark.variants(6)
@pytest.mark.parametrize(
    "name",
    [
        "cart-can",
        "cart-cia402",
        "cart-hoverboard",
        "cart-moteus",
        "cart-odrive",
        "cart-vesc",
        "segway",
        "segway-odrive",
    ],
)
@pytest.mark.parametrize(
    "fault",
    [
        None,
        Fault(target="can", type="off", at_s=0.7),
        Fault(target="command_link", type="off", at_s=0.6),
    ],
    ids=["drives", "faults", "holds"],
)
def test_robots_of_all_kinds_go_on_from_a_snapshot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, fault: Fault | None
) -> None:
    write = CycleLog.write
    monkeypatch.setattr(CycleLog, "write", lambda log, record: record.cycle == 130 or write(log, record))
    scenario = Scenario(
        name="test",
        robot=name,
        segments=(Segment(linear=0.5, angular=0.3, duration=3.0),),
        faults=() if fault is None else (fault,),
        expect=Expectation(outcome="drives_on"),
    )
    log = tmp_path / "run.mcap"
    run_scenario(ScenarioRun("test", scenario, name, 0, {}), log)
    outcome = replay(log)
    (before, behind) = outcome.stretches

    assert (outcome.difference, outcome.refusal, outcome.missing) == (None, "", [(130, 130)])
    assert (before, behind[0]) == ((0, 129), 200)
    assert behind[1] - behind[0] > 30


@pytest.mark.variants(1)
@pytest.mark.compiler
@pytest.mark.parametrize("shape", ["submodel", "cpp_class"])
def test_generated_code_goes_on_with_its_random_numbers(
    path: Path, make: Maker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shape: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file, source = load_robot("cart"), noisy(make, tmp_path, shape, DRAWS)
    section = ModelSection(source=str(source))
    wiring = {"in": "setpoint.linear_velocity", "out": "topic.noise"}
    robot = build_robot(replace(file, model=section, wiring=wiring, safety=None), LockstepRig(500_000))
    outcome = replay(drive(path, {5, 13}, robot, 40))

    assert (outcome.difference, outcome.refusal) == (None, "")
    assert outcome.stretches == [(0, 4), (8, 12), (16, 39)]


class Writes(NoStage):
    """Has a parameter written in each hundredth cycle."""

    def __init__(self) -> None:
        self._cycles = 0
        self.refusals: list[str] = []

    def take_inbox(self) -> Inbox:
        self._cycles += 1
        if self._cycles % 100:
            return Inbox()
        value = ("AssumedTrack", 0.3 + 0.001 * self._cycles)
        return Inbox(writes=[VariableWrite([value], self.refusals.append)])


@pytest.mark.parametrize("lost", [set(), {50}, {150}], ids=str)
def test_what_is_written_while_armed_is_written_again_behind_a_gap(path: Path, lost: set[int]) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    stage = Writes()
    robot.loop(stage, Lossy(path, robot, lost)).run(250)
    outcome = replay(path)

    assert stage.refusals == ["", ""]
    assert (outcome.difference, outcome.stretches) == (None, stretches(lost, 250, 100))


def test_snapshots_pass_through_the_ring_to_the_log(path: Path) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    robot.loop(NoStage(), ProcessRecorder(path, layout_of(robot), provenance_of(robot.file))).run(250)
    run = RecordedRun(path)

    assert [run.snapshot.cycle for _ in run.cycles() if run.snapshot is not None] == [100, 200]
    assert (replay(path).stretches, replay(path).is_whole) == ([(0, 249)], True)
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = [message for _, _, _, message in reader.iter_decoded_messages(topics=["/state"])]
    assert [(message.cycle, unpack_state(bytes(message.snapshot)).cycle) for message in decoded] == [
        (100, 100),
        (200, 200),
    ]
    with pytest.raises(RecordingError, match="a record on its way to the log was damaged"):
        CycleCodec(layout_of(robot)).bodies(STATE, b"\x93\x01")


def test_a_later_part_is_replayed_where_the_earlier_ones_are_gone(path: Path) -> None:
    robot = build_robot(load_robot("cart"), LockstepRig(500_000))
    robot.loop(NoStage(), InParts(path, robot, 150, 250)).run(CYCLES)
    whole = replay(path)
    path.unlink()
    later = replay(path.with_name("run-0002.mcap"))

    assert (whole.stretches, whole.is_whole) == ([(0, CYCLES - 1)], True)
    assert (later.difference, later.gap) == (None, "the log begins with cycle 150")
    assert (later.stretches, later.behind) == ([(200, CYCLES - 1)], 50)
    path.with_name("run-0002.mcap").unlink()
    assert replay(path.with_name("run-0003.mcap")).stretches == [(300, CYCLES - 1)]


def test_another_run_beside_a_log_that_lacks_its_beginning_is_not_taken_for_its_rest(path: Path) -> None:
    drive(path.with_name("run-2024.mcap"), {0, 1})
    drive(path.with_name("run-2025.mcap"), set())
    run = RecordedRun(path.with_name("run-2024.mcap"))

    assert [record.cycle for record in run.cycles()] == list(range(2, CYCLES))


def moved(snapshot: Snapshot) -> Snapshot:
    """The snapshot before cycle 200 with another integral, and another mode before cycle 300."""
    name = "model" if snapshot.cycle == 200 else "parts" if snapshot.cycle == 300 else None
    if name is None:
        return snapshot
    tree = msgspec.msgpack.decode(getattr(snapshot, name))
    ((_, held),) = tree.items()
    if name == "model":
        held["s"][3] += 1e-9
    else:
        ((_, held),) = held["arming"].items()
        ((_, held),) = held["modes"].items()
        ((kind, _),) = held["mode"].items()
        held["mode"] = {kind: "DISARMED"}
    return replace(snapshot, **{name: msgspec.msgpack.encode(tree)})


def test_a_value_that_differs_from_the_snapshot_is_a_difference_with_its_name(path: Path) -> None:
    first = replay(drive(path, set(), change=moved)).difference
    second = replay(drive(path, {150}, change=lambda taken: moved(taken) if taken.cycle == 300 else taken)).difference

    assert first is not None
    assert (first.cycle, first.port) == (200, "state of the model.s[3]")
    assert float(first.recorded) - float(first.computed) == pytest.approx(1e-9)
    assert second is not None
    assert second._replace(time_s=0.0) == (300, 0.0, "state of the cycle.arming.modes.mode", "DISARMED", "HOLD")


def test_what_goes_on_from_a_state_that_is_not_the_recorded_one_differs(path: Path) -> None:
    difference = replay(drive(path, {150}, change=moved)).difference

    assert difference is not None
    assert (difference.cycle, difference.port) == (200, "model output X")


class WithASet(Cart):
    """A cart that holds what cannot be captured."""

    def initial(self) -> None:
        super().initial()
        self.seen = {1, 2}


def test_a_model_that_cannot_give_its_state_is_reported_and_the_rest_counted(path: Path) -> None:
    file = load_robot("cart")
    source = f"{__name__}:WithASet"
    robot = build_robot(replace(file, model=replace(file.model, source=source)), LockstepRig(500_000))
    outcome = replay(drive(path, {150}, robot))

    assert (outcome.stretches, outcome.behind, outcome.difference) == ([(0, 149)], CYCLES - 151, None)
    assert outcome.refusal == (
        "the state of the model cannot be recorded: WithASet.seen: builtins:set cannot be captured"
    )


def test_snapshots_of_another_version_are_not_used(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cycle_log, "surroundings", lambda: {"software": {"segway-ecc": "0.1.9"}})
    outcome = replay(drive(path, {350}, change=moved))

    assert (outcome.stretches, outcome.behind, outcome.difference) == ([(0, 349)], CYCLES - 351, None)
    assert outcome.refusal.startswith("the state is of version 0.1.9 of segway-ecc, this is ")


def test_a_log_without_snapshots_is_replayed_as_far_as_it_goes(path: Path) -> None:
    outcome = replay(drive(path, {150}, change=lambda _: None))

    assert (outcome.stretches, outcome.behind, outcome.refusal) == ([(0, 149)], CYCLES - 151, "")


@pytest.mark.variants(6)
@pytest.mark.parametrize("seed", range(25))
def test_a_snapshot_with_flipped_bytes_raises_nothing_and_is_never_a_whole_log(path: Path, seed: int) -> None:
    chance = np.random.default_rng(seed)

    def flip(snapshot: Snapshot) -> Snapshot:
        name = ["parts", "model"][chance.integers(2)]
        data = bytearray(getattr(snapshot, name))
        for _ in range(chance.integers(1, 4)):
            data[chance.integers(len(data))] ^= 1 << int(chance.integers(8))
        return replace(snapshot, **{name: bytes(data)})

    outcome = replay(drive(path, {50, 150, 250, 350}, change=flip))

    assert not outcome.is_whole
    assert outcome.cycles + outcome.behind <= CYCLES - 4


def with_text_at(tree: Any, place: int) -> tuple[Any, int]:
    """A tree with a text in place of the n-th of its numbers, and how many there are before and in it."""
    if isinstance(tree, (int, float)):
        return ("text" if place == 0 else tree), place - 1
    parts = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    made = {}
    for name, each in parts:
        made[name], place = with_text_at(each, place)
    return (made if isinstance(tree, dict) else list(made.values()) if isinstance(tree, list) else tree), place


@pytest.mark.variants(10)
@pytest.mark.parametrize("place", range(0, 240, 6))
def test_a_text_where_a_number_belongs_is_damage_or_a_difference(path: Path, place: int) -> None:
    def spoil(snapshot: Snapshot) -> Snapshot:
        tree, _ = with_text_at(msgspec.msgpack.decode(snapshot.parts), place)
        return replace(snapshot, parts=msgspec.msgpack.encode(tree))

    outcome = replay(drive(path, {150}, change=lambda taken: spoil(taken) if taken.cycle == 200 else taken))

    assert not outcome.is_whole
    assert outcome.stretches[0] == (0, 149)


def test_a_message_that_is_no_snapshot_is_damage(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = CycleLog.write_snapshot
    monkeypatch.setattr(CycleLog, "write_snapshot", lambda log, message: write(log, message[:-20]))
    outcome = replay(drive(path, {150}))

    assert (outcome.stretches, outcome.difference) == ([(0, 149)], None)
    assert outcome.damage[0].startswith("run.mcap: a message on /state is damaged: ")


def test_a_snapshot_that_cannot_be_decoded_is_damage_where_nothing_is_missing(path: Path) -> None:
    def spoil(snapshot: Snapshot) -> Snapshot:
        return replace(snapshot, parts=snapshot.parts[:-20]) if snapshot.cycle == 200 else snapshot

    outcome = replay(drive(path, set(), change=spoil))

    assert (outcome.cycles, outcome.difference, outcome.is_whole) == (CYCLES, None, False)
    (text,) = outcome.damage
    assert text.startswith("the state before cycle 200 cannot be compared: ")


@pytest.mark.variants(5)
@pytest.mark.parametrize("seed", range(20))
def test_a_log_with_a_flipped_byte_is_compared_but_for_the_chunk_and_up_to_a_second_behind_it(
    path: Path, seed: int
) -> None:
    data = bytearray(drive(path, set()).read_bytes())
    chance = np.random.default_rng(seed)
    data[chance.integers(len(data) // 20, len(data))] ^= 1 << int(chance.integers(8))
    path.write_bytes(data)
    outcome: Outcome = replay(path)

    assert outcome.difference is None
    assert not outcome.is_whole
    missing = sum(last - first + 1 for first, last in outcome.missing)
    assert outcome.cycles + outcome.behind + missing == CYCLES
    assert missing <= 51
    assert outcome.cycles >= CYCLES - 51 - 150
