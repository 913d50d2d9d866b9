# SPDX-License-Identifier: MIT
"""The steps about what ends torque: limits, the drives' watchdog, the e-stop and the guard; see `wheel_steps`."""

import math
from collections.abc import Callable, Mapping
from typing import Final

from segway_ecc.firmware_io.devices import SUPPLY_VOLTAGE
from segway_ecc.firmware_io.drives.readings import readings_of
from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.hil.commission.drive_limits import drive_limits
from segway_ecc.hil.commission.expected import Expected
from segway_ecc.hil.commission.person import Answer, Task
from segway_ecc.hil.commission.session import SIDES, Session, StepRefusedError
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.commissioning import Verdict
from segway_ecc.node.config import NoHardwareSection

_LOOK_S: Final = 0.5
_TURNING_RAD_S: Final = 2.0
_SLOW_RAD_S: Final = 5.0
_STOP_WITHIN_S: Final = 60.0
_REPORT_S: Final = 0.05
"""What telemetry and one period of the loop may add to a watchdog until it is seen."""
_GUARD_WITHIN_S: Final = 10.0
"""How long a guard may take to start."""
_GUARD_REPORTS: Final = "guard stopped"
_NEEDED: Final = ("tilt_limit_rad", "wheel_velocity_limit", "max_command", "supply")
IMU_SIGNALS: Final = tuple(
    f"imu.{kind}_{axis}" for kind in ("angular_velocity", "linear_acceleration") for axis in "xyz"
)


def signals(session: Session, _expected: Expected) -> Found:
    """Everything that the steps need is measured, and the drives are fit, their watchdog among it."""
    needed = [*(f"{side}.{kind}" for side in SIDES for kind in ("angle", "velocity")), *IMU_SIGNALS]
    lacking = [name for name in needed if name not in session.hardware.signals]
    if lacking:
        raise StepRefusedError(f"the robot file's hardware does not measure {', '.join(lacking)}; has it an IMU?")
    session.wait_until_fit()
    if not session.newest.off:
        raise StepRefusedError("the drives do not report that their motors are off, before anything was switched on")
    if session.newest.unseen:  # a drive that measures its wheel only once its motor was on: at zero torque
        with session.driving():
            pass
    noisy = session.record(_LOOK_S)
    frozen = [name for name in IMU_SIGNALS if len(set(noisy.of(name))) == 1]
    if len(frozen) == len(IMU_SIGNALS):
        raise StepRefusedError("the IMU's values do not change at all: it is frozen, or not the one that is meant")
    supply = session.value(SUPPLY_VOLTAGE) if SUPPLY_VOLTAGE in session.hardware.signals else math.nan
    return Found(f"all {len(needed)} signals are fresh and the drives are fit", {"supply_v": supply})


def limits(session: Session, _expected: Expected) -> Found:
    """The limits that the robot file states, the supply within them, and the drives' own: read back, or looked up."""
    safety = session.file.safety
    missing = [name for name in _NEEDED if safety is None or getattr(safety, name) is None]
    if safety is None or missing:
        raise StepRefusedError(f"the robot file's section safety states no {', '.join(missing)}")
    volts = session.value(SUPPLY_VOLTAGE) if SUPPLY_VOLTAGE in session.hardware.signals else math.nan
    measured = {"supply_v": volts, "max_command": safety.max_command or math.nan}
    if safety.supply is not None and not safety.supply.min_v <= volts <= safety.supply.max_v:
        raise StepRefusedError(
            f"the supply is {volts:.1f} V, allowed is {safety.supply.min_v:g} to {safety.supply.max_v:g} V: charge it, "
            "or correct safety.supply"
        )
    fastest = safety.wheel_velocity_limit or math.nan
    own = drive_limits(hardware_of(session.file), readings_of(session.hardware), fastest)
    measured |= own.measured
    read_back = ", ".join(f"{name} {value:g}" for name, value in own.measured.items()) or "nothing"
    text = f"supply {volts:.1f} V, safety limits stated; read back from the drives: {read_back}"
    if not own.lookups:
        return Found(text, measured)
    for line in own.lookups:
        session.person.read(f"look up {line}")
    session.ask(Task.LOOK_UP_LIMITS)
    return Found(f"{text}; the person confirmed {'; '.join(own.lookups)}", measured, "confirmed")


def watchdog(session: Session, _expected: Expected) -> Found:
    """Send nothing while a wheel turns: the drive is to switch its motor off by itself."""
    hardware = session.file.hardware
    allowed_s = math.nan if isinstance(hardware, NoHardwareSection) else hardware.watchdog_s + _REPORT_S
    if session.hardware.health.get("guard") == "watches":
        session.ask(Task.END_GUARD)
    session.ask(Task.KEEP_CLEAR)
    measured = {}
    for side in SIDES:
        with session.driving():
            turn(session, side)
            recording = session.record(
                _LOOK_S, until=lambda sensors: bool(sensors.faults) or session.too_fast(), silent=True
            )
            reported = bool(session.newest.faults)
            took = recording.times[-1]
        session.rest()
        measured[f"{side}_off_after_s"] = took
        if not reported or took > allowed_s:
            after = f"after {took * 1e3:.0f} ms" if reported else f"not within {took * 1e3:.0f} ms"
            raise StepRefusedError(
                f"without commands the {side} drive's watchdog switched the motor off {after}; allowed is "
                f"{allowed_s * 1e3:.0f} ms: switch the watchdog on in the drive, or see its firmware"
            )
    worst = max(measured.values())
    return Found(
        f"without commands the drives report off after {worst * 1e3:.0f} ms, allowed {allowed_s * 1e3:.0f}", measured
    )


def e_stop(session: Session, _expected: Expected) -> Found:
    """Command on while the person presses the e-stop: the drives are to go off against the commands."""
    session.ask(Task.KEEP_CLEAR)
    with session.driving():
        moving = turn(session, "left")
        session.person.begin(Task.PRESS_STOP)
        answers: list[Answer] = []

        def over(sensors: Sensors) -> bool:
            answers.extend(answer for answer in (session.person.answer(),) if answer is not None)
            return bool(answers) or _is_off(session, sensors)

        session.record(_STOP_WITHIN_S, moving, over)
        if answers and not _is_off(session, session.newest):  # its press may have come just before
            session.record(_LOOK_S, moving, lambda sensors: _is_off(session, sensors))
        off, is_silent = _is_off(session, session.newest), _is_silent(session)
        reason = "; ".join(session.newest.faults) or ", ".join(f"no fresh {name}" for name in session.stale()[:1])
        coast = session.record(_LOOK_S, moving)
    if not off and answers != [Answer.DONE]:
        raise StepRefusedError(f"the e-stop was not pressed within {_STOP_WITHIN_S:g} s, or there is none")
    if not off:
        raise StepRefusedError(
            "the e-stop does not end torque: it was pressed and the drives still follow commands; it must cut the "
            "motors' supply or the drives' enable input"
        )
    verdict: Verdict = "passed"
    text = f"pressed, the drives went off against commands: {reason}"
    if is_silent:  # as drives without supply are: that torque has ended is then not reported
        session.ask(Task.SEE_WHEELS_STOP, may_be_silent=True)
        verdict, text = (
            "confirmed",
            f"pressed, the drives fell silent; that the wheels stopped, the person confirmed: {reason}",
        )
    session.ask(Task.RELEASE_STOP, may_be_silent=True)
    session.wait_until_fit()
    return Found(text, {"speed_after_rad_s": coast.of("left.velocity")[-1]}, verdict)


def guard(session: Session, _expected: Expected) -> Found:
    """Stop the node's heartbeat while a wheel turns: the guard is to have stopped the drives."""
    session.ask(Task.START_GUARD)
    session.record(_GUARD_WITHIN_S, until=lambda _: session.hardware.health.get("guard") == "watches")
    if session.hardware.health.get("guard") != "watches":
        raise StepRefusedError("no guard answers: start it on this machine, on the same bus")
    session.ask(Task.KEEP_CLEAR)
    with session.driving():
        moving = turn(session, "left")
        session.record(_LOOK_S, silent=True)
        session.record(_LOOK_S, moving, until=lambda sensors: bool(sensors.faults))
        reason = "; ".join(session.newest.faults)
    session.rest()
    if _GUARD_REPORTS not in reason:
        raise StepRefusedError(f"the guard did not stop the drives in {_LOOK_S:g} s without a heartbeat: {reason}")
    return Found(f"without a heartbeat {reason}", {})


def has_guard(session: Session) -> bool:
    """Whether the robot file requires a guard."""
    hardware = session.file.hardware
    return not isinstance(hardware, NoHardwareSection) and hardware.guard == "required"


def turn(session: Session, side: str) -> Callable[[float], Mapping[str, float]]:
    """Have a wheel turn, by raising its command; returns the commands that keep it turning slowly, by the time.

    Raises:
        StepRefusedError: It does not turn.
    """
    recording = session.ramp(side, lambda: abs(session.value(f"{side}.velocity")) > _TURNING_RAD_S)
    if abs(session.value(f"{side}.velocity")) <= _TURNING_RAD_S:
        raise StepRefusedError(f"the {side} wheel does not turn for this step")
    sent = recording.most_sent
    # In the air what begins to turn a wheel would drive it ever faster.
    return lambda _: {side: sent if session.value(f"{side}.velocity") < _SLOW_RAD_S else 0.0}


def _is_off(session: Session, sensors: Sensors) -> bool:
    """Whether a drive reports against itself, or has fallen silent, as one without supply does."""
    return bool(sensors.faults) or _is_silent(session)


def _is_silent(session: Session) -> bool:
    """Whether no fresh value arrives from a wheel."""
    return any(name.startswith(SIDES) for name in session.stale())
