"""The segway's motors behind their drives, and the battery they share.

A motor is the equivalent DC motor (any text on electric drives): L di/dt = u - R i - K w at a shaft speed w, and torque
K i. Over one step the speed is taken to be constant, which gives the current exactly, however short L / R is against
the step; what the body gets is the torque's mean over the step.

The battery is a source with a resistance, V = V0 - Rb P / V, where P = u i summed over both motors is what they take
(or give back: V then rises). V on the right is that of the step before. It never falls below V0 / 2, where a source
gives the most that it can.
"""

import math
from typing import Final

from node.models.segway_parameters import SegwayParameters

_LOWEST_SHARE: Final = 0.5


class Battery:
    """A source with a resistance.

    Attributes:
        voltage: At its terminals, V.
    """

    def __init__(self, parameters: SegwayParameters) -> None:
        """Charge it; nothing takes current yet."""
        self._source = parameters.supply_voltage
        self._resistance = parameters.supply_resistance
        self.voltage = self._source

    def deliver(self, power: float) -> None:
        """Give `power`, W; negative is taken back."""
        sag = self._resistance * power / self.voltage
        self.voltage = max(self._source - sag, _LOWEST_SHARE * self._source)


class VoltageMotor:
    """A motor at a voltage, with the drive's limit of its current.

    Attributes:
        value: Current, A.
        power: What it takes from the battery, W: the mean over the last step.
    """

    def __init__(self, parameters: SegwayParameters, step: float) -> None:
        """Switch it on without current; `step` in s."""
        p = parameters
        self.value = self.power = 0.0
        self._resistance = p.motor_resistance
        self._at_wheel = p.motor_constant * p.gear_ratio
        self._most = p.torque_limit / self._at_wheel
        self._decay, self._mean = _lag(step, p.motor_inductance / p.motor_resistance)

    def torque(self, voltage: float, speed: float, supply: float) -> float:
        """Mean torque of one step at the wheel, N m.

        Args:
            voltage: As commanded, V; no more than the supply has can come.
            speed: Of the wheel against the body, rad/s.
            supply: Of the battery, V.
        """
        back_emf = self._at_wheel * speed
        current = (_clamp(voltage, supply) - back_emf) / self._resistance
        settled = _clamp(current, self._most)
        mean = settled + (self.value - settled) * self._mean
        self.value = settled + (self.value - settled) * self._decay
        self.power = (back_emf + self._resistance * settled) * mean
        return self._at_wheel * mean


class TorqueMotor:
    """A motor in a torque loop, a first-order lag, which reaches no further than the supply's voltage.

    Attributes:
        value: Torque at the wheel, N m.
        power: What it takes from the battery, W: the mean over the last step.
    """

    def __init__(self, parameters: SegwayParameters, step: float) -> None:
        """Switch it on without torque; `step` in s."""
        p = parameters
        self.value = self.power = 0.0
        self._at_wheel = p.motor_constant * p.gear_ratio
        self._resistance = p.motor_resistance
        self._limit = p.torque_limit
        self._decay, self._mean = _lag(step, p.torque_time_constant)

    def torque(self, command: float, speed: float, supply: float) -> float:
        """Mean torque of one step at the wheel, N m; see `VoltageMotor.torque`."""
        back_emf = self._at_wheel * speed
        settled = _clamp(command, self._limit)
        voltage = back_emf + self._resistance * settled / self._at_wheel
        if not -supply <= voltage <= supply:
            voltage = _clamp(voltage, supply)
            settled = self._at_wheel * (voltage - back_emf) / self._resistance
        mean = settled + (self.value - settled) * self._mean
        self.value = settled + (self.value - settled) * self._decay
        self.power = voltage * mean / self._at_wheel
        return mean


def _lag(step: float, time_constant: float) -> tuple[float, float]:
    """What is left of a first-order lag's start value after a step, and in its mean over the step."""
    if time_constant <= 0.0:
        return 0.0, 0.0
    decay = math.exp(-step / time_constant)
    return decay, (1.0 - decay) * time_constant / step


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(value, limit))
