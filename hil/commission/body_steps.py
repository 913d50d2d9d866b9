# SPDX-License-Identifier: MIT
"""The steps with the body in hand: IMU axes and mounting, zero of pitch, wheel radius, track; see `wheel_steps`."""

import math
from typing import Final

from segway_ecc.firmware_io.imus.mounting import Mounting
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.commission import mounting
from segway_ecc.hil.commission.expected import Expected
from segway_ecc.hil.commission.person import Task
from segway_ecc.hil.commission.session import SIDES, Session, StepRefusedError
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.node.config import NoHardwareSection
from segway_ecc.node.safety.tilt import GRAVITY

_AS_DECLARED: Final = ("+x", "+y", "+z")
_STILL_S: Final = 1.0
_STILL_RAD_S: Final = 0.1
"""What a gyro shows at rest at the most, its bias and a steady hand's motion."""
_GRAVITY_TOLERANCE: Final = 0.5
_IN_G: Final = 0.1
"""An accelerometer that feels so much of gravity, 1 +- this, gives it in g."""
_LEAST_TILT: Final = 0.3
_TILT_TOLERANCE: Final = 0.2
"""Of the angle by the gyro, against that by the accelerometer; a hand shakes."""
_MANY_TIMES: Final = 10.0
"""A gyro that turns so much too far gives degrees, 57 times as many; its frames may end before that."""
_QUARTER: Final = 0.5 * math.pi
_QUARTER_TOLERANCE: Final = 0.35
_MOST_ZERO: Final = 0.035
"""Of the pitch at which the robot balances, rad: what its integral of travel takes up with a lean nobody sees."""
_METRE: Final = 1.0
_RADIUS_TOLERANCE: Final = 0.05
_TRACK_TOLERANCE: Final = 0.1
_STRAIGHT: Final = 0.05


def imu(session: Session, _expected: Expected) -> Found:
    """Hold upright, tilt forward, tilt right, turn left: what accelerometer and gyro make of it."""
    upright, bias = _still(session, Task.HOLD_UPRIGHT)
    forward_turn, forward = _moved(session, Task.TILT_FORWARD, bias)
    session.ask(Task.HOLD_UPRIGHT)
    right_turn, right = _moved(session, Task.TILT_RIGHT, bias)
    session.ask(Task.HOLD_UPRIGHT)
    left_turn, _ = _moved(session, Task.TURN_LEFT, bias)
    measured = {
        **mounting.as_measured("felt", {"upright": upright, "forward": forward, "right": right}, "m_s2"),
        **mounting.as_measured("turned", {"forward": forward_turn, "right": right_turn, "left": left_turn}, "rad"),
    }
    _check_gravity(upright)
    tilts = {"forward": mounting.angle_between(upright, forward), "right": mounting.angle_between(upright, right)}
    for name, tilt in tilts.items():
        if tilt < _LEAST_TILT:
            raise StepRefusedError(
                f"tilted {name} the accelerometer felt {tilt:.2f} rad: tilt it further, by 40 degrees"
            )
    felt = mounting.accelerometer_axes(upright, forward, right)
    by_gyro = mounting.gyro_axes(forward_turn, right_turn, left_turn)
    fault = mounting.gyro_fault(by_gyro, felt)
    if fault is not None:
        raise StepRefusedError(f"{fault}; see the IMU's driver and settings")
    if felt != _AS_DECLARED:
        raise StepRefusedError(mounting.explain(felt, declared=_declared(session.file.hardware)))
    turned = {"forward": (forward_turn, tilts["forward"]), "right": (right_turn, tilts["right"])}
    for name, (turn, tilt) in turned.items():
        _check_scale(name, mounting.length(turn), tilt, _TILT_TOLERANCE)
    _check_scale("left", mounting.length(left_turn), _QUARTER, _QUARTER_TOLERANCE)
    if by_gyro != _AS_DECLARED:
        raise StepRefusedError("the gyro turned about none of its axes alone: repeat the movements one at a time")
    return Found("gravity, both tilts and the turn are as the robot's axes have them", measured)


def pitch_zero(session: Session, _expected: Expected) -> Found:
    """Where the robot balances in hand, the IMU is to show no pitch."""
    felt, _ = _still(session, Task.BALANCE)
    pitch = _pitch(felt)
    measured = {"pitch_rad": pitch}
    if abs(pitch) > _MOST_ZERO:
        raise StepRefusedError(
            f"the zero of pitch is off: where the robot balances, the IMU shows {pitch:+.3f} rad, allowed is "
            f"{_MOST_ZERO:g}; turn the IMU by that, or shift weight {'back' if pitch > 0.0 else 'ahead'}"
        )
    return Found(f"{pitch:+.3f} rad where it balances, allowed is {_MOST_ZERO:g}", measured)


def wheel_radius(session: Session, expected: Expected) -> Found:
    """Push it a metre."""
    before = _pitch(_still(session, Task.BALANCE)[0])
    recording = session.ask(Task.PUSH)
    pitch = _pitch(session.record(_STILL_S).vector("linear_acceleration")) - before
    left, right = (recording.change(f"{side}.angle") + pitch for side in SIDES)
    rolled = 0.5 * (left + right)
    measured = {"left_rad": left, "right_rad": right, "pitch_change_rad": pitch}
    if rolled <= 1.0:
        raise StepRefusedError(f"pushed a metre ahead, the wheels turned by {rolled:.2f} rad: push it ahead, rolling")
    if abs(left - right) > _STRAIGHT * rolled:
        raise StepRefusedError(
            f"the left wheel turned by {left:.2f} rad, the right by {right:.2f}: push it straight, or the wheels differ"
        )
    radius = _METRE / rolled
    measured["radius_m"] = radius
    if not abs(radius - expected.wheel_radius) <= _RADIUS_TOLERANCE * expected.wheel_radius:
        raise StepRefusedError(
            f"the wheel radius is {radius:.4f} m, the robot file has {expected.wheel_radius:g} m: set WheelRadius, and "
            "wheel_radius in section geometry"
        )
    return Found(f"{radius:.4f} m, the robot file has {expected.wheel_radius:g} m", measured)


def track(session: Session, expected: Expected) -> Found:
    """Turn it on the spot."""
    _, bias = _still(session, Task.BALANCE)
    recording = session.ask(Task.SPIN)
    turned = recording.integral("imu.angular_velocity_z", bias[2])
    apart = recording.change("right.angle") - recording.change("left.angle")
    measured = {"gyro_rad": turned, "wheels_apart_rad": apart}
    _check_scale("a whole turn to the left", turned, 2.0 * math.pi, _TRACK_TOLERANCE)
    found = expected.wheel_radius * apart / turned
    measured["track_m"] = found
    if not abs(found - expected.track) <= _TRACK_TOLERANCE * expected.track:
        raise StepRefusedError(
            f"the track is {found:.3f} m, the robot file has {expected.track:g} m: set Track, and track in "
            "section geometry"
        )
    return Found(f"{found:.3f} m, the robot file has {expected.track:g} m", measured)


def _still(session: Session, task: Task) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """What accelerometer and gyro show at rest, once the person has done as told."""
    session.ask(task)
    recording = session.record(_STILL_S)
    rates = [value for axis in "xyz" for value in recording.of(f"imu.angular_velocity_{axis}")]
    shaken = max(rates) - min(rates)
    bias = recording.vector("angular_velocity")
    if shaken > 10.0 * _STILL_RAD_S and mounting.length(bias) < _STILL_RAD_S:
        raise StepRefusedError(f"the robot was not still: its gyro varied by {shaken:.2f} rad/s; hold it steady")
    return recording.vector("linear_acceleration"), bias


def _moved(
    session: Session, task: Task, bias: tuple[float, float, float]
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Through which angles the gyro turned while the person did as told, rad, and what is felt at the end."""
    recording = session.ask(task)
    x, y, z = (recording.integral(f"imu.angular_velocity_{axis}", bias[at]) for at, axis in enumerate("xyz"))
    return (x, y, z), session.record(_STILL_S).vector("linear_acceleration")


def _check_gravity(upright: tuple[float, float, float]) -> None:
    size = mounting.length(upright)
    if abs(size - 1.0) <= _IN_G:
        raise StepRefusedError(f"the accelerometer gives g, not m/s2: at rest it feels {size:.3f}; set its unit")
    if abs(size - GRAVITY) > _GRAVITY_TOLERANCE:
        raise StepRefusedError(
            f"the accelerometer's scale is off: at rest it feels {size:.2f} m/s2, and gravity is {GRAVITY:.2f}"
        )


def _check_scale(name: str, turned: float, wanted: float, tolerance: float) -> None:
    """Refuse a gyro that turned through another angle, rad."""
    share = turned / wanted
    if abs(share - 1.0) <= tolerance:
        return
    if share >= _MANY_TIMES:
        raise StepRefusedError(
            f"the gyro gives degrees per second, not rad/s: moved {name} by {wanted:.2f} rad it turned by {turned:.1f}"
        )
    raise StepRefusedError(
        f"the gyro's scale is off: moved {name} by {wanted:.2f} rad it turned through {turned:.2f}; or move it as told"
    )


def _pitch(felt: tuple[float, float, float]) -> float:
    """Of a robot at rest, by what its accelerometer feels, rad."""
    return math.atan2(-felt[0], felt[2])


def _declared(hardware: HardwareSettings | NoHardwareSection) -> Mounting | None:
    """The mounting in the robot file; None where its IMU has none there."""
    if isinstance(hardware, NoHardwareSection) or hardware.external_imu is None:
        return None
    return hardware.external_imu.rotation
