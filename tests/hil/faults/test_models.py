# SPDX-License-Identifier: MIT
"""Controllers whose outputs or steps are as a fault has them."""

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from segway_ecc.hil.campaign.run import run_and_replay, run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioRun
from segway_ecc.hil.faults.fault import Fault, Injections
from segway_ecc.hil.faults.models import AmissValues, SlowModel, misbehaves, misbehaving
from segway_ecc.node.config import load_robot, packaged_robots
from segway_ecc.node.cycle.state import capture
from segway_ecc.node.errors import ConfigurationError, ModelError
from segway_ecc.node.models.load import load_model
from segway_ecc.node.sequence.manoeuvre import Segment

ROBOTS = [name for name in packaged_robots() if name.startswith(("cart-", "segway"))]
SLOW = Fault(target="model", type="slow", at_s=0.5, for_s=0.5, amount=0.003)
SWINGS = Fault(target="model", type="oscillating", at_s=0.5, for_s=0.5, amount=3.0)
EXCEEDS = Fault(target="model", type="wrong", at_s=0.6)
IS_ELSEWHERE = Fault(target="odometry", type="wrong", at_s=0.7, amount=5.0)
NOT_NUMBERS = Fault(target="model", type="garbage", at_s=0.6)
RAISES = Fault(target="model", type="off", at_s=0.6)
NAMES = ["stand", "OdometryExcess", "Excess", "Oscillating"]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_model_that_can_misbehave_gives_the_bits_of_its_own_until_it_does(name: str) -> None:
    file = load_robot(name)
    source = misbehaving(file).model.source
    one, other = (load_model(model, file.model.parameters) for model in (file.model.source, source))
    assert (one.name, one.step_size, one.inputs, one.outputs) == (
        other.name,
        other.step_size,
        other.inputs,
        other.outputs,
    )
    u = [0.01 * place for place in range(len(one.inputs))]
    assert one.initialize(u) == other.initialize(u)
    assert [one.step(u) for _ in range(5)] == [other.step(u) for _ in range(5)]
    good = one.step(u)
    other.write("Oscillating", 2.0)
    assert [other.step(u)[-2:] for _ in range(3)] == [[2.0, 2.0], [-2.0, -2.0], [2.0, 2.0]]
    other.write("Oscillating", 0.0)
    other.write("OdometryExcess", 100.0)
    wrong = other.step(u)
    assert [value - 100.0 for value in wrong[:5]] == pytest.approx(good[:5], abs=0.1)
    assert wrong[5:-2] == pytest.approx(good[5:-2], abs=0.5)
    other.write("Excess", 1e308)
    assert other.step(u)[-2:] == [1e308, 1e308]
    assert other.read("Excess") == 1e308
    other.write("NotNumbers", 1.0)
    assert all(math.isnan(value) for value in other.step(u)[-2:])
    other.write("Raises", 1.0)
    with pytest.raises(ModelError, match="as the scenario declares"):
        other.step(u)
    assert other.read("WheelRadius") == one.read("WheelRadius")


def test_a_robot_of_another_model_cannot_be_made_to_misbehave() -> None:
    with pytest.raises(ConfigurationError, match="only those of the packaged robots"):
        misbehaving(load_robot("cart"))


def test_what_is_amiss_is_set_by_name_while_it_is() -> None:
    now = [0]
    injections = Injections([SLOW, SWINGS, EXCEEDS, IS_ELSEWHERE], 0, lambda: now[0])
    assert [misbehaves(fault) for fault in (SLOW, SWINGS, EXCEEDS, IS_ELSEWHERE)] == [False, True, True, True]
    values = AmissValues(injections, NAMES)
    injections.timeline.start()
    seen = []
    for now_s in (0.4, 0.5, 0.8, 1.1):
        now[0] = round(now_s * 1e9)
        seen.append([tuple(value) for value in values.take()])
    assert seen == [
        [(3, 0.0), (2, 0.0), (1, 0.0)],
        [(3, 3.0), (2, 0.0), (1, 0.0)],
        [(3, 3.0), (2, 1e308), (1, 5.0)],
        [(3, 0.0), (2, 1e308), (1, 5.0)],
    ]


def test_a_slow_model_takes_its_time_in_each_step_and_is_else_the_one_behind_it() -> None:
    now, spent = [0], list[float]()
    injections = Injections([SLOW], 0, lambda: now[0])
    model = load_model(load_robot("cart-can").model.source)
    slow = SlowModel(model, injections, spent.append)
    injections.timeline.start()
    u: Sequence[float] = (1.0, 1.0)
    model.initialize(u)
    for now_s in (0.4, 0.5, 0.9, 1.1):
        now[0] = round(now_s * 1e9)
        assert slow.step(u) == [model.read(variable.name) for variable in model.outputs]
    assert spent == [0.003, 0.003]
    assert slow.outputs == model.outputs
    assert slow.save_state() == capture(model)


def scenario(fault: Fault) -> ScenarioRun:
    made = Scenario(
        name="test",
        robot="segway",
        segments=(Segment(linear=0.3, duration=1.0),),
        faults=(fault,),
        expect=Expectation(outcome="faults"),
    )
    return ScenarioRun("test", made, "segway", 0, {})


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (SWINGS, "voltage oscillates: it changed its sign 8 times within 0.2 s, beyond 1.5 V either way"),
        (EXCEEDS, "the model gives left.voltage 1e+308 V, allowed is -18 to 18 V"),
        (IS_ELSEWHERE, "the model moves odometry.x from "),
        (NOT_NUMBERS, "of the model is not finite"),
        (msgspec.structs.replace(SLOW, amount=0.012), "40 of the last 100 deadlines were missed, fewer than 40"),
    ],
)
def test_each_is_a_fault_with_its_reason_and_a_replay_sees_what_the_run_saw(fault: Fault, reason: str) -> None:
    result = run_and_replay(scenario(fault))
    assert result.why_not == ()
    assert reason in result.reason
    assert result.safe_s is not None


def test_a_model_that_raises_stops_the_loop_with_its_motors_off() -> None:
    result = run_scenario(scenario(RAISES))
    assert result.outcome == "stopped"
    assert "failed in cycle" in result.reason
    assert "as the scenario declares" in result.reason
    assert result.safe_s is not None
    assert result.safe_s < 0.01


def test_a_step_that_ends_within_its_period_is_none(tmp_path: Path) -> None:
    result = run_scenario(scenario(SLOW), tmp_path / "log.mcap")
    assert (result.outcome, result.reason, result.max_distance_m) == ("drives_on", "", 0.0)
