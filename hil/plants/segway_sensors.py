"""What the segway measures: wheels by encoders with steps, and motion by an IMU with the errors of a MEMS.

An IMU's errors, per axis: measured = (1 + scale) true + bias + noise. Scale and bias are drawn once, normally
distributed; noise is drawn anew each step, its density being spread over half the sampling rate, though no further than
`BANDWIDTH`. All come from one seed: the same seed gives the same run.
"""

import math
import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from node.models.segway_parameters import SegwayParameters

BANDWIDTH: Final = 100.0
"""Of the IMU's filter, Hz."""
_AXES: Final = 3


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

    Attributes:
        angle: rad, a whole number of counts.
        velocity: rad/s: differences of counts through a first-order filter.
    """

    def __init__(self, parameters: SegwayParameters, step: float, angle: float) -> None:
        """Start at an angle (rad), at rest; one sample each `step` s."""
        self._per_step = 1.0 / step
        counts = parameters.encoder_counts_per_turn
        self._count = 2.0 * math.pi / counts if counts > 0.0 else 0.0
        self._gain = step / (step + parameters.encoder_filter_time)
        self.angle = math.floor(angle / self._count) * self._count if self._count else angle
        self.velocity = 0.0

    def sample(self, angle: float, velocity: float) -> None:
        """Take the true angle (rad) and velocity (rad/s)."""
        if not self._count:
            self.angle, self.velocity = angle, velocity
            return
        counted = math.floor(angle / self._count) * self._count
        self.velocity += self._gain * ((counted - self.angle) * self._per_step - self.velocity)
        self.angle = counted


class Motion(NamedTuple):
    """How the body moves, in the terms of `SegwayBody`.

    Attributes:
        v, q, w: Forward speed, pitch rate, yaw rate; m/s, rad/s, rad/s.
        dv, dq, dw: Their accelerations; m/s2, rad/s2, rad/s2.
        lean: Against the ground's normal, rad.
        pitch: Against the vertical, rad.
    """

    v: float
    q: float
    w: float
    dv: float
    dq: float
    dw: float
    lean: float
    pitch: float


def measured_motion(motion: Motion, height: float, gravity: float) -> Sequence[float]:
    """What a perfect IMU shows `height` m above the axle: angular velocity (rad/s), specific force (m/s2), in its axes.

    The axle's middle accelerates by dv ahead and v w to the left. The point on the body's axis at height h adds, in the
    axes of the body, h (dq - w^2 sin cos) ahead, h (dw sin + 2 w q cos) to the left, and -h (q^2 + w^2 sin^2) along the
    axis, with sin and cos of the lean; gravity's reaction adds -g sin(pitch) ahead and g cos(pitch) along the axis.
    """
    v, q, w, dv, dq, dw, lean, pitch = motion
    sin, cos = math.sin(lean), math.cos(lean)
    sideways = w * sin
    return (
        -sideways,
        q,
        w * cos,
        dv * cos + height * (dq - w * sideways * cos) - gravity * math.sin(pitch),
        v * w + height * (dw * sin + 2.0 * w * q * cos),
        dv * sin - height * (q * q + sideways * sideways) + gravity * math.cos(pitch),
    )


class Imu:
    """Adds an IMU's errors and latency to what a perfect one shows."""

    def __init__(self, errors: ImuErrors, step: float, seed: int, first: Sequence[float]) -> None:
        """Switch it on: it draws its errors from `seed`, samples each `step` s, shows `first` until samples arrive."""
        e, self._random = errors, random.Random(seed)  # noqa: S311 - noise that can be had again, no secret
        spread = math.sqrt(min(0.5 / step, BANDWIDTH))
        self._noise = (*(e.gyro_noise * spread,) * _AXES, *(e.accelerometer_noise * spread,) * _AXES)
        draw = self._random.gauss
        self._bias = [draw(0.0, s) for s in (*(e.gyro_bias,) * _AXES, *(e.accelerometer_bias,) * _AXES)]
        scales = (*(e.gyro_scale,) * _AXES, *(e.accelerometer_scale,) * _AXES)
        self._factor = [1.0 + draw(0.0, s) for s in scales]
        delay = round(e.latency / step)
        self._pipe = deque([self._distort(first) for _ in range(delay)])

    def sample(self, motion: Sequence[float]) -> Sequence[float]:
        """Take a sample; returns the one that arrives."""
        if not self._pipe:
            return self._distort(motion)
        self._pipe.append(self._distort(motion))
        return self._pipe.popleft()

    def _distort(self, motion: Sequence[float]) -> Sequence[float]:
        draw = self._random.gauss
        return [
            factor * x + bias + draw(0.0, noise)
            for x, factor, bias, noise in zip(motion, self._factor, self._bias, self._noise, strict=True)
        ]
