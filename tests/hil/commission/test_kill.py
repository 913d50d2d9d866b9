# SPDX-License-Identifier: MIT
"""The node of a simulated robot, killed while it drives: the verdicts, and once with real processes."""

import msgspec
import pytest

from segway_ecc.hil.commission.kill import kill_node
from segway_ecc.hil.commission.session import StepRefusedError
from segway_ecc.hil.commission.simulated import SimulatedSite
from segway_ecc.hil.drill import trial
from segway_ecc.hil.drill.parts import DrillSetup
from segway_ecc.hil.drill.plant_control import Torque
from segway_ecc.hil.drill.trial import DrillFault, DrillOutcome, DrillResult
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import load_robot

ROBOT = "segway"


class Runs:
    """What comes of each run; see `Run`."""

    def __init__(self, *torques: Torque | None, robot: str = ROBOT) -> None:
        self.torques = list(torques)
        self.guards: list[bool] = []
        self.lines: list[str] = []
        self._robot = robot

    def __call__(self, fault: DrillFault, setup: DrillSetup) -> DrillResult:
        assert fault.name == "node killed"
        assert (setup.robot, setup.folder.is_dir()) == (self._robot, True)
        self.lines = [word.replace(str(setup.folder), "") for word in setup.bus]
        self.guards.append(setup.guard)
        torque = self.torques.pop(0)
        return DrillResult(fault.name, DrillOutcome.ENDS, guard=setup.guard, torque=torque, messages=[], note="it died")


def ended(after_s: float) -> Torque:
    return Torque(after_s, after_s + 0.005, 0.0)


def test_it_is_killed_with_the_guard_and_without() -> None:
    runs = Runs(ended(0.034), ended(0.041))
    found = kill_node(ROBOT, load_robot(ROBOT), runs)
    assert runs.guards == [True, False]
    assert found.verdict == "passed"
    assert found.measured == {"guard_off_after_s": 0.034, "watchdog_off_after_s": 0.041}
    assert "after 34 ms with the guard, after 41 ms by the drives' watchdog alone; allowed 50 ms" in found.text


def test_robot_that_requires_a_guard_is_never_without() -> None:
    file = load_robot(ROBOT)
    file = msgspec.structs.replace(file, hardware=msgspec.structs.replace(hardware_of(file), guard="required"))
    runs = Runs(ended(0.03))
    assert kill_node(ROBOT, file, runs).measured == {"guard_off_after_s": 0.03}
    assert runs.guards == [True]


@pytest.mark.parametrize(
    ("torques", "reason"),
    [
        ([ended(0.06)], "torque ends after 60 ms with the guard, allowed is 50 ms"),
        ([Torque(1.0, None, 0.0)], "torque does not end with the guard, allowed"),
        ([ended(0.04), ended(0.07)], "torque ends after 70 ms by the drives' watchdog alone"),
        ([None], "does not drive the robot: it died"),
    ],
)
def test_torque_that_does_not_end_in_time_is_refused(torques: list[Torque | None], reason: str) -> None:
    with pytest.raises(StepRefusedError, match=reason):
        kill_node(ROBOT, load_robot(ROBOT), Runs(*torques))


def test_robot_without_a_bus_is_killed_on_serial_lines_of_its_own() -> None:
    robot = "segway-hoverboard"
    runs = Runs(ended(0.03), robot=robot)
    kill_node(robot, load_robot(robot), runs)
    assert runs.lines == ["--imu-serial", "/imu", "--serial", "/serial"]


def test_robot_that_arms_on_request_is_left_out() -> None:
    file = msgspec.structs.replace(load_robot(ROBOT), arming="on_request")
    found = kill_node(ROBOT, file, Runs())
    assert (found.verdict, found.measured) == ("left out", {})


@pytest.mark.real_time
@pytest.mark.parametrize("robot", ["segway", "segway-odrive"])
@pytest.mark.variants(1)
def test_killed_node_of_a_standing_robot_leaves_no_torque(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "_DRIVEN_S", 0.5)
    found = SimulatedSite(load_robot(robot), killed=robot).kill()
    assert found.verdict == "passed"
    assert set(found.measured) == {"guard_off_after_s", "watchdog_off_after_s"}
