# SPDX-License-Identifier: MIT
"""The segway's motors behind their drives, the battery they share, and its sensors: encoders with steps, and an IMU.

A motor is the equivalent DC motor (any text on electric drives): L di/dt = u - R i - K w at a shaft speed w, and torque
K i. While it moves on, by one or more of the plant's steps, the speed is taken to be constant, which gives the current
exactly, however short L / R is against that; what the body gets is the torque's mean. Given the speed of the middle,
the error is of second order.

The battery is a source with a resistance, V = V0 - Rb P / V, where P = u i summed over both motors is what they take
(or give back: V then rises). V on the right is that of the step before. It never falls below V0 / 2, where a source
gives the most that it can.

The IMU's errors are those of a MEMS, per axis: measured = (1 + scale) true + bias + noise. Scale and bias are drawn
once, normally distributed; noise is drawn anew for each sample, its density being spread over half the rate of the
plant's steps, though no further than `BANDWIDTH`. It is white, so samples that nobody asks for need not be drawn: the
others are distributed as ever. All come from one seed: the same seed, asked at the same times, gives the same run, also
where nobody looks at what is asked for (`Imu.pass_over`).
"""

import math
import random
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from segway_ecc.node.models.segway_parameters import SegwayParameters

_LOWEST_SHARE: Final = 0.5
MOST_STEPS: Final = 3
"""By how many steps motors move on at a time, at most."""
BANDWIDTH: Final = 100.0
"""Of the IMU's filter, Hz."""
_AXES: Final = 3
_BITS_DRAWN: Final = 2 * _AXES * 64
"""Of the generator, for the noise of one sample: `random()` takes two words of 32 bits (Lib/random.py of CPython)."""
_TURN: Final = 2.0 * math.pi


class Battery:
    """A source with a resistance; `voltage` is that at its terminals, V."""

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

    Its value is the current, A; its power what it takes from the battery, W, the mean over the last move.
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

    Its value is the torque at the wheel, N m; its power what it takes from the battery, W, the mean over the last move.
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
    """What is left of a first-order lag's start value after no steps, one and so on, s, and in its mean over them."""
    lags = [(1.0, 1.0)]
    for count in range(1, MOST_STEPS + 1):
        decay = math.exp(-count * step / time_constant) if time_constant > 0.0 else 0.0
        lags.append((decay, (1.0 - decay) * max(time_constant, 0.0) / (count * step)))
    return lags


def _clamp(value: float, limit: float) -> float:
    return value if -limit <= value <= limit else math.copysign(limit, value)


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """How far an IMU is off. The defaults are typical of a MEMS for drones; they describe no one part.

    Attributes:
        gyro_noise: Density, rad/s per root Hz.
        gyro_bias: Standard deviation, rad/s, as left by a calibration at power-on.
        gyro_scale: Standard deviation, 1.
        accelerometer_noise: Density, m/s2 per root Hz.
        accelerometer_bias: Standard deviation, m/s2.
        accelerometer_scale: Standard deviation, 1.
        latency: From the motion to the sample, s; rounded to whole steps.
    """

    gyro_noise: float = 2.4e-4
    gyro_bias: float = 5.0e-3
    gyro_scale: float = 5.0e-3
    accelerometer_noise: float = 1.9e-3
    accelerometer_bias: float = 0.05
    accelerometer_scale: float = 5.0e-3
    latency: float = 2.5e-3


class Encoder:
    """One wheel's angle in whole counts and the speed that firmware makes of it, or without counts the true ones.

    The angle, rad, is a whole number of counts; the velocity, rad/s, their differences through a first-order filter.
    """

    def __init__(self, parameters: SegwayParameters, step: float, angle: float) -> None:
        """Start at an angle (rad), at rest; one sample each `step` s."""
        counts = parameters.encoder_counts_per_turn
        self._count = 2.0 * math.pi / counts if counts > 0.0 else 0.0
        self._gain = step / (step + parameters.encoder_filter_time)
        self._per_step = 1.0 / step
        self._step = step
        self._counted = math.floor(angle / self._count) if self._count else 0
        self.angle = self._counted * self._count if self._count else angle
        self.velocity = 0.0

    def follow(self, old_angle: float, old_velocity: float, angle: float, velocity: float, steps: int) -> None:
        """Take a sample at each of the next steps, on the way from one true angle and velocity to another."""
        count = self._count
        if not count:
            self.angle, self.velocity = angle, velocity
            return
        gain, filtered, before, per_step = self._gain, self.velocity, self._counted, count * self._per_step
        if steps > 1:
            old_way, way = old_velocity * self._step, velocity * self._step
            for old_share, old_slope, share, slope in _BETWEEN[steps]:
                between = old_share * old_angle + old_slope * old_way + share * angle + slope * way
                counted = math.floor(between / count)
                filtered += gain * ((counted - before) * per_step - filtered)
                before = counted
        counted = math.floor(angle / count)
        self.velocity = filtered + gain * ((counted - before) * per_step - filtered)
        self.angle, self._counted = counted * count, counted


def _between(steps: int) -> list[tuple[float, float, float, float]]:
    """Cubic Hermite interpolation at each but the last of some steps: what old value, old rate, new ones count for.

    Rates are those in one step. Source: Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I" (2nd ed.),
    section II.6.
    """
    rows = []
    for place in range(1, steps):
        t = place / steps
        rest = 1.0 - t
        slopes = (steps * t * rest * rest, -steps * t * t * rest)
        rows.append(((1.0 + 2.0 * t) * rest * rest, slopes[0], t * t * (3.0 - 2.0 * t), slopes[1]))
    return rows


_BETWEEN: Final = [_between(steps) for steps in range(MOST_STEPS + 1)]


class Imu:
    """Adds an IMU's errors and latency, `delay` whole steps, to what a perfect one shows."""

    def __init__(
        self,
        errors: ImuErrors,
        step: float,
        seed: int,
        first: object,
        motion_of: Callable[[Any], Sequence[float]] = tuple,
    ) -> None:
        """Switch it on at step 0: it draws its errors from `seed`, and shows `first` until samples arrive.

        A sample is what a perfect one shows, or what `motion_of` makes that of, which a sample that nobody sees is not
        worth.
        """
        e, self._random = errors, random.Random(seed)  # noqa: S311 - noise that can be had again, no secret
        spread = math.sqrt(min(0.5 / step, BANDWIDTH))
        noise = (*(e.gyro_noise * spread,) * _AXES, *(e.accelerometer_noise * spread,) * _AXES)
        draw = self._random.gauss
        bias = [draw(0.0, s) for s in (*(e.gyro_bias,) * _AXES, *(e.accelerometer_bias,) * _AXES)]
        scales = (*(e.gyro_scale,) * _AXES, *(e.accelerometer_scale,) * _AXES)
        factor = [1.0 + draw(0.0, s) for s in scales]
        axes = list(zip(factor, bias, noise, strict=True))
        self._errors = [(*one, *other) for one, other in zip(axes[::2], axes[1::2], strict=True)]
        self.delay = round(e.latency / step)
        self._motion_of = motion_of
        self._way: deque[tuple[int, object]] = deque()
        self._arrived = first
        self._undrawn = 1
        self._shown: Sequence[float] = ()
        self.show(0)

    def add_sample(self, step: int, sample: object) -> None:
        """Take a sample at a step, later than those before."""
        self._way.append((step, sample))

    def pass_over(self, step: int) -> None:
        """As `show`, where nobody looks: the noise of what would have been shown is drawn, and not worked out."""
        way, newest = self._way, step - self.delay
        if way and way[0][0] <= newest:
            self._undrawn += 1
            while way and way[0][0] <= newest:
                self._arrived = way.popleft()[1]

    def show(self, step: int) -> Sequence[float]:
        """The newest sample that has arrived by a step."""
        self.pass_over(step)
        if self._undrawn:
            if self._undrawn > 1:
                self._random.getrandbits((self._undrawn - 1) * _BITS_DRAWN)
            self._undrawn = 0
            self._shown = self._distort(self._motion_of(self._arrived))
        return self._shown

    def _distort(self, motion: Sequence[float]) -> Sequence[float]:
        """Add scale, bias, and noise, which is drawn two axes at a time (Box and Muller's method, 1958)."""
        draw, log, sqrt, cos, sin = self._random.random, math.log, math.sqrt, math.cos, math.sin
        shown: list[float] = []
        for x, y, (factor, bias, noise, other_factor, other_bias, other_noise) in zip(
            motion[::2], motion[1::2], self._errors, strict=True
        ):
            radius, angle = sqrt(-2.0 * log(1.0 - draw())), _TURN * draw()
            shown += (
                factor * x + bias + noise * radius * cos(angle),
                other_factor * y + other_bias + other_noise * radius * sin(angle),
            )
        return shown
