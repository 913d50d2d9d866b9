# SPDX-License-Identifier: MIT
"""What sensors measure and what motors push when they fail; the truth stays true."""

from collections.abc import Sequence

import pytest

from segway_ecc.hil.errors import PlantMismatchError
from segway_ecc.hil.faults.fault import _FOR_GOOD, KINDS, Fault, Injections, Target, Type
from segway_ecc.hil.faults.plant import DisturbedPlant
from segway_ecc.node.model.model import Variable
from segway_ecc.node.model.sectioned import SectionedModel

STEP_S = 0.01
TARGETS: Sequence[Target] = ("imu", "encoder", "left_motor", "right_motor", "battery")


class Counter(SectionedModel):
    """Every sensor shows the number of the step, and the truth what was pushed."""

    name = "counter"
    step_size = STEP_S
    inputs = (Variable("left.voltage", "V"), Variable("right.voltage", "V"))
    states = (Variable("Count", ""),)
    outputs = tuple(
        Variable(name, "")
        for name in ("left.angle", "right.angle", "imu.angular_velocity_y", "truth.x", "truth.left", "truth.right")
    )

    def input(self, u: Sequence[float]) -> None:
        self.pushed = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - a plain count
        return (1.0 / STEP_S,)

    def output(self) -> Sequence[float]:
        return (*(round(self.s[0]),) * 4, *self.pushed)


def run(target: Target, kind: Type, amount: float | None = None, push: float = 2.0) -> list[list[float]]:
    """Outputs of ten steps, the fault being there from the fifth on, for three steps."""
    now = [0]
    fault = Fault(target=target, type=kind, at_s=0.05, for_s=None if kind == "off" else 0.03, amount=amount)
    faults = Injections([fault], 0, lambda: now[0])
    plant = DisturbedPlant(Counter(), faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    rows = []
    for step in range(1, 11):
        now[0] = step * 10_000_000
        rows.append(plant.step([push, 3.0]))
    return rows


@pytest.mark.parametrize(("name", "shown"), [("angular_velocity_y", 5.5), ("angular_velocity_z", 5)])
def test_a_signal_of_the_imu_may_be_wrong_alone(name: str, shown: float) -> None:
    faults = Injections([Fault(target="imu", type="wrong", at_s=0.0, amount=0.5, name=name)], 0, lambda: 0)
    plant = DisturbedPlant(Counter(), faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    rows = [plant.step([2.0, 3.0]) for _ in range(5)]
    assert rows[-1][:4] == [5, 5, shown, 5]


def test_what_is_exchanged_is_the_wheels_or_the_axes() -> None:
    now = [0]
    faults = Injections(
        [Fault(target=target, type="swapped", at_s=0.0) for target in ("left_motor", "encoder", "imu")],
        0,
        lambda: now[0],
    )
    plant = DisturbedPlant(Exchanged(), faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    assert plant.step([2.0, 3.0]) == [2.0, 3.0, 20.0, 30.0, 200.0, 100.0, 300.0, 3.0]


class Exchanged(SectionedModel):
    """What it was given, right first, and an IMU."""

    name = "exchanged"
    step_size = STEP_S
    inputs = (Variable("left.voltage", "V"), Variable("right.voltage", "V"))
    outputs = tuple(
        Variable(name, "")
        for name in (
            "left.angle",
            "right.angle",
            "left.velocity",
            "right.velocity",
            "imu.angular_velocity_x",
            "imu.angular_velocity_y",
            "imu.angular_velocity_z",
            "truth.left",
        )
    )

    def input(self, u: Sequence[float]) -> None:
        self.pushed = u

    def output(self) -> Sequence[float]:
        left, right = self.pushed
        return left, right, 10.0 * left, 10.0 * right, 100.0, 200.0, 300.0, left


def column(rows: list[list[float]], place: int) -> list[float]:
    return [row[place] for row in rows]


LEFT, RIGHT, GYRO, TRUTH, PUSHED_LEFT, PUSHED_RIGHT = range(6)
COUNT = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]


@pytest.mark.parametrize(
    ("kind", "amount", "seen"),
    [
        ("stuck", None, [1, 2, 3, 4, 4, 4, 4, 8, 9, 10]),
        ("wrong", None, [1, 2, 3, 4, -5, -6, -7, 8, 9, 10]),
        ("wrong", 0.5, [1, 2, 3, 4, 5.5, 6.5, 7.5, 8, 9, 10]),
        ("delayed", 0.02, [1, 2, 3, 4, 3, 4, 5, 8, 9, 10]),
        ("intermittent", 1.0, [1, 2, 3, 4, 0, 0, 0, 8, 9, 10]),
        ("slow", 0.01, [1, 2, 3, 4, 4.5, 5.25, 6.125, 8, 9, 10]),
    ],
)
def test_the_left_wheels_encoder(kind: Type, amount: float | None, seen: list[float]) -> None:
    rows = run("encoder", kind, amount)
    assert column(rows, LEFT) == seen
    for place in (RIGHT, GYRO, TRUTH):
        assert column(rows, place) == COUNT


def test_an_encoder_that_is_off_reads_zero_for_good() -> None:
    assert column(run("encoder", "off"), LEFT) == [1, 2, 3, 4, 0, 0, 0, 0, 0, 0]


def test_noise_stays_within_its_bound_and_changes() -> None:
    seen = column(run("encoder", "garbage", 0.5), LEFT)
    assert all(abs(value) <= 0.5 for value in seen[4:7])
    assert len(set(seen[4:7])) == 3
    assert seen == column(run("encoder", "garbage", 0.5), LEFT)


def test_the_imu() -> None:
    rows = run("imu", "stuck")
    assert column(rows, GYRO) == [1, 2, 3, 4, 4, 4, 4, 8, 9, 10]
    assert column(rows, LEFT) == column(rows, TRUTH) == COUNT


def test_an_imu_that_loses_frames_measures_right() -> None:
    assert column(run("imu", "intermittent", 1.0), GYRO) == COUNT


@pytest.mark.parametrize(
    ("target", "kind", "amount", "left", "right"),
    [
        ("left_motor", "wrong", None, -2.0, 3.0),
        ("left_motor", "wrong", 0.25, 0.5, 3.0),
        ("right_motor", "stuck", 7.0, 2.0, 7.0),
        ("right_motor", "intermittent", 1.0, 2.0, 0.0),
        ("battery", "slow", 0.5, 1.0, 1.5),
        ("battery", "intermittent", 1.0, 0.0, 0.0),
    ],
)
def test_motors(target: Target, kind: Type, amount: float | None, left: float, right: float) -> None:
    rows = run(target, kind, amount)
    assert column(rows, PUSHED_LEFT) == [*[2.0] * 4, *[left] * 3, *[2.0] * 3]
    assert column(rows, PUSHED_RIGHT) == [*[3.0] * 4, *[right] * 3, *[3.0] * 3]
    assert column(rows, LEFT) == COUNT


@pytest.mark.parametrize("target", ["left_motor", "battery"])
def test_motors_that_are_off(target: Target) -> None:
    now = [60_000_000]
    faults = Injections([Fault(target=target, type="off", at_s=0.0)], 0, lambda: now[0])
    plant = DisturbedPlant(Counter(), faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    assert plant.step([2.0, 3.0])[4:] == [0.0, 3.0 if target == "left_motor" else 0.0]


def test_a_motor_stuck_without_an_amount_keeps_what_it_gave_last() -> None:
    now = [0]
    faults = Injections([Fault(target="left_motor", type="stuck", at_s=0.02)], 0, lambda: now[0])
    plant = DisturbedPlant(Counter(), faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    pushed = []
    for step, push in enumerate((1.0, 5.0, 8.0, 9.0)):
        now[0] = step * 10_000_000
        pushed.append(plant.step([push, 0.0])[PUSHED_LEFT])
    assert pushed == [1.0, 5.0, 5.0, 5.0]


def test_the_rest_is_the_plants() -> None:
    counter = Counter()
    plant = DisturbedPlant(counter, Injections([], 0, lambda: 0))
    plant.initialize([0.0, 0.0])
    plant.terminate()
    assert (plant.name, plant.step_size, plant.stopped) == ("counter", STEP_S, False)
    assert (plant.inputs, plant.outputs, plant.states) == (Counter.inputs, Counter.outputs, Counter.states)
    assert plant.parameters == ()
    assert plant.read("Count") == 0.0


class BatchCounter(Counter):
    """Remembers how many steps it was asked for at a time."""

    def initial(self) -> None:
        self.batches: list[int] = []

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        self.batches.append(steps)
        for _ in range(steps):
            outputs = self.step(u)
        return outputs


FAULTS = [(target, kind) for target in TARGETS for kind in KINDS[target]]
EACH_STEP = {
    *((motor, kind) for motor in ("left_motor", "right_motor") for kind in ("garbage", "slow", "intermittent")),
    ("battery", "intermittent"),
    ("imu", "slow"),
    ("encoder", "slow"),
}


@pytest.mark.parametrize(("target", "kind"), FAULTS)
def test_steps_are_made_at_once_unless_a_fault_is_another_in_each(target: Target, kind: Type) -> None:
    """Two substeps of five steps before the fault is there, and two after."""
    now, at_once = [0], BatchCounter()
    fault = Fault(target=target, type=kind, at_s=0.1)
    faults = Injections([fault], 0, lambda: now[0])
    plant = DisturbedPlant(at_once, faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    for substep in range(4):
        now[0] = substep * 50_000_000
        plant.advance([2.0, 3.0], 5)
    each = [1] * 5
    before = each * 2 if kind == "delayed" else [5, 5]
    after = each * 2 if kind == "delayed" or (target, kind) in EACH_STEP else [5, 5]
    assert at_once.batches == before + after


@pytest.mark.parametrize(
    ("target", "kind"),
    [fault for fault in FAULTS if fault[1] not in {"garbage", "intermittent"}],
)
def test_substeps_end_where_single_steps_do(target: Target, kind: Type) -> None:
    """Faults without chance in them, over substeps of five steps, at whose ends somebody looks."""

    def seen(*, are_substeps: bool) -> list[list[float]]:
        now = [0]
        fault = Fault(target=target, type=kind, at_s=0.1, for_s=None if (target, kind) in _FOR_GOOD else 0.1)
        faults = Injections([fault], 0, lambda: now[0])
        plant = DisturbedPlant(Counter(), faults)
        plant.initialize([0.0, 0.0])
        faults.timeline.start()
        rows = []
        for substep in range(8):
            now[0] = substep * 50_000_000
            push = [2.0 + substep, 3.0 - substep]
            if are_substeps:
                rows.append(plant.advance(push, 5))
            else:
                rows += [plant.step(push) for _ in range(5)][-1:]
        return rows

    assert seen(are_substeps=True) == seen(are_substeps=False)


class Arm(SectionedModel):
    """Two axes that are no wheels: their angles are the number of the step, and the truth what was pushed."""

    name = "arm"
    step_size = STEP_S
    inputs = (Variable("shoulder.torque", "N m"), Variable("elbow.torque", "N m"))
    outputs = tuple(Variable(name, "") for name in ("shoulder.angle", "elbow.angle", "truth.shoulder", "truth.elbow"))

    def initial(self) -> None:
        self.steps = 0

    def input(self, u: Sequence[float]) -> None:
        self.pushed = u
        self.steps += 1

    def output(self) -> Sequence[float]:
        return (float(self.steps),) * 2 + tuple(self.pushed)


def of_arm(fault: Fault) -> list[float]:
    """What an arm with a fault shows after the fifth step of a push of 2 and 3."""
    faults = Injections([fault], 0, lambda: 0)
    plant = DisturbedPlant(Arm(), faults)
    plant.initialize([0.0, 0.0])
    faults.timeline.start()
    return [plant.step([2.0, 3.0]) for _ in range(5)][-1]


@pytest.mark.parametrize(
    ("fault", "shown"),
    [
        (Fault(target="motor", type="off", at_s=0.0, name="elbow"), [6.0, 6.0, 2.0, 0.0]),
        (Fault(target="motor", type="wrong", at_s=0.0, name="shoulder"), [6.0, 6.0, -2.0, 3.0]),
        (Fault(target="encoder", type="off", at_s=0.0, name="elbow"), [6.0, 0.0, 2.0, 3.0]),
        (Fault(target="encoder", type="wrong", at_s=0.0, name="shoulder", amount=0.5), [6.5, 6.0, 2.0, 3.0]),
        (Fault(target="battery", type="slow", at_s=0.0, amount=0.5), [6.0, 6.0, 1.0, 1.5]),
        (Fault(target="battery", type="off", at_s=0.0), [6.0, 6.0, 0.0, 0.0]),
    ],
)
def test_motors_encoders_and_the_battery_of_any_axes_fail(fault: Fault, shown: list[float]) -> None:
    assert of_arm(fault) == shown


@pytest.mark.parametrize(
    ("fault", "begins"),
    [
        (Fault(target="left_motor", type="off", at_s=0.0), "left."),
        (Fault(target="motor", type="off", at_s=0.0, name="wrist"), "wrist."),
        (Fault(target="motor", type="off", at_s=0.0, name="elb"), "elb."),
        (Fault(target="encoder", type="stuck", at_s=0.0), "left."),
        (Fault(target="right_motor", type="swapped", at_s=0.0), "left. or right."),
    ],
)
def test_an_axis_that_is_not_there_is_refused_with_those_that_are(fault: Fault, begins: str) -> None:
    with pytest.raises(PlantMismatchError) as caught:
        of_arm(fault)
    assert f"disturbs what begins with {begins}: the plant has none of it; its parts are shoulder, elbow" in str(
        caught.value
    )
