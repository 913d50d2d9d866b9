# SPDX-License-Identifier: MIT
"""Writes from outside while the cycle runs: one place that checks, tries, applies, records and answers."""

from collections.abc import Sequence

import pytest

from segway_ecc.node.cycle.interfaces import Written
from segway_ecc.node.cycle.setpoints import SetpointRefusal
from segway_ecc.node.errors import ConfigurationError, ModelFailedError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.testing import Bench, RecordingHardware


class Motor(SectionedModel):
    """Voltage = demand / resistance; the demand is a state that anybody may set."""

    name = "motor"
    step_size = 0.01
    method = Method.DISCRETE
    parameters = (
        Variable("Resistance", "Ohm", 2.0, Write.STATIC),
        Variable("Gain", "1", 1.0, Write.STATIC, tunable=True),
    )
    states = (Variable("Demand", "V", 1.0, Write.NOW, minimum=-5.0, maximum=5.0),)
    outputs = (Variable("Voltage", "V"), Variable("X", "m"))
    awkward = 0.0

    def static(self) -> None:
        self.per_gain = 1.0 / self.p["Gain"]

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        return s

    def output(self) -> Sequence[float]:
        return [self.s[0] / self.p["Resistance"], 0.0]

    def write(self, name: str, value: float) -> None:
        if value == self.awkward != 0.0:
            self.s[0] = 99.0
            raise ValueError("awkward")
        super().write(name, value)


WIRING = {"Demand": "set.demand", "Voltage": "left.voltage", "X": "odometry.x"}


def make(*, arm_at_start: bool = True) -> Bench:
    hardware = RecordingHardware({}, {"left.voltage": "V"}, (30.0,))
    return Bench(Motor(), hardware, WIRING, arm_at_start=arm_at_start)


@pytest.fixture
def bench() -> Bench:
    return make()


def test_a_write_of_what_is_not_tunable_is_refused_while_armed_and_taken_while_not(bench: Bench) -> None:
    bench.stage.send_write(5, {"Resistance": 4.0})
    bench.stage.send_request(7, Action.DISARM)
    bench.stage.send_write(9, {"Resistance": 4.0})
    bench.loop.run(cycles=12)
    assert bench.stage.write_answers == ["'Resistance' is not tunable while the robot is armed: disarm it first", ""]
    records = bench.recorder.records
    assert records[5].mode is Mode.ARMED
    assert records[5].inbox is not None
    assert records[5].inbox.written == [Written("Resistance", 4.0, bench.stage.write_answers[0])]
    assert records[9].inbox is not None
    assert (records[9].inbox.written, records[9].inbox.writes) == ([Written("Resistance", 4.0)], [])
    assert [records[n].y[0] for n in (5, 8, 9)] == [0.5, 0.5, 0.25]


@pytest.mark.parametrize("arm_at_start", [True, False])
def test_a_parameter_with_which_the_model_would_fail_does_not_end_the_loop(*, arm_at_start: bool) -> None:
    bench = make(arm_at_start=arm_at_start)
    for cycle, values in ((5, {"Gain": 0.0}), (6, {"Gain": 2.0, "Resistance": 0.0}), (7, {"Gain": 2.0})):
        bench.stage.send_write(cycle, values)
    bench.loop.run(cycles=12)
    assert [bool(answer) for answer in bench.stage.write_answers] == [True, True, False]
    assert (bench.model.read("Gain"), bench.model.read("Resistance")) == (2.0, 2.0)
    assert bench.recorder.records[-1].mode is (Mode.ARMED if arm_at_start else Mode.DISARMED)
    shown = bench.loop.statuses()[2].values
    assert (shown["parameters.written"], shown["parameters.refused"]) == ("1", "2")


@pytest.mark.parametrize(
    ("value", "cause"),
    [
        (5.1, SetpointRefusal.OUT_OF_RANGE),
        (-5.1, SetpointRefusal.OUT_OF_RANGE),
        (float("nan"), SetpointRefusal.NOT_FINITE),
        (3.0, SetpointRefusal.REFUSED_BY_MODEL),
    ],
)
def test_a_set_value_that_cannot_be_is_refused_and_counted_and_the_robot_drives_on(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, value: float, cause: SetpointRefusal
) -> None:
    monkeypatch.setattr(Motor, "awkward", 3.0)
    bench.stage.set_value(5, 0, 2.0)
    bench.stage.set_value(7, 0, value)
    bench.loop.run(cycles=12)
    assert bench.cycle.schedule.refused == {cause: 1}
    assert [record.y[0] for record in bench.recorder.records[5:]] == [1.0] * 7
    assert bench.loop.modes.mode is Mode.ARMED


def test_a_model_that_cannot_be_put_back_is_a_fault(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_data: bytes) -> None:
        raise LookupError("torn")

    monkeypatch.setattr(Motor, "save_state", lambda _: b"", raising=False)
    monkeypatch.setattr(Motor, "restore_state", lambda _, data: fail(data), raising=False)
    bench.stage.send_write(5, {"Gain": 0.0})
    with pytest.raises(ModelFailedError, match=r"^model 'motor' failed in cycle 5 when a write was taken back: Lookup"):
        bench.loop.run(cycles=12)
    last = bench.recorder.records[-1]
    assert last.mode is Mode.FAULT
    assert last.inbox is not None
    assert (last.inbox.writes, [each[:2] for each in last.inbox.written]) == ([], [("Gain", 0.0)])


def test_a_set_point_is_bounded_by_what_it_is_wired_to() -> None:
    bench = Bench(
        Motor(),
        RecordingHardware({}, {"left.voltage": "V"}, (30.0,)),
        {**WIRING, "Demand": "setpoint.linear_velocity"},
    )
    assert bench.cycle._wiring.largest == (5.0, float("inf"))


def test_a_set_point_that_may_not_be_zero_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Motor, "states", (Variable("Demand", "V", 1.0, Write.NOW, minimum=0.5),))
    with pytest.raises(
        ConfigurationError, match=r"^wiring: 'setpoint.linear_velocity' is zero at rest, which the range"
    ):
        Bench(
            Motor(),
            RecordingHardware({}, {"left.voltage": "V"}, (30.0,)),
            {**WIRING, "Demand": "setpoint.linear_velocity"},
        )
