# SPDX-License-Identifier: MIT
"""The controller alone: what it sends for what it is told it measures, by hand-made numbers."""

import itertools
import math

import pytest
from msgspec.structs import astuple

from segway_ecc.hil.verbs.design_gains import designed
from segway_ecc.node.config import load_robot
from segway_ecc.node.errors import ModelError
from segway_ecc.node.models.segway import STEP_SIZE, SegwayController, SegwayVoltageController
from segway_ecc.node.models.segway_law import Phase

G = 9.80665
GAINS = load_robot("segway").model.parameters
INPUTS = [v.name for v in SegwayController.inputs]


def inputs(pitch: float = 0.0, **others: float) -> list[float]:
    values = {"AccelerationX": -G * math.sin(pitch), "AccelerationZ": G * math.cos(pitch), **others}
    return [values.get(name, 0.0) for name in INPUTS]


def controller(kind: type[SegwayController] = SegwayController, **parameters: float) -> SegwayController:
    return kind({**GAINS, **parameters})


def told(model: SegwayController, *names: str) -> list[float]:
    return [model.read(name) for name in names]


def balancing(kind: type[SegwayController] = SegwayController, **parameters: float) -> SegwayController:
    """One that was put upright, stood up at once and balances, at rest."""
    model = controller(kind, **parameters)
    model.initialize(inputs())
    for _ in range(200):
        model.step(inputs())
    assert model.read("Phase") == Phase.BALANCING
    return model


@pytest.mark.parametrize("pitch", [-0.5, 0.0, 0.4])
def test_the_first_inputs_give_the_pitch(pitch: float) -> None:
    model = controller()
    model.initialize(inputs(pitch))
    assert told(model, "Pitch", "X", "Heading", "LeftTorque", "RightTorque") == pytest.approx([pitch, 0, 0, 0, 0])


def test_nothing_is_estimated_or_sent_before_the_first_acceleration() -> None:
    model = controller()
    model.initialize([0.0] * len(INPUTS))
    for _ in range(400):
        model.step([0.0] * len(INPUTS))
    assert told(model, "Phase", "Pitch", "EstimatedSince", "LeftTorque") == [Phase.RESTING, 0.0, 0.0, 0.0]
    model.step(inputs(0.3))
    assert model.read("Pitch") == pytest.approx(0.3)


def test_it_rests_while_it_settles_and_then_pushes_to_where_it_leans() -> None:
    model = controller()
    model.initialize(inputs(0.5))
    sent = []
    for _ in range(140):
        model.step(inputs(0.5))
        sent.append(told(model, "Phase", "LeftTorque", "RightTorque"))
    assert sent[98] == [Phase.RESTING, 0.0, 0.0]
    assert sent[105][0] == Phase.STANDING_UP
    assert sent[139][1] == sent[139][2] == pytest.approx(1.3)


def test_noise_does_not_make_it_stand_up_before_it_knows_how_it_lies() -> None:
    """One sample that happened to agree was enough, with the pitch still 0.1 rad off."""
    model = controller()
    model.initialize(inputs())
    model.write("Stand", 0.0)
    for _ in range(200):
        model.step(inputs())
    noise, pitch = 0.1, 0.5  # it was laid down, unseen
    for _ in range(60):
        noise = -noise
        model.step(inputs(pitch + noise))
    model.write("Stand", 1.0)
    while model.read("Phase") == Phase.RESTING:
        noise = -noise
        model.step(inputs(pitch + noise))
    assert model.read("Phase") == Phase.STANDING_UP
    assert model.read("Pitch") == pytest.approx(pitch, abs=0.05)


def test_a_gyro_that_is_off_is_learnt_at_rest() -> None:
    model = controller()
    model.initialize(inputs(0.5, GyroY=0.02, GyroZ=-0.03))
    model.write("Stand", 0.0)
    for _ in range(600):
        model.step(inputs(0.5, GyroY=0.02, GyroZ=-0.03))
    assert told(model, "PitchRate", "AngularVelocity", "Heading") == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)
    assert told(model, "EstimatedPitchBias", "EstimatedYawBias")[0] == pytest.approx(0.02, abs=1e-4)
    assert model.read("Pitch") == pytest.approx(0.5, abs=1e-3)


def test_pitch_follows_the_gyro_at_once_and_the_accelerometer_slowly() -> None:
    model = balancing()
    for _ in range(20):
        model.step(inputs(0.0, GyroY=1.0, LeftVelocity=-1.0, RightVelocity=-1.0))
    assert model.read("Pitch") == pytest.approx(0.1, abs=0.006)
    quiet = balancing()
    quiet.step(inputs(0.2))
    assert 0.0 < quiet.read("Pitch") < 0.001


def test_what_speeding_up_does_to_the_accelerometer_is_no_lean() -> None:
    model, ahead = balancing(), 2.0
    radius = model.p["WheelRadius"]
    for i in range(100):
        speed = ahead * (i + 1) * STEP_SIZE / radius
        model.step(inputs(0.0, AccelerationX=ahead, LeftVelocity=speed, RightVelocity=speed))
    assert model.read("Pitch") == pytest.approx(0.0, abs=1e-3)
    assert model.read("LinearVelocity") == pytest.approx(1.0, rel=1e-6)


def test_encoders_turn_with_the_body() -> None:
    model = balancing()
    # The body pitches by 0.2 rad about wheels that stand: the encoders turn back as far.
    for i in range(40):
        pitch = 0.2 * (i + 1) / 40
        model.step(inputs(pitch, GyroY=1.0, **dict.fromkeys(("LeftAngle", "RightAngle"), -pitch)))
    assert model.read("X") == pytest.approx(0.0, abs=5e-4)


def test_odometry_follows_the_wheels_and_the_gyro() -> None:
    model = balancing()
    p = model.p
    radius, rate = p["WheelRadius"], 0.5
    for i in range(round(math.pi / rate / STEP_SIZE)):
        way = 0.25 * (i + 1) * STEP_SIZE
        heading = rate * (i + 1) * STEP_SIZE
        left, right = (way - heading * p["Track"] / 2) / radius, (way + heading * p["Track"] / 2) / radius
        speeds = (0.25 - rate * p["Track"] / 2) / radius, (0.25 + rate * p["Track"] / 2) / radius
        model.step(
            inputs(GyroZ=rate, LeftAngle=left, RightAngle=right, LeftVelocity=speeds[0], RightVelocity=speeds[1])
        )
    # Half a circle of radius v / w = 0.5 m to the left.
    assert told(model, "X", "Y", "Heading") == pytest.approx([0.0, 1.0, math.pi], abs=0.01)


def test_the_torque_of_a_lean_is_the_gains() -> None:
    model = balancing()
    before = model.read("ReferenceSent")
    rate = 0.01
    model.step(inputs(0.0, GyroY=rate, LeftVelocity=-rate, RightVelocity=-rate))
    pitch = model.read("Pitch")
    travel = model.p["WheelRadius"] * pitch
    expected = -GAINS["PitchGain"] * pitch - GAINS["PitchRateGain"] * rate - GAINS["TravelGain"] * travel
    assert model.read("ReferenceSent") - before == pytest.approx(expected, rel=0.02)
    assert model.read("LeftTorque") == model.read("RightTorque") == 0.5 * model.read("ReferenceSent")


def test_torques_are_limited_and_turning_has_what_balance_leaves() -> None:
    model = balancing()
    model.write("AngularSetpoint", 2.0)
    for _ in range(40):
        model.step(inputs(0.3, GyroY=3.0))
        assert max(abs(torque) for torque in told(model, "LeftTorque", "RightTorque")) <= 1.3 + 1e-12
    assert told(model, "LeftTorque", "RightTorque") == pytest.approx([1.3, 1.3])


def test_a_turn_to_the_left_pushes_the_right_wheel() -> None:
    model = balancing()
    model.write("AngularSetpoint", 1.0)
    for _ in range(60):
        model.step(inputs())
    left, right = told(model, "LeftTorque", "RightTorque")
    assert right - left > 0.1


def test_set_points_are_ramped_and_the_reference_stays_within_reach() -> None:
    model = balancing(MaxTravelError=0.2)
    model.write("LinearSetpoint", 5.0)
    speeds = []
    for _ in range(800):
        model.step(inputs())
        speeds.append(model.read("ReferenceVelocity"))
        assert abs(model.read("ReferenceTravel") - model.read("EstimatedTravel")) <= 0.2 + 1e-12
    gains = [(b - a) / STEP_SIZE for a, b in itertools.pairwise(speeds)]
    assert max(gains) <= 0.8 + 1e-9
    assert speeds[-1] == pytest.approx(1.5, abs=0.02)
    assert max(speeds) < 1.55


def test_the_integral_waits_while_the_motors_are_at_their_limit() -> None:
    model = balancing()
    for _ in range(5):
        model.step(inputs(0.0, GyroY=3.0))
    held = model.read("ReferenceIntegral")
    model.step(inputs(0.0, GyroY=3.0, LeftAngle=5.0, RightAngle=5.0))
    assert model.read("ReferenceIntegral") == held


def test_it_gives_up_when_it_does_not_get_up_and_waits_for_sit_and_stand() -> None:
    model = controller()
    model.initialize(inputs(0.5))
    phases = []
    for _ in range(2000):
        model.step(inputs(0.5))
        phases.append(model.read("Phase"))
    at = phases.index(Phase.GIVEN_UP) * STEP_SIZE
    assert at == pytest.approx(0.5 + 3.0, abs=0.03)
    assert phases[-1] == Phase.GIVEN_UP
    assert told(model, "LeftTorque", "RightTorque") == [0.0, 0.0]
    model.write("Stand", 0.0)
    model.step(inputs(0.5))
    assert model.read("Phase") == Phase.RESTING
    model.write("Stand", 1.0)
    for _ in range(110):
        model.step(inputs(0.5))
    assert model.read("Phase") == Phase.STANDING_UP


def test_wheels_that_turn_as_in_the_air_make_it_give_up_at_once() -> None:
    model = balancing()
    for _ in range(13):
        model.step(inputs(LeftVelocity=100.0, RightVelocity=100.0))
    assert model.read("Phase") == Phase.GIVEN_UP


def test_down_for_half_a_second_it_gives_up() -> None:
    model = balancing()
    model.step(inputs(0.5, GyroY=0.5 / STEP_SIZE))
    model.step(inputs(0.5, GyroY=0.5 / STEP_SIZE))
    steps = 0
    while model.read("Phase") == Phase.BALANCING:
        model.step(inputs(0.5))
        steps += 1
        assert steps < 200
    assert steps * STEP_SIZE == pytest.approx(0.5, abs=0.03)
    assert model.read("Phase") == Phase.GIVEN_UP


def test_sit_down_leans_ahead_lands_brakes_and_rests() -> None:
    model = balancing()
    model.write("Stand", 0.0)
    model.step(inputs())
    assert model.read("Phase") == Phase.SITTING_DOWN
    assert model.read("ReferenceSent") < 0.0  # the wheels roll back from under the body
    for _ in range(2):
        model.step(inputs(0.5, GyroY=0.25 / STEP_SIZE))
    for _ in range(2):  # it may not change by more than TorqueSlew
        model.step(inputs(0.5, LeftVelocity=10.0, RightVelocity=10.0))
    assert model.read("ReferenceSent") == pytest.approx(-2.0 * 0.5)
    for _ in range(50):
        model.step(inputs(0.5))
    assert model.read("Phase") == Phase.RESTING
    assert told(model, "LeftTorque", "RightTorque") == [0.0, 0.0]


def test_who_asks_a_robot_that_sits_down_to_stand_knows_that_it_lies() -> None:
    model = balancing()
    model.write("Stand", 0.0)
    model.step(inputs())
    model.write("Stand", 1.0)
    model.step(inputs())
    assert model.read("Phase") == Phase.RESTING
    for _ in range(99):
        model.step(inputs(0.5))
        assert told(model, "LeftTorque", "RightTorque") == [0.0, 0.0], "what it lies like is learnt first"
    for _ in range(100):
        model.step(inputs(0.5))
    assert model.read("Phase") == Phase.STANDING_UP


def test_a_robot_that_does_not_get_down_rests_after_a_while_too() -> None:
    model = balancing()
    model.write("Stand", 0.0)
    for _ in range(round(3.1 / STEP_SIZE)):
        model.step(inputs())
    assert model.read("Phase") == Phase.RESTING


def test_voltages_are_those_that_give_the_torques() -> None:
    torque, voltage = balancing(), balancing(SegwayVoltageController)
    u = inputs(0.0, GyroY=0.05, LeftVelocity=20.0, RightVelocity=20.0)
    torque.step(u)
    voltage.step(u)
    push = torque.read("LeftTorque")
    expected = 0.075 * push / 0.0251 + 0.0251 * 20.0
    assert voltage.read("LeftVoltage") == pytest.approx(expected)
    assert voltage.read("RightVoltage") == pytest.approx(expected)


def test_voltages_stop_at_the_supply_and_are_zero_at_rest() -> None:
    model = balancing(SegwayVoltageController, SupplyVoltage=1.0)
    model.step(inputs(0.0, GyroY=5.0))
    assert model.read("LeftVoltage") == 1.0
    resting = controller(SegwayVoltageController)
    resting.initialize(inputs(0.5, LeftVelocity=10.0))
    resting.step(inputs(0.5, LeftVelocity=10.0))
    assert told(resting, "LeftVoltage", "RightVoltage") == [0.0, 0.0]


def test_states_expose_estimate_reference_and_phase() -> None:
    model = balancing()
    model.write("LinearSetpoint", 0.5)
    for _ in range(20):
        model.step(inputs(0.02, GyroY=0.1, GyroZ=0.2, LeftVelocity=1.0, RightVelocity=2.0))
    holds = [*astuple(model.estimate), *astuple(model.motion), *astuple(model.progress)]
    assert told(model, *(v.name for v in model.states[3:])) == holds
    assert sum(value != 0.0 for value in holds) == 25, "so that the line above could have failed"


def test_one_that_is_started_again_knows_nothing_of_before() -> None:
    again, new = balancing(), controller()
    assert again.initialize(inputs(0.3)) == new.initialize(inputs(0.3))
    for _ in range(200):
        assert again.step(inputs(0.3, GyroY=0.01)) == new.step(inputs(0.3, GyroY=0.01))


def test_a_parameter_that_is_written_acts_in_the_next_step() -> None:
    torque, voltage = balancing(), balancing(SegwayVoltageController)
    torque.write("TorqueLimit", 0.25)
    voltage.write("SupplyVoltage", 0.5)
    for model in (torque, voltage):
        model.step(inputs(0.0, GyroY=5.0))
    assert told(torque, "LeftTorque", "RightTorque") == [0.25, 0.25]
    assert told(voltage, "LeftVoltage", "RightVoltage") == [0.5, 0.5]


def test_controller_without_gains_refuses_to_start_with_the_remedy() -> None:
    with pytest.raises(ModelError, match=r"has no gains: `segway-ecc design gains`"):
        SegwayController().initialize(inputs())


def test_every_gain_that_is_designed_is_a_parameter() -> None:
    assert set(designed(load_robot("segway")).gains) <= {v.name for v in SegwayController.parameters}
