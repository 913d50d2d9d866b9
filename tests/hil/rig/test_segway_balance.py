# SPDX-License-Identifier: MIT
"""The packaged segways in lock step over their buses, with sensor errors on: what they do, by the plant's truth."""

import pytest
from msgspec import structs

from segway_ecc.hil.design.balance import Balance, Truth
from segway_ecc.node.config import load_robot
from segway_ecc.node.models.segway_law import Phase
from segway_ecc.node.models.segway_parameters import PUBLISHED
from segway_ecc.node.safety.modes import Mode

STOP = PUBLISHED.stop_angle


def window(truth: list[Truth], start: float, end: float) -> list[Truth]:
    found = [at for at in truth if start <= at.time < end]
    assert found
    return found


def largest(values: list[float]) -> float:
    return max(abs(value) for value in values)


@pytest.mark.parametrize("pitch", [STOP, -STOP])
def test_it_stands_up_from_either_stop_and_holds_its_place_for_20_s(pitch: float) -> None:
    balance = Balance(load_robot("segway"), pitch=pitch)
    truth = balance.run(20.0)
    phases = [phase for i, phase in enumerate(balance.phases) if i == 0 or phase != balance.phases[i - 1]]
    assert phases == [Phase.RESTING, Phase.STANDING_UP, Phase.BALANCING]
    assert balance.loop.modes.mode is Mode.ARMED
    assert largest([at.pitch for at in window(truth, 0.0, 0.45)]) == pytest.approx(STOP, abs=1e-6)
    calm = window(truth, 5.0, 20.0)
    assert largest([at.pitch for at in calm]) < 0.03
    assert largest([at.x - calm[0].x for at in calm]) < 0.10
    assert largest([at.heading - calm[0].heading for at in calm]) < 0.05


def test_it_tracks_1_m_per_s_and_1_rad_per_s_and_sits_down_on_request() -> None:
    balance = Balance(load_robot("segway"), pitch=STOP)
    truth = balance.run(
        20.0,
        {
            3.0: lambda b: b.drive(1.0, 0.0),
            8.0: lambda b: b.drive(0.0, 0.0),
            11.0: lambda b: b.drive(0.0, 1.0),
            14.0: lambda b: b.drive(0.0, 0.0),
            16.0: lambda b: b.stand(0.0),
        },
    )
    cruising, turning = window(truth, 6.0, 8.0), window(truth, 12.5, 14.0)
    assert sum(at.linear_velocity for at in cruising) / len(cruising) == pytest.approx(1.0, abs=0.05)
    assert largest([at.linear_velocity - 1.0 for at in cruising]) < 0.15
    assert sum(at.angular_velocity for at in turning) / len(turning) == pytest.approx(1.0, abs=0.03)
    assert largest([at.pitch for at in window(truth, 2.5, 16.0)]) < 0.25
    assert balance.phases[-1] == Phase.RESTING
    assert Phase.GIVEN_UP not in balance.phases
    down = window(truth, 19.0, 20.0)
    assert largest([at.pitch - STOP for at in down]) < 1e-6
    assert largest([at.linear_velocity for at in down]) < 0.01
    impact = max(at.pitch_rate for at in window(truth, 16.0, 20.0))
    assert impact < 1.2  # falling freely it would be some 4.5 rad/s


@pytest.mark.parametrize("robot", ["segway", "segway-odrive", "segway-moteus", "segway-hoverboard"])
def test_no_write_of_a_parameter_makes_it_fall_and_its_limits_are_tuned_while_it_drives(robot: str) -> None:
    balance = Balance(load_robot(robot), pitch=STOP)
    truth = balance.run(
        11.0,
        {
            3.0: lambda b: b.drive(1.0, 0.0),
            4.0: lambda b: b.write(WheelRadius=0.0),
            4.1: lambda b: b.write(WheelRadius=-0.05),
            4.2: lambda b: b.write(Track=0.0),
            4.3: lambda b: b.write(BiasTime=0.0),
            4.4: lambda b: b.write(PitchGain=-123.0),
            4.5: lambda b: b.write(MaxSpeed=0.5, MaxAcceleration=9.0),
            5.0: lambda b: b.write(MaxSpeed=0.5, MaxAcceleration=0.3),
        },
    )
    assert [bool(refusal) for refusal in balance.refusals] == [True] * 6 + [False]
    assert balance.refusals[0] == "'WheelRadius' cannot be 0.0: allowed is 0.045 to 0.055 m"
    assert balance.refusals[4] == "'PitchGain' is not tunable while the robot is armed: disarm it first"
    assert balance.loop.modes.mode is Mode.ARMED
    assert balance.phases[-1] == Phase.BALANCING
    assert largest([at.pitch for at in window(truth, 2.5, 11.0)]) < 0.25
    assert largest([at.linear_velocity - 0.5 for at in window(truth, 10.0, 11.0)]) < 0.15


@pytest.mark.parametrize("force", [50.0, -50.0])
def test_it_recovers_from_a_push_and_returns_to_its_place(force: float) -> None:
    balance = Balance(load_robot("segway"), pitch=STOP, seed=2)
    truth = balance.run(
        12.0,
        {
            3.0: lambda b: b.plant.write("PushForce", force),
            3.1: lambda b: b.plant.write("PushForce", 0.0),
        },
    )
    before, after = window(truth, 2.5, 3.0), window(truth, 11.0, 12.0)
    assert largest([at.linear_velocity for at in window(truth, 3.0, 4.0)]) > 0.5
    assert balance.phases[-1] == Phase.BALANCING
    assert Phase.GIVEN_UP not in balance.phases
    assert largest([at.pitch for at in after]) < 0.03
    assert (
        abs(after[-1].x - before[-1].x) < 0.6
    )  # what a push takes it further than MaxTravelError, it does not go back


def test_knocked_over_it_gives_up_in_time_and_stays_down_until_requested_to_sit_and_stand() -> None:
    # Without what watches it, which would switch the motors off for good.
    balance = Balance(structs.replace(load_robot("segway"), safety=None), pitch=STOP)
    balance.run(
        12.0,
        {
            3.0: lambda b: b.plant.write("PushForce", 150.0),
            3.2: lambda b: b.plant.write("PushForce", 0.0),
            8.0: lambda b: b.stand(0.0),
            8.5: lambda b: b.stand(1.0),
        },
    )
    period = 0.005
    at = balance.phases.index(Phase.GIVEN_UP) * period
    assert 3.0 < at < 4.5
    assert set(balance.phases[round(at / period) : round(7.9 / period)]) == {Phase.GIVEN_UP}
    assert balance.phases[-1] == Phase.BALANCING


def test_the_same_seed_gives_the_same_bits_and_another_one_others() -> None:
    runs = [Balance(load_robot("segway"), pitch=STOP, seed=seed).run(2.0) for seed in (1, 1, 2)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_on_odrives_with_an_mti_it_does_the_same() -> None:
    balance = Balance(load_robot("segway-odrive"), pitch=STOP)
    truth = balance.run(10.0, {3.0: lambda b: b.drive(1.0, 1.0)})
    moving = window(truth, 7.0, 10.0)
    assert balance.phases[-1] == Phase.BALANCING
    assert sum(at.linear_velocity for at in moving) / len(moving) == pytest.approx(1.0, abs=0.05)
    assert sum(at.angular_velocity for at in moving) / len(moving) == pytest.approx(1.0, abs=0.03)
