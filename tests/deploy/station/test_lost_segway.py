# SPDX-License-Identifier: MIT
"""The packaged segways lose their base station, in lock step, on simulated time: what their robot files promise."""

from typing import NamedTuple

import pytest

from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import CycleRecord, Heartbeat, Inbox, NoRecorder, NoStage, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode

PERIOD_S = 0.005
DRIVES_FROM_S, LOST_FROM_S, ENDS_S = 3.0, 6.0, 23.0
LOST = "the base station is lost"
STOP_PITCH = 0.4
"""It lies on its stop, at 0.5 rad, from about here on, rad."""


class Seen(NamedTuple):
    time_s: float
    mode: Mode
    pitch: float
    velocity: float
    drives: str


class World(NoStage, NoRecorder):
    """A base station that falls silent, and another node that goes on giving set-points."""

    def __init__(self, name: str) -> None:
        file = load_robot(name)
        rig = LockstepRig.of(hardware_of(file))
        self.simulated = simulated_robot(file, rig.bus.attach("plant"))
        rig.attach(self.simulated)
        self.seen: list[Seen] = []
        self._cycle = 0
        self.loop = build_robot(file, rig, rig.bus.attach("node")).loop(self, self)

    @property
    def time_s(self) -> float:
        return self._cycle * PERIOD_S

    def take_inbox(self) -> Inbox:
        self._cycle += 1
        setpoint = Setpoint(0.5, 0.4) if self.time_s > DRIVES_FROM_S else REST
        beats = [Heartbeat("base", self._cycle)] if self._cycle % 20 == 0 and self.time_s <= LOST_FROM_S else []
        introductions = ["base"] if self._cycle == 1 else []
        return Inbox(setpoints=[StampedSetpoint(setpoint, None)], stations=beats, introductions=introductions)

    def close(self) -> None:
        """Nothing is open."""

    def publish_diagnostics(self, *_: object) -> None:
        """Not looked at."""

    def write_diagnostics(self, *_: object) -> None:
        """Not looked at."""

    def write(self, record: CycleRecord) -> None:
        outputs = dict(zip(self.simulated.output_names, self.simulated.outputs, strict=True))
        drives = "on" if record.sensors.ready else "off"
        pitch, velocity = outputs["truth.pitch"], outputs["truth.linear_velocity"]
        self.seen.append(Seen(self.time_s, record.mode, pitch, velocity, drives))

    def between(self, begin_s: float, end_s: float) -> list[Seen]:
        return [seen for seen in self.seen if begin_s <= seen.time_s < end_s]


@pytest.mark.parametrize("name", ["segway", "segway-odrive"])
def test_a_driving_segway_holds_then_sits_down_and_is_down_before_its_motors_go_off(name: str) -> None:
    world = World(name)
    world.loop.run(round(ENDS_S / PERIOD_S))

    reported = [(transition.mode, transition.reason) for transition in world.loop.modes.history]
    assert reported == [(Mode.ARMED, "asked to arm"), (Mode.HOLD, LOST), (Mode.DISARMED, LOST)]
    armed, held, disarmed = (transition.cycle * PERIOD_S for transition in world.loop.modes.history)
    assert armed < DRIVES_FROM_S
    assert held == pytest.approx(LOST_FROM_S + 1.0, abs=0.011)
    assert disarmed == pytest.approx(LOST_FROM_S + 16.0, abs=0.011)

    assert min(seen.velocity for seen in world.between(LOST_FROM_S - 0.5, LOST_FROM_S + 1.0)) > 0.3, "it is driven"
    holding = world.between(LOST_FROM_S + 4.0, LOST_FROM_S + 10.0)
    assert max(abs(seen.velocity) for seen in holding) < 0.1, "it holds its place"
    assert max(abs(seen.pitch) for seen in holding) < 0.1, "it stands while it does"
    down = world.between(LOST_FROM_S + 14.0, LOST_FROM_S + 16.0)
    assert min(abs(seen.pitch) for seen in down) > STOP_PITCH, "it is down two seconds before its motors go off"
    assert max(abs(seen.velocity) for seen in down) < 0.01
    assert {seen.drives for seen in down} == {"on"}
    assert world.seen[-1].drives == "off"
