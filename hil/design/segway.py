# SPDX-License-Identifier: MIT
"""The gains of a segway's controller, designed from what the robot is made of.

The linear models are those of `segway_ecc.hil.plants.segway_body` about standing upright and still, friction left out:

    M v' + m l q' = u / r        m l v' + J q' = m g l pitch - u        Y w' = d t / (2 r)

with u the sum of the wheels' torques and t their difference. The weights follow Bryson's rule: one over the square of
what is tolerable (Franklin, Powell, Emami-Naeini, "Feedback Control of Dynamic Systems", 9.2).
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from segway_ecc.hil.design.linear_model import LinearModel, Margins, Matrix, discretise, lqr, margins, poles, with_delay
from segway_ecc.node.models.segway_parameters import SegwayParameters

MOST_DELAY: Final = 2
"""Periods; the controller feeds back as many torques on their way."""
_BALANCE_TOLERABLE: Final = (0.15, 0.5, 0.15, 1.0, 0.5)
"""Travel (m), velocity (m/s), pitch (rad), pitch rate (rad/s), integral of the travel (m s)."""
_TORQUE_TOLERABLE: Final = 0.5
_YAW_TOLERABLE: Final = (0.2, 1.0)
"""Heading (rad), yaw rate (rad/s)."""
_TURNING_TORQUE_TOLERABLE: Final = 0.2
_STATES: Final = 4


class Loop(NamedTuple):
    """A feedback loop as designed.

    Attributes:
        open_poles: Of the robot alone, continuous, rad/s.
        closed_poles: Of the sampled loop; stable within the unit circle.
        margins: Of the loop broken at the torque.
    """

    open_poles: list[complex]
    closed_poles: list[complex]
    margins: Margins


class Design(NamedTuple):
    """What was designed: the controller's parameters, and the loops that keep it up and in place, and its heading."""

    gains: Mapping[str, float]
    balance: Loop
    yaw: Loop


class _Inertias(NamedTuple):
    """Of the equations above: M (kg), m l (kg m), J and Y (kg m2)."""

    rolling: float
    coupling: float
    pitching: float
    turning: float


def design(p: SegwayParameters, period_s: float, delay: int) -> Design:
    """Design both loops.

    Args:
        p: The robot.
        period_s: Period of the loop, s.
        delay: Whole periods from a measurement until the torque that follows from it acts, 0 to `MOST_DELAY`.
    """
    balance, balance_gain = _close(balance_model(p), period_s, delay, _BALANCE_TOLERABLE, _TORQUE_TOLERABLE)
    yaw, yaw_gain = _close(yaw_model(p), period_s, 0, _YAW_TOLERABLE, _TURNING_TORQUE_TOLERABLE)
    inertias = _inertias(p)
    travel, velocity, pitch, pitch_rate, integral, *under_way = (float(gain) for gain in balance_gain[0])
    sent, sent_before = [*under_way, 0.0, 0.0][:MOST_DELAY]
    heading, yaw_rate = (float(gain) for gain in yaw_gain[0])
    torque_per_acceleration = p.wheel_radius * inertias.rolling
    gains = {
        "TravelGain": travel,
        "VelocityGain": velocity,
        "PitchGain": pitch,
        "PitchRateGain": pitch_rate,
        "SentGain": sent,
        "SentBeforeGain": sent_before,
        "IntegralGain": integral,
        "PitchPerAcceleration": (inertias.coupling + torque_per_acceleration)
        / (p.gravity * p.body_mass * p.body_height_of_centre),
        "TorquePerAcceleration": torque_per_acceleration,
        "HeadingGain": heading,
        "YawRateGain": yaw_rate,
        "TorquePerYawAcceleration": 2.0 * p.wheel_radius * inertias.turning / p.track,
        "SwingLength": inertias.pitching / inertias.coupling,
    }
    return Design(gains, balance, yaw)


def balance_model(p: SegwayParameters) -> LinearModel:
    """Travel, velocity, pitch, pitch rate under the sum of the wheels' torques; continuous."""
    i = _inertias(p)
    inverse = np.linalg.inv(np.array([[i.rolling, i.coupling], [i.coupling, i.pitching]]))
    fall = inverse @ np.array([0.0, p.gravity * i.coupling])
    push = inverse @ np.array([1.0 / p.wheel_radius, -1.0])
    a = np.zeros((_STATES, _STATES))
    a[0, 1] = a[2, 3] = 1.0
    a[1, 2], a[3, 2] = fall
    return LinearModel(a, np.array([[0.0], [push[0]], [0.0], [push[1]]]))


def yaw_model(p: SegwayParameters) -> LinearModel:
    """Heading and yaw rate under the difference of the wheels' torques; continuous."""
    push = p.track / (2.0 * p.wheel_radius * _inertias(p).turning)
    return LinearModel(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [push]]))


def _inertias(p: SegwayParameters) -> _Inertias:
    wheel = p.wheel_mass + p.wheel_inertia / p.wheel_radius**2
    return _Inertias(
        rolling=p.body_mass + 2.0 * wheel,
        coupling=p.body_mass * p.body_height_of_centre,
        pitching=p.body_mass * p.body_height_of_centre**2 + p.body_pitch_inertia,
        turning=p.body_yaw_inertia + 2.0 * p.wheel_diameter_inertia + 0.5 * wheel * p.track**2,
    )


def _close(
    continuous: LinearModel, period_s: float, delay: int, tolerable: Sequence[float], torque_tolerable: float
) -> tuple[Loop, Matrix]:
    """Sample, add the integral of the first state where it is weighed, and the delay; find the gains and their loop."""
    sampled = discretise(continuous, period_s)
    if len(tolerable) > len(sampled.a):
        a = np.pad(sampled.a, (0, 1))
        a[-1, 0], a[-1, -1] = period_s, 1.0
        sampled = LinearModel(a, np.vstack([sampled.b, [[0.0]]]))
    model = with_delay(sampled, delay)
    q = np.pad(np.diag([value**-2 for value in tolerable]), (0, delay))
    gain = lqr(model, q, np.array([[torque_tolerable**-2]]))
    closed = poles(model.a - model.b @ gain)
    return Loop(poles(continuous.a), closed, margins(sampled, gain, period_s)), gain
