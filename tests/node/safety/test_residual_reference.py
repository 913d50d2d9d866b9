# SPDX-License-Identifier: MIT
"""The residual monitor against its equations, written once more over whole signals, with numpy's least squares."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from segway_ecc.node.safety.check import View
from segway_ecc.node.safety.residual import ResidualMonitor
from segway_ecc.node.safety.settings import MotorSettings, ResidualSettings
from segway_ecc.node.safety.tilt import GRAVITY

Array = NDArray[np.float64]
PERIOD_S = 0.005
LAG_S, WASHOUT_S, MEMORY_S = 0.05, 1.0, 10.0
SETTLES, LONGEST_PUSH, SOLVED_EVERY = 60, 300, 20  # cycles: 0.3, 1.5 and 0.1 s
FORCE_PRIORS, RADIUS_PRIOR = (50.0, 50.0, 500.0), 100.0
TORQUE = ResidualSettings(
    wheel_radius=0.05,
    imu_height=0.5,
    mass=5.5,
    moment=1.4,
    coulomb_friction=0.02,
    viscous_friction=0.003,
    delay_s=0.015,
    payload_kg=0.4,
    slope_rad=0.026,
    friction_n_m=0.008,
    radius_share=0.05,
)
MOTOR = MotorSettings(resistance=0.08, constant=0.025)


class Cycle(NamedTuple):
    """What `look` is given: left, right, gyro, acceleration; of each wheel; periods; whether all is valid."""

    measured: tuple[float, float, float, float]
    sent: tuple[float, float]
    periods: int = 1
    is_valid: bool = True
    balances: bool = True


def low_pass(signal: Array, gain: float, start: float = 0.0) -> Array:
    out, value = np.empty_like(signal), start
    for place, sample in enumerate(signal):
        value += gain * (sample - value)
        out[place] = value
    return out


def filtered(cycles: Sequence[Cycle], s: ResidualSettings) -> dict[str, Array]:
    """Each signal that the equations have, at each cycle that was measured."""
    late = round(s.delay_s / PERIOD_S)
    sent = [0.0] * late + [sum(cycle.sent) for cycle in cycles]
    kept = [place for place, cycle in enumerate(cycles) if cycle.periods == 1 and cycle.is_valid]
    left, right, rate, felt = np.array([cycles[place].measured for place in kept]).T
    rate, felt = (0.5 * (signal + np.concatenate(([0.0], signal[:-1]))) for signal in (rate, felt))
    torque = np.array([sent[place] for place in kept])
    if s.motor is not None:
        torque = s.motor.constant * (torque - s.motor.constant * (left + right)) / s.motor.resistance
    rolling = 0.5 * (np.clip(left / 0.5, -1.0, 1.0) + np.clip(right / 0.5, -1.0, 1.0))
    force = (torque - 2.0 * s.coulomb_friction * rolling - s.viscous_friction * (left + right)) / s.wheel_radius
    ahead = s.wheel_radius * (0.5 * (left + right) + rate)
    gain = PERIOD_S / (LAG_S + PERIOD_S)
    once = {name: low_pass(signal, gain) for name, signal in {"v": ahead, "q": rate, "t": force, "s": rolling}.items()}
    twice = {name: low_pass(signal, gain) for name, signal in once.items()}
    dv, dq = ((once[name] - twice[name]) / LAG_S for name in "vq")
    z = low_pass(low_pass(felt, gain), gain) - s.imu_height * dq - dv
    residual = twice["t"] - s.mass * dv - s.moment * dq
    return {"dv": dv, "dq": dq, "q": twice["q"], "s": twice["s"], "z": z, "residual": residual, "at": np.array(kept)}


def spans(cycles: Sequence[Cycle], at: Array) -> list[range]:
    """The measured cycles that are learnt from: those that follow on a whole settling time of balancing."""
    learnt, waits, before = [], SETTLES, -1
    for cycle in (int(each) for each in at):
        waits = SETTLES if cycle != before + 1 or not cycles[cycle].balances else waits
        learnt.append(waits == 0)
        waits, before = max(waits - 1, 0), cycle
    edges = [place for place, (one, other) in enumerate(pairwise([False, *learnt, False])) if one != other]
    return [range(*edge) for edge in zip(edges[::2], edges[1::2], strict=True)]


def expected(cycles: Sequence[Cycle], s: ResidualSettings) -> tuple[Array, Array]:
    """The residual at each cycle that was measured, and all estimates in the order of the judgements."""
    signals = filtered(cycles, s)
    height = s.moment / s.mass if s.payload_height is None else s.payload_height
    lift, residual = signals["dv"] + height * signals["dq"], signals["residual"]
    gain, kept = PERIOD_S / (WASHOUT_S + PERIOD_S), 1.0 - PERIOD_S / MEMORY_S
    found, rows, tyre_rows = [], [], []
    force, pushed, calm, samples = np.zeros(3), 0, 0, 0
    for span in spans(cycles, signals["at"]):
        ahead, z, turning = (signals[name][span.start : span.stop] for name in ("dv", "z", "q"))
        start = span.start - 1
        washed_ahead = ahead - low_pass(ahead, gain, signals["dv"][start])
        washed_z = z - low_pass(z, gain, signals["z"][start])
        leant = np.cumsum(turning * PERIOD_S * (1.0 - gain) ** -np.arange(1.0, len(turning) + 1))
        leant *= (1.0 - gain) ** np.arange(1.0, len(turning) + 1)
        for step, place in enumerate(span):
            features = np.array((lift[place], 1.0, signals["s"][place]))
            if abs(residual[place] - features @ force) >= 1.0:
                pushed, calm = pushed + 1, SETTLES
                if pushed < LONGEST_PUSH:
                    continue
            else:
                pushed, calm = 0, max(calm - 1, 0)
                if calm:
                    continue
            rows.append((*features, residual[place]))
            tyre_rows.append((washed_ahead[step], 1.0, washed_z[step] + GRAVITY * leant[step]))
            samples += 1
            if samples % SOLVED_EVERY == 0:
                force = weighted(rows, kept, FORCE_PRIORS)
                tyre = weighted(tyre_rows, kept, (RADIUS_PRIOR, 0.0))
                slope = force[1] / (s.mass * GRAVITY)
                found.append((force[0], slope, 0.5 * force[2] * s.wheel_radius, tyre[0]))
    return residual, np.array(found)


def weighted(rows: Sequence[Sequence[float]], kept: float, priors: Sequence[float]) -> Array:
    """Least squares over rows of features and what they give, newer ones with more weight, the priors as samples."""
    *features, wanted = np.array(rows).T
    root = np.sqrt(kept ** np.arange(len(rows) - 1.0, -1.0, -1.0))
    stacked = np.vstack([np.stack(features, axis=1) * root[:, None], np.diag(np.sqrt(priors))])
    solution: Array = np.linalg.lstsq(stacked, np.concatenate([wanted * root, np.zeros(len(priors))]), rcond=None)[0]
    return solution


def run(seconds: float, s: ResidualSettings) -> list[Cycle]:
    """A robot to and fro and round, heavier by 0.8 kg and on a slope, pushed, with gaps, and lying for a while."""
    late = round(s.delay_s / PERIOD_S)
    cycles, torques = [], []
    for step in range(round(seconds / PERIOD_S) + late):
        t = step * PERIOD_S
        v, dv = 0.3 * math.sin(1.5 * t) + 0.02, 0.45 * math.cos(1.5 * t)
        pitch, q, dq = 0.02 * math.sin(4.0 * t), 0.08 * math.cos(4.0 * t), -0.32 * math.sin(4.0 * t)
        speed, turn = v / s.wheel_radius - q, 1.5 * math.sin(0.9 * t)
        left, right = speed - turn, speed + turn
        force = (s.mass + 0.8) * dv + (s.moment + 0.3) * dq + s.mass * GRAVITY * 0.02 + push(t)
        drag = s.coulomb_friction * sum(math.tanh(4.0 * each) for each in (left, right))
        torque = force * s.wheel_radius + drag + 2.0 * s.viscous_friction * speed
        if s.motor is not None:
            torque = torque * s.motor.resistance / s.motor.constant + s.motor.constant * 2.0 * speed
        torques.append(torque)
        measured = (left, right, q, 1.04 * dv + 0.5 * dq - GRAVITY * pitch + 0.1)
        periods, is_valid = (2 if step in {1, 900} else 1), step % 1400 != 1399
        cycles.append(Cycle(measured, (0.0, 0.0), periods, is_valid, balances=not 4.0 < t < 4.2))
    sent = [(0.4 * torque, 0.6 * torque) for torque in torques[late:]]
    return [cycle._replace(sent=each) for cycle, each in zip(cycles, sent, strict=False)]


def push(t: float) -> float:
    """Forces, N: one before anything is known, short ones, and one that lasts so long that it is learnt from."""
    spans_of = {8.0: (0.6, 1.3), 15.0: (17.5, 18.0), -3.0: (10.0, 12.4)}
    return sum(force for force, (begins, ends) in spans_of.items() if begins <= t < ends)


@pytest.mark.parametrize(
    "settings",
    [
        TORQUE,
        replace(TORQUE, motor=MOTOR, delay_s=0.0),
        replace(TORQUE, payload_height=0.7, viscous_friction=0.0, imu_height=0.3),
    ],
    ids=["torque", "voltage", "payload height"],
)
def test_residual_and_estimates_are_those_of_the_equations(settings: ResidualSettings) -> None:
    cycles = run(24.0, settings)
    watch = ResidualMonitor((0, 1), (2, 3), (0, 1), settings, PERIOD_S)
    residuals, estimates = [], []
    for cycle in cycles:
        held = watch.estimates
        valid = (cycle.is_valid,) * 4
        watch.look(View(cycle.measured, valid, cycle.periods, balances=cycle.balances, sent=cycle.sent))
        if cycle.periods == 1 and cycle.is_valid:
            residuals.append(watch.residual)
        if watch.estimates is not held:
            estimates.append(watch.estimates)
    wanted_residuals, wanted_estimates = expected(cycles, settings)
    assert np.allclose(residuals, wanted_residuals, rtol=1e-9, atol=1e-9)
    assert len(estimates) == len(wanted_estimates) > 100
    assert np.allclose(estimates, wanted_estimates, rtol=1e-7, atol=1e-9)
