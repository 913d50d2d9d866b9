# SPDX-License-Identifier: MIT
"""What encoders and IMU should show in windows of a run, for many sets of quantities at once.

The equations of motion are those of `segway_ecc.hil.plants.segway_body` on level ground, integrated by the midpoint
rule in two steps a sample. A tyre creeps: its wheel turns faster than it rolls in proportion to its torque (the linear
range of any tyre model; Pacejka, "Tire and Vehicle Dynamics", 3rd ed., 1.2). Friction at rest is smoothed over 0.2
rad/s, which these steps can follow. The IMU shows mean accelerations over half a sample.

Arrays have the axes: set of quantities, window, and where there is one, sample.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from segway_ecc.hil.design.linear_model import Matrix
from segway_ecc.hil.identify.quantities import Quantity
from segway_ecc.hil.identify.windows import CHANNELS, HISTORY, SAMPLES, Windows
from segway_ecc.node.models.segway_parameters import SegwayParameters, model_name

_SUBSTEPS: Final = 2
_COULOMB_SPEED: Final = 0.2
_IMU: Final = len(CHANNELS) - 2
LOST: Final = 4
"""Samples at a window's beginning whose IMU values may be of before it."""


class Predictor:
    """Simulates windows of a robot, of which some quantities are tried out and the rest is known."""

    def __init__(self, p: SegwayParameters, quantities: Sequence[Quantity], *, voltage: bool) -> None:
        """Take the robot, the quantities in the order of their coordinates, and whether a command is a voltage."""
        self._p, self._voltage = p, voltage
        self._names = [q.name for q in quantities]
        self._sizes = np.array([q.is_size for q in quantities])

    def predict(self, coordinates: Matrix, windows: Windows, start: Matrix) -> Matrix:
        """The channels: sets by windows by samples by 8.

        Args:
            coordinates: Sets by quantities.
            windows: With the commands.
            start: Sets by windows by 6, see `Windows.start`.
        """
        values = np.where(self._sizes, np.exp(np.where(self._sizes, coordinates, 0.0)), coordinates)
        of = {name: values[:, [place]] for place, name in enumerate(self._names)}
        robot = _Robot(self._p, of, voltage=self._voltage)
        step = windows.period_s / _SUBSTEPS
        commands = _means(windows, of["Delay"][:, 0], step)
        state = [start[:, :, place].copy() for place in range(6)]
        shown = np.empty((SAMPLES * _SUBSTEPS - 1, *state[0].shape, _IMU))
        angles = np.empty((SAMPLES, *state[0].shape, 2))
        for n in range(SAMPLES * _SUBSTEPS - 1):
            if n % _SUBSTEPS == 0:
                angles[n // _SUBSTEPS, ..., 0], angles[n // _SUBSTEPS, ..., 1] = state[4], state[5]
            rates = robot.rates(state, *np.moveaxis(commands[n], -1, 0))
            middle = [x + 0.5 * step * dx for x, dx in zip(state, rates, strict=True)]
            rates = robot.rates(middle, *np.moveaxis(commands[n], -1, 0))
            state = [x + step * dx for x, dx in zip(state, rates, strict=True)]
            shown[n] = robot.motion(state, rates)
        imu = _delayed(shown, of["ImuLatency"][:, 0] / step)
        return np.moveaxis(np.concatenate([angles, _distorted(imu, of)], axis=-1), 0, 2)


class _Robot:
    """The equations, with quantities as columns."""

    def __init__(self, p: SegwayParameters, of: dict[str, Matrix], *, voltage: bool) -> None:
        def value(name: str) -> Matrix:
            return of.get(model_name(name), np.array([[getattr(p, name)]]))

        mass, height, radius = value("body_mass"), value("body_height_of_centre"), value("wheel_radius")
        track, yaw = value("track"), value("body_yaw_inertia")
        rolling = p.wheel_mass + value("wheel_inertia") / radius**2
        second = mass * height**2
        self.gravity, self.radius, self.half_track = p.gravity, radius, 0.5 * track
        self.mass, self.moment = mass + 2.0 * rolling, mass * height
        self.pitching = second + value("body_pitch_inertia")
        self.turning = yaw + 2.0 * p.wheel_diameter_inertia + 0.5 * rolling * track**2
        self.excess = second + value("body_roll_inertia") - yaw
        self.viscous, self.coulomb = value("viscous_friction"), value("coulomb_friction")
        at_wheel = value("motor_constant") * p.gear_ratio
        self.gain = at_wheel / value("motor_resistance") if voltage else np.ones((1, 1))
        self.back = at_wheel * self.gain if voltage else np.zeros((1, 1))
        self.off_braking = of["OffBraking"]
        self.limit, self.creep, self.imu_height = p.torque_limit, of["TyreCreep"], value("imu_height")

    def rates(self, state: Sequence[Matrix], left: Matrix, right: Matrix, active: Matrix) -> tuple[Matrix, ...]:
        """How fast v, q, w, pitch and the wheels' angles change."""
        v, q, w, pitch, _, _ = state
        rolling, steer = v / self.radius - q, w * self.half_track / self.radius
        speed_left, speed_right = rolling - steer, rolling + steer
        back = self.back * (active + self.off_braking * (1.0 - active))
        left, right = self._torque(left, back, speed_left), self._torque(right, back, speed_right)
        sin, cos = np.sin(pitch), np.cos(pitch)
        both, coupling = left + right, self.moment * cos
        excess_sin = self.excess * sin
        ahead = self.moment * sin * (q * q + w * w) + both / self.radius
        turning = excess_sin * cos * w * w + self.moment * self.gravity * sin - both
        yaw = (right - left) * self.half_track / self.radius - w * (2.0 * excess_sin * cos * q + self.moment * sin * v)
        determinant = self.mass * self.pitching - coupling * coupling
        return (
            (self.pitching * ahead - coupling * turning) / determinant,
            (self.mass * turning - coupling * ahead) / determinant,
            yaw / (self.turning + excess_sin * sin),
            q,
            speed_left + self.creep * left,
            speed_right + self.creep * right,
        )

    def _torque(self, command: Matrix, back: Matrix, speed: Matrix) -> Matrix:
        """Of a wheel on the ground, N m, friction taken off."""
        driven = np.clip(self.gain * command - back * speed, -self.limit, self.limit)
        return driven - self.viscous * speed - self.coulomb * np.tanh(speed / _COULOMB_SPEED)

    def motion(self, state: Sequence[Matrix], rates: Sequence[Matrix]) -> Matrix:
        """What a perfect IMU shows; see `SegwayBody.measured_motion`."""
        v, q, w, pitch, _, _ = state
        dv, dq, dw, *_ = rates
        sin, cos, height = np.sin(pitch), np.cos(pitch), self.imu_height
        sideways = w * sin
        shown = (
            -sideways,
            q,
            w * cos,
            dv * cos + height * (dq - w * sideways * cos) - self.gravity * sin,
            v * w + height * (dw * sin + 2.0 * w * q * cos),
            dv * sin - height * (q * q + sideways * sideways) + self.gravity * cos,
        )
        return np.stack(np.broadcast_arrays(*shown), axis=-1)


def _means(windows: Windows, delay_s: Matrix, step: float) -> Matrix:
    """The mean command over each step, each command acting `delay_s` late: steps by sets by windows by sides.

    A command comes in within a step, as behind the lag of a motor, so that the mean has a slope at every delay: it is a
    second difference of the second integral of what was sent.
    """
    commands, period = windows.commands, windows.period_s
    zero = np.zeros_like(commands[:, :1])
    once = np.concatenate([zero, np.cumsum(commands, axis=1)], axis=1) * period
    twice = np.concatenate([zero, np.cumsum(once[:, :-1] * period + 0.5 * commands * period**2, axis=1)], axis=1)
    times = (np.arange(SAMPLES * _SUBSTEPS + 1) - 0.5)[:, None] * step - delay_s[None, :] + HISTORY * period
    whole = np.clip(np.floor(times / period).astype(int), 0, commands.shape[1] - 1)
    since = (times - whole * period)[..., None, None]

    def at(values: Matrix) -> Matrix:
        return np.moveaxis(values[:, whole], 0, 2)

    integral = at(twice) + at(once) * since + 0.5 * at(commands) * since**2
    means: Matrix = np.diff(integral, n=2, axis=0) / step**2
    return means


def _delayed(shown: Matrix, steps: Matrix) -> Matrix:
    """What the IMU has shown at each sample, `steps` after it was so; `shown` begins one step after the window."""
    places = np.arange(SAMPLES)[:, None] * _SUBSTEPS - 1.0 - steps[None, :]
    whole = np.clip(np.floor(places).astype(int), 0, len(shown) - 2)
    share = np.clip(places - whole, 0.0, 1.0)[..., None, None]
    sets = np.arange(shown.shape[1])[None, :]
    delayed: Matrix = shown[whole, sets] * (1.0 - share) + shown[whole + 1, sets] * share
    return delayed


def _distorted(imu: Matrix, of: dict[str, Matrix]) -> Matrix:
    """Turn by the mounting, scale, and add biases."""

    def axes(name: str) -> Matrix:
        return np.stack([of[f"{name}{axis}"] for axis in "XYZ"], axis=-1)

    mounting = axes("Mounting")
    parts = []
    for place, kind in enumerate(("Gyro", "Accelerometer")):
        true = imu[..., 3 * place : 3 * place + 3]
        parts.append(of[f"{kind}Scale"][..., None] * (true - np.cross(mounting, true)) + axes(f"{kind}Bias"))
    return np.concatenate(parts, axis=-1)
