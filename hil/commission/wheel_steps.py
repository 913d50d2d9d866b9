# SPDX-License-Identifier: MIT
"""The steps with the wheels in the air: which drive is which wheel, sign and scale of encoders and motors.

A step is a function of the session that returns what it measured and a line about it, or raises `StepRefusedError` with
what it found and the remedy.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.hil.commission.expected import Expected
from segway_ecc.hil.commission.person import Task
from segway_ecc.hil.commission.session import SIDES, Session, StepRefusedError
from segway_ecc.node.commissioning import Verdict


class Found(NamedTuple):
    """What a step found: a line about it, the numbers by name with their units, and how it is known."""

    text: str
    measured: dict[str, float]
    verdict: Verdict = "passed"


_TURN: Final = 2.0 * math.pi
_MOVED: Final = 0.3
"""A wheel that has turned by less, rad, has not been moved."""
_TURN_TOLERANCE: Final = 0.1
"""Of a turn by hand."""
_LEVELS: Final = (1.5, 2.5)
"""Of what it takes to move a wheel: the commands of which the difference counts, where friction cancels."""
_LEVEL_S: Final = 0.4
_PUSH_CYCLES: Final = (3, 9)
"""Of a torque that accelerates: which of its cycles count."""
_ALIKE: Final = (0.7, 1.4)
"""Of the two motors, one against the other."""
_AS_DESIGNED: Final = (0.6, 1.6)
"""Of a motor, against the robot file; what turns in the air is known roughly."""


def other(side: str) -> str:
    """The other side."""
    return SIDES[1 - SIDES.index(side)]


def encoders(session: Session, _expected: Expected) -> Found:
    """Turn each wheel by hand, forward by a turn, with the motors off."""
    session.ask(Task.LIFT)
    measured: dict[str, float] = {}
    for side, task in zip(SIDES, (Task.TURN_LEFT_WHEEL, Task.TURN_RIGHT_WHEEL), strict=True):
        recording = session.ask(task)
        turned = {each: recording.change(f"{each}.angle") / _TURN for each in SIDES}
        own, others = turned[side], turned[other(side)]
        measured |= {f"{side}_turns": own, f"{side}_other_turns": others}
        if abs(own) * _TURN < _MOVED:
            if abs(others) * _TURN > _MOVED:
                raise StepRefusedError(
                    f"the {side} wheel was turned and the {other(side)} encoder counted: the encoders, or both drives, "
                    "are swapped; exchange their connectors or ids"
                )
            raise StepRefusedError(
                f"the {side} wheel was turned and its encoder counted {own:.2f} turns: it is frozen or not connected"
            )
        if abs(others) * _TURN > _MOVED:
            raise StepRefusedError(f"the {other(side)} encoder counted too: {others:.2f} turns; turn one wheel alone")
        if own < 0.0:
            raise StepRefusedError(
                f"the {side} encoder is reversed: {own:.2f} turns forward; set its direction, or exchange its A and B"
            )
        if abs(own - 1.0) > _TURN_TOLERANCE:
            raise StepRefusedError(
                f"the {side} encoder's scale is off: one turn of the wheel counts as {own:.2f}; see its counts per "
                "turn and gear_ratio"
            )
        speed = recording.integral(f"{side}.velocity") / _TURN
        measured[f"{side}_velocity_turns"] = speed
        if abs(speed - own) > _TURN_TOLERANCE:
            raise StepRefusedError(f"the {side} velocity adds up to {speed:.2f} turns where the angle has {own:.2f}")
    return Found(f"left {measured['left_turns']:.3f} turns, right {measured['right_turns']:.3f} turns of 1", measured)


def motors(session: Session, _expected: Expected) -> Found:
    """Raise a small command, one drive at a time, until a wheel moves."""
    session.ask(Task.KEEP_CLEAR)
    measured: dict[str, float] = {}
    for side in SIDES:
        with session.driving():
            start = {each: session.value(f"{each}.angle") for each in SIDES}
            sent = _moves_at(session, side, SIDES)
        turned = {each: session.value(f"{each}.angle") - start[each] for each in SIDES}
        session.rest()
        unit = next(iter(session.hardware.commands.values()))
        measured |= {f"{side}_moves_at": sent, f"{side}_turned_rad": turned[side]}
        if abs(turned[side]) < _MOVED:
            if abs(turned[other(side)]) > _MOVED:
                raise StepRefusedError(
                    f"the {side} drive turned the {other(side)} wheel: the motors are swapped; exchange their cables"
                )
            raise StepRefusedError(
                f"the {side} motor is dead: {sent:.3g} {unit} do not move its wheel; see its cable and its drive"
            )
        if abs(turned[other(side)]) > _MOVED:
            raise StepRefusedError(f"the {side} drive turned both wheels; hold nothing, and see the motors' cables")
        if turned[side] < 0.0:
            raise StepRefusedError(
                f"the {side} motor is reversed: a command ahead turned its wheel back; exchange two of its wires, or "
                "set the direction in its drive"
            )
    return Found(
        f"left moves at {measured['left_moves_at']:.3g} {unit}, right at {measured['right_moves_at']:.3g}", measured
    )


def strength(session: Session, expected: Expected) -> Found:
    """Give each motor two small commands, and see what the difference of them does, where friction cancels.

    A voltage gives a speed: the difference is 1 / back-EMF. A torque gives an acceleration: 1 / the wheel's inertia.
    """
    session.ask(Task.KEEP_CLEAR)
    is_voltage = "V" in session.hardware.commands.values()
    gains = {side: _gain(session, side, is_voltage=is_voltage) for side in SIDES}
    ratio = gains["left"] / gains["right"] if gains["right"] else math.inf
    wanted = 1.0 / (expected.back_emf if is_voltage else expected.wheel_inertia)
    unit = "rad_s_v" if is_voltage else "rad_s2_n_m"
    measured = {f"left_{unit}": gains["left"], f"right_{unit}": gains["right"], "left_of_right": ratio}
    if not _ALIKE[0] <= ratio <= _ALIKE[1]:
        weaker = "left" if ratio < 1.0 else "right"
        share = min(ratio, 1.0 / ratio) if ratio else 0.0
        raise StepRefusedError(
            f"the {weaker} motor's scale is off: it does {share:.2f} of what the other does for the same command; "
            "compare torque_constant, gear_ratio and the drives' settings"
        )
    if math.isfinite(wanted):
        share = math.sqrt(abs(gains["left"] * gains["right"])) / wanted
        measured["of_expected"] = share
        if not _AS_DESIGNED[0] <= share <= _AS_DESIGNED[1]:
            raise StepRefusedError(
                f"both motors' scale is off: they do {share:.2f} of what the robot file's motor and wheel would; see "
                "torque_constant, gear_ratio, MotorConstant and WheelInertia"
            )
    return Found(
        f"left does {ratio:.2f} of right, both {measured.get('of_expected', math.nan):.2f} of the robot file", measured
    )


def _gain(session: Session, side: str, *, is_voltage: bool) -> float:
    """What a motor's speed (voltage), or its acceleration (torque), gains for the difference of two commands."""
    most = session.limits[SIDES.index(side)]
    with session.driving():
        moves_at = _moves_at(session, side, (side,))
    session.rest()
    effects = []
    levels = [min(level * moves_at, most) for level in _LEVELS]
    if levels[1] - levels[0] < 0.1 * levels[1]:
        raise StepRefusedError(f"the {side} motor moves its wheel only at {moves_at:.3g}, near the most that is tried")
    for level in levels:
        with session.driving():
            recording = session.drive(
                _LEVEL_S if is_voltage else (_PUSH_CYCLES[1] + 1) * session.period_s, {side: level}
            )
        session.rest()
        speeds = recording.of(f"{side}.velocity")
        if is_voltage:
            tail = speeds[len(speeds) // 2 :]
            effects.append(math.fsum(tail) / len(tail))
        else:
            first, last = _PUSH_CYCLES[0], min(_PUSH_CYCLES[1], len(speeds) - 1)
            effects.append((speeds[last] - speeds[first]) / (recording.times[last] - recording.times[first]))
    return (effects[1] - effects[0]) / (levels[1] - levels[0])


def _moves_at(session: Session, side: str, wheels: Sequence[str]) -> float:
    """The command of a drive at which one of these wheels has moved, or the largest that is tried."""
    start = {wheel: session.value(f"{wheel}.angle") for wheel in wheels}
    ramp = session.ramp(
        side, lambda: any(abs(session.value(f"{wheel}.angle") - start[wheel]) > _MOVED for wheel in wheels)
    )
    return ramp.most_sent
