# SPDX-License-Identifier: MIT
"""The residual monitor by itself, over motions that are made up by its own equations, and not learnt from pushes."""

import math
from collections.abc import Iterator, Sequence

import pytest
from msgspec.structs import replace

from segway_ecc.node.cycle.state import capture, restore
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.deviations import CAUSES
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.residual import SHOWN, ResidualMonitor, command_places
from segway_ecc.node.safety.settings import MotorSettings, PostureSettings, ResidualSettings, SafetySettings
from segway_ecc.node.safety.tilt import GRAVITY

PERIOD_S = 0.005
MASS, MOMENT, RADIUS, HEIGHT = 5.5, 1.4, 0.05, 0.5
FRICTION = 0.02
SETTINGS = ResidualSettings(
    wheel_radius=RADIUS,
    imu_height=HEIGHT,
    mass=MASS,
    moment=MOMENT,
    coulomb_friction=FRICTION,
    delay_s=0.0,
    payload_kg=0.4,
    slope_rad=0.026,
    friction_n_m=0.008,
    radius_share=0.05,
)
SIGNALS = (
    "left.velocity",
    "right.velocity",
    *(f"imu.angular_velocity_{a}" for a in "xyz"),
    "imu.linear_acceleration_x",
)


def monitor(settings: ResidualSettings = SETTINGS) -> ResidualMonitor:
    return ResidualMonitor((0, 1), (3, 5), (0, 1), settings, PERIOD_S)


def drive(
    seconds: float, *, mass: float = 0.0, slope: float = 0.0, friction: float = 0.0, radius: float = 0.0
) -> Iterator[tuple[Sequence[float], float]]:
    """What a robot that differs so measures as it goes to and fro, and the torque of each wheel, N m."""
    true_radius = RADIUS * (1.0 + radius)
    for step in range(round(seconds / PERIOD_S)):
        t = step * PERIOD_S
        v, dv = 0.6 * math.sin(1.5 * t), 0.9 * math.cos(1.5 * t)
        pitch, q, dq = 0.02 * math.sin(4.0 * t), 0.08 * math.cos(4.0 * t), -0.32 * math.sin(4.0 * t)
        speed = v / true_radius - q
        lifted = MOMENT / MASS
        force = (MASS + mass) * dv + (MOMENT + mass * lifted) * dq + MASS * GRAVITY * slope
        torque = force * true_radius + 2.0 * (FRICTION + friction) * max(-1.0, min(1.0, speed / 0.5))
        yield (speed, speed, 0.0, q, 0.0, dv + HEIGHT * dq - GRAVITY * pitch), 0.5 * torque


def looked(watch: ResidualMonitor, motion: Iterator[tuple[Sequence[float], float]]) -> list[str]:
    said = []
    for values, torque in motion:
        watch.look(View(values, (True,) * len(values), 1, balances=True, sent=(torque, torque)))
        said += [] if watch.warning is None else [watch.warning]
    return said


def test_the_numbers_are_published_with_their_names_and_units_and_begin_with_no_deviation() -> None:
    assert SHOWN == ("residual, N", "payload, kg", "slope, rad", "friction, N m", "radius, 1")
    assert monitor().values == (0.0,) * 5
    assert monitor().warning is None


def test_a_warning_is_there_for_one_cycle() -> None:
    watch, found = monitor(), []
    for values, torque in drive(40.0, slope=0.05):
        watch.look(View(values, (True,) * len(values), 1, balances=True, sent=(torque, torque)))
        found.append(watch.warning)
    assert len([warning for warning in found if warning is not None]) == 1


def test_a_robot_that_moves_as_designed_is_not_warned_of() -> None:
    watch = monitor()
    assert looked(watch, drive(60.0)) == []
    assert watch.deviations.warned == [False] * 4
    assert len(watch.values) == len(SHOWN) == 5


@pytest.mark.parametrize(
    ("cause", "differs", "size"),
    [
        ("payload", {"mass": 1.0}, 1.0),
        ("payload", {"mass": -1.0}, -1.0),
        ("slope", {"slope": 0.05}, 0.05),
        ("slope", {"slope": -0.05}, -0.05),
        ("friction", {"friction": 0.02}, 0.02),
        ("radius", {"radius": -0.1}, -0.1),
        ("radius", {"radius": 0.1}, 0.1),
    ],
)
def test_what_differs_is_named_with_its_size(cause: str, differs: dict[str, float], size: float) -> None:
    watch = monitor()
    said = looked(watch, drive(40.0, **differs))
    assert f"does not move as designed: {cause} {'+' if size > 0.0 else '-'}" in said[0]
    assert watch.estimates[CAUSES.index(cause)] == pytest.approx(size, rel=0.4)
    assert watch.deviations.warned == [each == cause for each in CAUSES]


def test_a_warning_ends_once_the_robot_moves_as_designed_again() -> None:
    watch = monitor()
    looked(watch, drive(30.0, slope=0.05))
    said = looked(watch, drive(60.0))
    assert "the robot moves as designed again: slope" in said[-1]
    assert not any(watch.deviations.warned)


def test_pushes_are_not_learnt_from() -> None:
    watch = monitor()
    for step, (values, torque) in enumerate(drive(40.0)):
        pushed = 0.5 * 20.0 * RADIUS if step % 1000 < 200 else 0.0  # 20 N for a second, every five
        watch.look(View(values, (True,) * len(values), 1, balances=True, sent=(torque - pushed, torque - pushed)))
        assert watch.warning is None


def test_nothing_is_learnt_from_a_robot_that_does_not_balance_or_is_not_measured() -> None:
    lying, blind = monitor(), monitor()
    for values, torque in drive(20.0, slope=0.2):
        lying.look(View(values, (True,) * len(values), 1, balances=False, sent=(torque, torque)))
        blind.look(View(values, (False,) * len(values), 1, balances=True, sent=(torque, torque)))
    assert lying.estimates == blind.estimates == [0.0] * 4


def test_a_late_cycle_begins_anew() -> None:
    watch = monitor()
    for step, (values, torque) in enumerate(drive(20.0, slope=0.2)):
        watch.look(
            View(values, (True,) * len(values), 2 if step % 50 == 0 else 1, balances=True, sent=(torque, torque))
        )
    assert watch.estimates == [0.0] * 4


def test_of_a_voltage_the_motor_makes_the_torque() -> None:
    resistance, constant = 0.08, 0.025
    watch = monitor(replace(SETTINGS, motor=MotorSettings(resistance=resistance, constant=constant)))
    for values, torque in drive(30.0, slope=0.05):
        volts = resistance * torque / constant + constant * values[0]
        watch.look(View(values, (True,) * len(values), 1, balances=True, sent=(volts, volts)))
    assert watch.deviations.warned == [False, True, False, False]


def test_commands_count_after_the_delay() -> None:
    sent = [(torque, torque) for _, torque in drive(30.0)]
    watches = {delay_s: monitor(replace(SETTINGS, delay_s=delay_s)) for delay_s in (0.0, 0.05)}
    for watch in watches.values():
        for (values, _), command in zip(drive(30.0), sent[10:], strict=False):  # it acts ten cycles later
            watch.look(View(values, (True,) * len(values), 1, balances=True, sent=command))
    assert abs(watches[0.05].estimates[0]) < 0.01
    assert abs(watches[0.0].estimates[0]) > 0.05


def test_its_state_is_captured_whole_and_goes_on_where_it_was() -> None:
    motion = list(drive(30.0, slope=0.05))
    watch, other = monitor(), monitor()
    looked(watch, iter(motion[:3000]))
    restore(other, capture(watch))
    assert looked(other, iter(motion[3000:])) == looked(watch, iter(motion[3000:]))
    assert other.values == watch.values


def test_the_monitor_compares_with_the_commands_at_their_places() -> None:
    settings = SafetySettings(residual=SETTINGS, posture=PostureSettings(down_rad=0.4))
    signals = (*SIGNALS, "imu.linear_acceleration_y", "imu.linear_acceleration_z")
    commands = ("spare", "left.torque", "right.torque")
    whole, alone = SafetyMonitor(settings, signals, (), 5_000_000, commands), monitor()
    for cycle, (values, torque) in enumerate(drive(1.0, mass=1.0)):
        view = View(values, [True] * len(values), 1, None, PERIOD_S, balances=True, sent=(torque, torque))
        alone.look(view)
        measured = (*values, 0.0, GRAVITY)
        whole.look(measured, [True] * 8, cycle * 5_000_000, 0, None, (9.0, torque, torque), balances=True)
    assert whole.residual is not None
    assert whole.residual.values == alone.values
    assert any(alone.values)


def test_the_monitor_learns_nothing_of_a_robot_of_which_nobody_says_that_it_balances() -> None:
    settings = SafetySettings(residual=SETTINGS, posture=PostureSettings(down_rad=0.4))
    signals = (*SIGNALS, "imu.linear_acceleration_y", "imu.linear_acceleration_z")
    watches = [SafetyMonitor(settings, signals, (), 5_000_000, ("left.torque", "right.torque")) for _ in range(2)]
    for cycle, (values, torque) in enumerate(drive(1.0, mass=1.0)):
        measured, now_ns = (*values, 0.0, GRAVITY), cycle * 5_000_000
        watches[0].look(measured, [True] * 8, now_ns, 0, None, (torque, torque))
        watches[1].look(measured, [True] * 8, now_ns, 0, None, (torque, torque), balances=True)
    found = [watch.residual.estimates for watch in watches if watch.residual is not None]
    assert found[0] == [0.0] * 4
    assert any(found[1])


@pytest.mark.parametrize(
    ("motor", "commands", "places"),
    [
        (None, ("spare", "right.torque", "left.torque"), (2, 1)),
        (MotorSettings(resistance=0.08, constant=0.025), ("left.voltage", "right.voltage", "left.torque"), (0, 1)),
    ],
)
def test_the_commands_are_of_the_kind_that_the_wheels_take(
    motor: MotorSettings | None, commands: tuple[str, ...], places: tuple[int, int]
) -> None:
    assert command_places(replace(SETTINGS, motor=motor), commands) == places


NEEDS = "safety.residual needs safety.posture and the commands left.{0} and right.{0}: with `motor` it is for wheels "


@pytest.mark.parametrize(
    ("settings", "commands"),
    [
        (SafetySettings(residual=SETTINGS, posture=PostureSettings(down_rad=0.4)), ("left.voltage", "right.voltage")),
        (SafetySettings(residual=SETTINGS, posture=PostureSettings(down_rad=0.4)), ("left.torque",)),
        (SafetySettings(residual=SETTINGS, posture=PostureSettings(down_rad=0.4)), ("right.torque",)),
        (SafetySettings(residual=SETTINGS), ("left.torque", "right.torque")),
        (SafetySettings(residual=SETTINGS, posture=PostureSettings(down_rad=0.4)), ()),
    ],
)
def test_it_needs_a_posture_and_its_commands(settings: SafetySettings, commands: tuple[str, ...]) -> None:
    signals = (*SIGNALS, "imu.linear_acceleration_y", "imu.linear_acceleration_z")
    with pytest.raises(ConfigurationError) as refused:
        SafetyMonitor(settings, signals, (), 5_000_000, commands)
    assert str(refused.value) == NEEDS.format("torque") + "that take a voltage, without for a torque"


def test_wheels_that_take_a_voltage_need_commands_of_it() -> None:
    settings = replace(SETTINGS, motor=MotorSettings(resistance=0.08, constant=0.025))
    with pytest.raises(ConfigurationError) as refused:
        command_places(settings, ("left.torque", "right.torque"))
    assert str(refused.value) == NEEDS.format("voltage") + "that take a voltage, without for a torque"
