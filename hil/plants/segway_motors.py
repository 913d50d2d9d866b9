# SPDX-License-Identifier: MIT
"""The segway's motors behind their drives, and the battery they share.

A motor is the equivalent DC motor (any text on electric drives): L di/dt = u - R i - K w at a shaft speed w, and torque
K i. While it moves on, by one or more of the plant's steps, the speed is taken to be constant, which gives the current
exactly, however short L / R is against that; what the body gets is the torque's mean. Given the speed of the middle,
the error is of second order.

The battery is a source with a resistance, V = V0 - Rb P / V, where P = u i summed over both motors is what they take
(or give back: V then rises). V on the right is that of the step before. It never falls below V0 / 2, where a source
gives the most that it can.
"""

import math
from typing import Final

from segway_ecc.node.models.segway_parameters import SegwayParameters

_LOWEST_SHARE: Final = 0.5
MOST_STEPS: Final = 3
"""By how many steps motors move on at a time, at most."""


class Battery:
    """A source with a resistance.

    Attributes:
        voltage: At its terminals, V.
    """

    def __init__(self, parameters: SegwayParameters) -> None:
        """Charge it; nothing takes current yet."""
        self._source = parameters.supply_voltage
        self._resistance = parameters.supply_resistance
        self._lowest = _LOWEST_SHARE * self._source
        self.voltage = self._source

    def deliver(self, power: float) -> None:
        """Give `power`, W; negative is taken back."""
        voltage = self._source - self._resistance * power / self.voltage
        self.voltage = voltage if voltage > self._lowest else self._lowest  # noqa: FURB136 - several times a cycle


class VoltageMotor:
    """A motor at a voltage, with the drive's limit of its current.

    Attributes:
        value: Current, A.
        power: What it takes from the battery, W: the mean over the last move.
    """

    def __init__(self, parameters: SegwayParameters, step: float) -> None:
        """Switch it on without current; `step` in s."""
        p = parameters
        self.value = self.power = 0.0
        self._resistance = p.motor_resistance
        self._at_wheel = p.motor_constant * p.gear_ratio
        self._most = p.torque_limit / self._at_wheel
        self._lags = _lags(step, p.motor_inductance / p.motor_resistance)

    @property
    def present_torque(self) -> float:
        """At the wheel now, N m."""
        return self._at_wheel * self.value

    def torque(self, voltage: float, speed: float, supply: float, steps: int = 1) -> float:
        """Move on; returns the mean torque at the wheel, N m.

        Args:
            voltage: As commanded, V; no more than the supply has can come.
            speed: Of the wheel against the body, rad/s.
            supply: Of the battery, V.
            steps: By how many steps, 1 to `MOST_STEPS`.
        """
        decay, share = self._lags[steps]
        back_emf = self._at_wheel * speed
        current = (_clamp(voltage, supply) - back_emf) / self._resistance
        settled = _clamp(current, self._most)
        behind = self.value - settled
        mean = settled + behind * share
        self.value = settled + behind * decay
        self.power = (back_emf + self._resistance * settled) * mean
        return self._at_wheel * mean


class TorqueMotor:
    """A motor in a torque loop, a first-order lag, which reaches no further than the supply's voltage.

    Attributes:
        value: Torque at the wheel, N m.
        power: What it takes from the battery, W: the mean over the last move.
    """

    def __init__(self, parameters: SegwayParameters, step: float) -> None:
        """Switch it on without torque; `step` in s."""
        p = parameters
        self.value = self.power = 0.0
        self._at_wheel = p.motor_constant * p.gear_ratio
        self._resistance = p.motor_resistance
        self._limit = p.torque_limit
        self._lags = _lags(step, p.torque_time_constant)

    @property
    def present_torque(self) -> float:
        """At the wheel now, N m."""
        return self.value

    def torque(self, command: float, speed: float, supply: float, steps: int = 1) -> float:
        """Move on; returns the mean torque at the wheel, N m; see `VoltageMotor.torque`."""
        decay, share = self._lags[steps]
        back_emf = self._at_wheel * speed
        settled = _clamp(command, self._limit)
        voltage = back_emf + self._resistance * settled / self._at_wheel
        if not -supply <= voltage <= supply:
            voltage = _clamp(voltage, supply)
            settled = self._at_wheel * (voltage - back_emf) / self._resistance
        behind = self.value - settled
        mean = settled + behind * share
        self.value = settled + behind * decay
        self.power = voltage * mean / self._at_wheel
        return mean


def _lags(step: float, time_constant: float) -> list[tuple[float, float]]:
    """`_lag` of no steps, of one, and so on."""
    return [(1.0, 1.0), *(_lag(count * step, time_constant) for count in range(1, MOST_STEPS + 1))]


def _lag(step: float, time_constant: float) -> tuple[float, float]:
    """What is left of a first-order lag's start value after `step` s, and in its mean over them."""
    if time_constant <= 0.0:
        return 0.0, 0.0
    decay = math.exp(-step / time_constant)
    return decay, (1.0 - decay) * time_constant / step


def _clamp(value: float, limit: float) -> float:
    return value if -limit <= value <= limit else math.copysign(limit, value)
