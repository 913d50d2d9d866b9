# SPDX-License-Identifier: MIT
"""Several steps at once, against tiny ones: how far substeps are off, and that they change nothing but that."""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import pytest

from segway_ecc.hil.plants.segway import STEP_SIZE, SegwayPlant, SegwayTorquePlant
from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.hil.plants.segway_hardware import Battery, TorqueMotor, VoltageMotor
from segway_ecc.node.models.segway_parameters import PUBLISHED

STEPS: Final = 5
PERIOD: Final = STEPS * STEP_SIZE
TINY: Final = 5.0e-5
REST: Final = (0.0, 0.0)
PERFECT: Final = {"SensorErrors": 0.0}
COUNT: Final = 2 * math.pi / 16384
Plant = SegwayPlant | SegwayTorquePlant


class State(NamedTuple):
    """v (m/s), q, w (rad/s), pitch (rad), the wheels' angles and speeds (rad, rad/s), and the supply (V)."""

    v: float
    q: float
    w: float
    pitch: float
    left: float
    right: float
    left_speed: float
    right_speed: float
    supply: float


class Fine:
    """Body, motors and battery in steps so small that nothing is left to say of them."""

    def __init__(self, motor: type[VoltageMotor | TorqueMotor], pitch: float) -> None:
        self.body, self.battery = SegwayBody(PUBLISHED), Battery(PUBLISHED)
        self.motors = [motor(PUBLISHED, TINY) for _ in range(2)]
        self.body.pitch = pitch

    def run(self, commands: Sequence[float]) -> None:
        for _ in range(round(PERIOD / TINY)):
            speeds = self.body.wheel_speeds()
            torques = [
                motor.torque(command, speed, self.battery.voltage)
                for motor, command, speed in zip(self.motors, commands, speeds, strict=True)
            ]
            self.body.step(TINY, *torques)
            self.battery.deliver(sum(motor.power for motor in self.motors))

    @property
    def state(self) -> State:
        return _state(self.body, self.battery)


def _state(body: SegwayBody, battery: Battery) -> State:
    return State(body.v, body.q, body.w, body.pitch, *body.wheel_angles(), *body.wheel_speeds(), battery.voltage)


def _continued(plant: Plant, fine: Fine) -> None:
    """Have the plant be where the fine one is."""
    body = plant.body
    for name in ("v", "q", "w", "way", "pitch", "heading", "slope"):
        setattr(body, name, getattr(fine.body, name))
    fine.body.accelerate(*(motor.present_torque for motor in fine.motors))
    body.dv, body.dq, body.dw = fine.body.dv, fine.body.dq, fine.body.dw
    plant.battery.voltage = fine.battery.voltage
    for mine, other in zip((plant._left_motor, plant._right_motor), fine.motors, strict=True):
        mine.value = other.value


def _law(state: State, cycle: int, *, in_volts: bool) -> tuple[float, float]:
    """Stands at first, drives ahead later, and turns at last."""
    wanted, turning = (0.6 if cycle >= 130 else 0.0), (1.0 if cycle >= 260 else 0.0)
    both = 22.0 * state.pitch + 3.0 * state.q + 0.7 * (state.v - wanted)
    torques = (0.5 * both + 0.05 * (state.w - turning), 0.5 * both - 0.05 * (state.w - turning))
    if not in_volts:
        return torques
    speeds = (state.left_speed, state.right_speed)
    left, right = (0.075 / 0.0251 * torque + 0.0251 * speed for torque, speed in zip(torques, speeds, strict=True))
    return left, right


CASES = [(SegwayPlant, VoltageMotor, True), (SegwayTorquePlant, TorqueMotor, False)]
Case = tuple[type[Plant], type[VoltageMotor | TorqueMotor], bool]


@pytest.mark.parametrize(("cls", "motor", "in_volts"), CASES)
def test_a_cycle_at_once_is_off_by_less_than_sensors_resolve(
    cls: type[Plant], motor: type[VoltageMotor | TorqueMotor], *, in_volts: bool
) -> None:
    """What a cycle of 5 ms adds: at most a quarter of a count of the encoders, and a tenth of that as a rule."""
    plant, fine = cls(PERFECT), Fine(motor, 0.02)
    plant.initialize(REST)
    errors = []
    for cycle in range(400):
        commands = _law(fine.state, cycle, in_volts=in_volts)
        _continued(plant, fine)
        plant.advance(commands, STEPS)
        fine.run(commands)
        errors.append([a - b for a, b in zip(_state(plant.body, plant.battery), fine.state, strict=True)])
    most = State(*(max(map(abs, column)) for column in zip(*errors, strict=True)))
    usual = State(*(math.sqrt(sum(x * x for x in column) / len(errors)) for column in zip(*errors, strict=True)))
    assert abs(fine.body.w - 1.0) < 0.3  # it drove and turned
    assert max(most.left, most.right) < 0.25 * COUNT
    assert max(usual.left, usual.right) < 0.025 * COUNT
    assert max(most.left_speed, most.right_speed) < 0.01
    assert max(usual.left_speed, usual.right_speed) < 0.001
    assert most.v < 3e-4
    assert most.q < 1e-3
    assert most.w < 2e-5
    assert most.pitch < 2e-5
    assert most.supply < 0.02


@pytest.mark.parametrize(("cls", "motor", "in_volts"), CASES)
def test_it_goes_where_tiny_steps_go(
    cls: type[Plant], motor: type[VoltageMotor | TorqueMotor], *, in_volts: bool
) -> None:
    """Each under the law that holds it up, for two seconds."""
    plant, fine = cls({**PERFECT, "InitialPitch": 0.02}), Fine(motor, 0.02)
    plant.initialize(REST)
    for cycle in range(400):
        plant.advance(_law(_state(plant.body, plant.battery), cycle, in_volts=in_volts), STEPS)
        fine.run(_law(fine.state, cycle, in_volts=in_volts))
    assert plant.body.way == pytest.approx(fine.body.way, abs=1e-3)
    assert plant.body.heading == pytest.approx(fine.body.heading, abs=1e-3)
    assert (plant.body.v, plant.body.w) == pytest.approx((fine.body.v, fine.body.w), abs=1e-3)
    assert plant.body.pitch == pytest.approx(fine.body.pitch, abs=2e-4)


@pytest.mark.parametrize("cls", [SegwayPlant, SegwayTorquePlant])
@pytest.mark.parametrize("name", ["v", "w"])
def test_friction_brings_it_to_rest_without_jitter(cls: type[Plant], name: str) -> None:
    """Lying, with wheels so slow that friction's stiff part is all there is."""
    plant = cls({**PERFECT, "InitialPitch": 0.5})
    plant.initialize(REST)
    setattr(plant.body, name, 0.005)
    speeds = []
    for _ in range(100):
        plant.advance(REST, STEPS)
        speeds.append(getattr(plant.body, name))
    assert speeds == sorted(speeds, reverse=True)
    assert 0.0 <= speeds[-1] < 1e-6


def test_steps_one_by_one_where_friction_is_too_stiff() -> None:
    stiff = {**PERFECT, "CoulombSpeed": 0.01, "InitialPitch": 0.1}
    at_once, stepwise = SegwayTorquePlant(stiff), SegwayTorquePlant(stiff)
    for plant in (at_once, stepwise):
        plant.initialize(REST)
    for _ in range(20):
        at_once.advance((0.1, 0.2), STEPS)
        for _ in range(STEPS):
            stepwise.step((0.1, 0.2))
    # What is left is how the acceleration was known that extrapolates the wheels' speed.
    states = [_state(plant.body, plant.battery) for plant in (at_once, stepwise)]
    assert states[0] == pytest.approx(states[1], rel=1e-5, abs=1e-8)


@pytest.mark.parametrize("sign", [1, -1])
def test_falls_onto_the_stop_as_in_single_steps(sign: int) -> None:
    def fallen(run: Callable[[Plant], object]) -> list[tuple[float, float]]:
        plant = SegwayPlant({**PERFECT, "InitialPitch": sign * 0.3})
        plant.initialize(REST)
        seen = []
        for _ in range(200):
            run(plant)
            seen.append((plant.body.pitch, plant.body.way))
        return seen

    at_once = fallen(lambda plant: plant.advance(REST, STEPS))
    stepwise = fallen(lambda plant: [plant.step(REST) for _ in range(STEPS)])
    assert at_once[-1][0] == sign * 0.5
    for one, other in zip(at_once, stepwise, strict=True):
        assert one == pytest.approx(other, abs=2e-4)


@pytest.mark.parametrize("latency", [0.0, 0.001, 0.0025, 0.005, 0.0075])
def test_the_imu_is_as_late_as_in_single_steps(latency: float) -> None:
    exact = {v.name: 0.0 for v in SegwayTorquePlant.parameters if v.name.startswith(("Gyro", "Accelerometer"))}
    at_once, stepwise = (SegwayTorquePlant({**exact, "InitialPitch": 0.1, "ImuLatency": latency}) for _ in range(2))
    for plant in (at_once, stepwise):
        plant.initialize(REST)
    for cycle in range(40):
        commands = (0.3 * math.sin(cycle), 0.2 * math.cos(cycle))
        one = at_once.advance(commands, STEPS)
        for _ in range(STEPS):
            other = stepwise.step(commands)
        assert one[4:7] == pytest.approx(other[4:7], abs=2e-3)
        assert one[7:10] == pytest.approx(other[7:10], abs=0.03)


def test_encoders_count_at_every_step() -> None:
    """The filter is that of single steps: what it shows is as far off as a count in a step, filtered, may be.

    It lies, so that nothing lets the little that substeps are off grow.
    """
    at_once, stepwise = (SegwayTorquePlant({"InitialPitch": 0.5}) for _ in range(2))
    for plant in (at_once, stepwise):
        plant.initialize(REST)
    differences = []
    for cycle in range(60):
        commands = (0.3 + 0.1 * math.sin(0.3 * cycle), 0.3)
        one = at_once.advance(commands, STEPS)
        for _ in range(STEPS):
            other = stepwise.step(commands)
        assert one[0] == pytest.approx(other[0], abs=2.1 * COUNT)
        differences.append(one[1] - other[1])
    assert max(map(abs, differences)) < COUNT / STEP_SIZE
    assert abs(sum(differences) / len(differences)) < 0.02


def test_the_same_steps_give_the_same_bits() -> None:
    def seen(*substeps: int) -> list[list[float]]:
        plant = SegwayPlant({"InitialPitch": 0.05})
        plant.initialize(REST)
        return [plant.advance((0.3, 0.2), steps) for steps in substeps for _ in range(20)]

    assert seen(5) == seen(5)
    assert seen(1, 2, 5, 10) == seen(1, 2, 5, 10)


@pytest.mark.parametrize("errors", [0.0, 1.0])
def test_steps_that_nobody_looks_at_are_the_same_but_for_what_the_imu_shows(errors: float) -> None:
    one, other = (SegwayPlant({"InitialPitch": 0.05, "SensorErrors": errors}) for _ in range(2))
    for plant in (one, other):
        plant.initialize(REST)
    for step in range(60):
        expected = one.advance((0.3, 0.2), 1)
        if step % 5 == 4:
            assert other.advance((0.3, 0.2), 1) == expected
        else:
            found = list(other.advance_unseen((0.3, 0.2), 1))
            assert found[:4] + found[10:] == expected[:4] + expected[10:]


def test_time_goes_on_by_all_the_steps() -> None:
    plant = SegwayPlant(PERFECT)
    plant.initialize(REST)
    plant.advance(REST, 7)
    plant.step(REST)
    assert plant.time == pytest.approx(0.008)
    plant.advance((1.0, 2.0), 3)
    assert (plant.read("left.voltage"), plant.read("right.voltage")) == (1.0, 2.0)
    assert plant.read("truth.linear_velocity") == plant.body.v


def test_what_is_written_acts_from_the_next_substep_on() -> None:
    pushed, left_alone = SegwayPlant(PERFECT), SegwayPlant(PERFECT)
    for plant in (pushed, left_alone):
        plant.initialize(REST)
        plant.advance(REST, STEPS)
    pushed.write("PushForce", 5.0)
    assert pushed.advance(REST, STEPS) != left_alone.advance(REST, STEPS)
    assert pushed.body.pitch > 0.0
