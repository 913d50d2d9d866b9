# SPDX-License-Identifier: MIT
"""Recorded runs, of a robot that is all model and from the campaign's bench in lock step."""

from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioRun
from segway_ecc.hil.faults.fault import Fault
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Inbox, NoStage, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.model.model import Model, write_variable
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.layout import layout_of
from segway_ecc.node.recording.robot_provenance import provenance_of
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
    """Lets things arrive in the n-th cycle; what is to be written is written in the slack before it."""

    def __init__(self, model: Model, inboxes: dict[int, Inbox]) -> None:
        self._model = model
        self._inboxes = inboxes
        self._cycle = 0

    def take_inbox(self) -> Inbox:
        inbox = self._inboxes.get(self._cycle, Inbox())
        inbox.written = [each._replace(refusal=write_variable(self._model, *each[:2])) for each in inbox.written]
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
        stage = Script(
            robot.model, {10: Inbox(setpoints=[StampedSetpoint(Setpoint(1.0, 0.1), None)]), **(inboxes or {})}
        )
        robot.loop(stage, Rewritten(path, robot, change)).run(CYCLES)
        return path

    return drive
