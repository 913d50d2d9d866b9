# SPDX-License-Identifier: MIT
"""The packaged robots with other axes than two wheels, whole and in lock step."""

from collections.abc import Mapping

import pytest

from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import Inbox, NoRecorder, NoStage, SetValue, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode


class Commands(NoStage):
    """Sends what a test has it send in the next cycle; set-points again and again, so that they stay in force."""

    def __init__(self) -> None:
        self.values: list[SetValue] = []
        self.setpoint: Setpoint | None = None

    def take_inbox(self) -> Inbox:
        values, self.values = self.values, []
        setpoints = [] if self.setpoint is None else [StampedSetpoint(self.setpoint, None)]
        return Inbox(setpoints=setpoints, values=values)


class Bench:
    """A packaged robot with its simulated drives and plant, armed."""

    def __init__(self, name: str) -> None:
        file = load_robot(name)
        rig = LockstepRig.of(hardware_of(file))
        self.link, plant_link = FaultyLink(rig.bus.attach("node")), rig.bus.attach("plant")
        self.simulated = simulated_robot(file, plant_link)
        rig.attach(self.simulated)
        self.robot = build_robot(file, rig, self.link)
        self.stage = Commands()
        self.cycle = self.robot.cycle(self.stage, NoRecorder())
        self._rig = rig
        self._number = 0
        plant_link.open()
        self.cycle.start()
        self.run(2.0)
        assert self.mode is Mode.ARMED, self.cycle.arming.modes.reason

    @property
    def mode(self) -> Mode:
        return self.cycle.arming.modes.mode

    @property
    def outputs(self) -> Mapping[str, float]:
        return dict(zip(self.simulated.output_names, self.simulated.outputs, strict=True))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / self.robot.period_ns)):
            deadline_ns = self._rig.now_ns() + self.robot.period_ns
            self._rig.sleep_until_ns(deadline_ns)
            self.cycle.run(self._number, 0)
            self._number += 1

    def set(self, **values: float) -> None:
        names = list(self.robot.wiring.set_names)
        self.stage.values = [SetValue(names.index(name), value) for name, value in values.items()]


GOALS = {
    "pan-tilt": {"pan": 1.5, "tilt": -0.6},
    "arm": {"shoulder": 0.3, "elbow": 0.8, "wrist": -0.5},
}


@pytest.mark.parametrize("name", GOALS)
def test_joints_go_to_their_setpoints_and_stay(name: str) -> None:
    bench = Bench(name)
    bench.set(**GOALS[name])
    bench.run(4.0)
    assert bench.mode is Mode.ARMED, bench.cycle.arming.modes.reason
    for axis, angle in GOALS[name].items():
        assert bench.outputs[f"{axis}.angle"] == pytest.approx(angle, abs=0.01)
        assert bench.outputs[f"{axis}.velocity"] == pytest.approx(0.0, abs=0.01)


def test_four_wheels_follow_the_velocities() -> None:
    bench = Bench("skid-steer")
    bench.stage.setpoint = Setpoint(1.0, 0.8)
    bench.run(3.0)
    assert bench.mode is Mode.ARMED, bench.cycle.arming.modes.reason
    found = bench.outputs
    assert found["truth.linear_velocity"] == pytest.approx(1.0, rel=0.01)
    assert found["truth.angular_velocity"] == pytest.approx(0.8, rel=0.01)
    assert found["front_left.velocity"] == found["rear_left.velocity"] == pytest.approx(7.6, rel=0.01)
    assert found["front_right.velocity"] == found["rear_right.velocity"] == pytest.approx(12.4, rel=0.01)
    assert bench.robot.model.read("X") == pytest.approx(found["truth.x"], abs=0.05)


@pytest.mark.parametrize("name", ["pan-tilt", "arm", "skid-steer"])
def test_a_cut_bus_is_a_fault_and_leaves_no_torque(name: str) -> None:
    bench = Bench(name)
    if name in GOALS:
        bench.set(**GOALS[name])
    else:
        bench.stage.setpoint = Setpoint(1.0, 0.8)
    bench.run(0.5)
    assert any(bench.simulated.inputs)
    bench.link.fault = LinkFault.CUT
    bench.run(0.1)
    assert bench.mode is Mode.FAULT
    assert "too old" in bench.cycle.arming.modes.reason
    assert not any(bench.simulated.inputs), "their own watchdogs have acted"
