# SPDX-License-Identifier: MIT
"""Recorded runs, of a robot that is all model and from the campaign's bench in lock step."""

from bisect import bisect
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioRun
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoRecorder, NoStage, StampedSetpoint, VariableWrite
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.state import Snapshot
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import LogPart, layout_of
from segway_ecc.node.recording.log_quota import part_path
from segway_ecc.node.recording.robot_provenance import provenance_of
from segway_ecc.node.replay.recorded import writes_in
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.sequence.manoeuvre import Segment

Record = Callable[..., Path]


@pytest.fixture
def recorded(tmp_path: Path) -> Record:
    """Called with faults and the robot's name; returns the log of a short drive."""

    def record(*faults: Fault, robot: str = "cart-can") -> Path:
        scenario = Scenario(
            name="test",
            robot=robot,
            segments=(Segment(linear=1.0, angular=0.5, duration=0.4),),
            faults=faults,
            expect=Expectation(outcome="drives_on"),
        )
        log = tmp_path / "run.mcap"
        run_scenario(ScenarioRun("test", scenario, robot, 0, {}), log)
        return log

    return record


CYCLES = 80


class Script(NoStage):
    """Lets things arrive in the n-th cycle; what is `written` after the first is to be written in it."""

    def __init__(self, inboxes: dict[int, Inbox]) -> None:
        self._inboxes = inboxes
        self._cycle = 0

    def take_inbox(self) -> Inbox:
        inbox = self._inboxes.get(self._cycle, Inbox())
        if self._cycle:
            writes = [VariableWrite(values, lambda _: None) for values, _ in writes_in(inbox.written)]
            inbox = replace(inbox, writes=writes, written=[])
        self._cycle += 1
        return inbox


class Rewritten(CycleLog):
    """A log that keeps its cycles otherwise than they were."""

    def __init__(self, path: Path, robot: Robot, change: Callable[[CycleRecord], CycleRecord | None]) -> None:
        super().__init__(path, layout_of(robot), provenance_of(robot.file))
        self._change = change

    def write(self, record: CycleRecord) -> None:
        changed = self._change(record)
        if changed is not None:
            super().write(changed)


class InParts(NoRecorder):
    """A log in several files; each but the first begins with one of the `borders`, a cycle's number."""

    def __init__(self, path: Path, robot: Robot, *borders: int) -> None:
        run, self._borders, self._place = LogPart().run, borders, 0
        self._parts = [
            CycleLog(part_path(path, n), layout_of(robot), provenance_of(robot.file), LogPart(run, n))
            for n in range(1, len(borders) + 2)
        ]

    def write(self, record: CycleRecord) -> None:
        self._place = bisect(self._borders, record.cycle)
        self._parts[self._place].write(record)

    def write_state(self, take: Callable[[], Snapshot]) -> None:
        self._parts[self._place].write_state(take)

    def close(self) -> None:
        for part in self._parts:
            part.close(is_end=part is self._parts[-1])


def same(record: CycleRecord) -> CycleRecord:
    return record


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where the log goes."""
    return tmp_path / "run.mcap"


@pytest.fixture
def run() -> Record:
    """Called with the log's path and what arrives in which cycle; runs the robot for 80 cycles."""

    def drive(
        path: Path,
        inboxes: dict[int, Inbox] | None = None,
        *,
        robot: Robot | None = None,
        change: Callable[[CycleRecord], CycleRecord | None] = same,
    ) -> Path:
        """Run the cart, which is all model, or another robot, for 80 cycles; the path of its log."""
        robot = robot or build_robot(load_robot("cart"), LockstepRig(500_000))
        stage = Script({10: Inbox(setpoints=[StampedSetpoint(Setpoint(1.0, 0.1), None)]), **(inboxes or {})})
        robot.loop(stage, Rewritten(path, robot, change)).run(CYCLES)
        return path

    return drive
