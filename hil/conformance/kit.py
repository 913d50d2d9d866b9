# SPDX-License-Identifier: MIT
"""What every drive family must keep, tried with its simulated drives in lock step.

Each aspect starts from drives that were just switched on. Nothing here takes real time, and a failure is the same
whenever it is repeated.
"""

import math
import random
from collections.abc import Callable, Mapping
from typing import Any, Final

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.drives.family import DriveFamily
from segway_ecc.firmware_io.drives.stopper import Meaning
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame
from segway_ecc.firmware_io.settings import BusSettings, HardwareSettings
from segway_ecc.hil.conformance.rig import PERIOD_S, DriveRig, NonconformanceError
from segway_ecc.hil.devices.family import SimulatedDrives
from segway_ecc.hil.rig.fronts import LinkFault

_SHARE: Final = 0.5
"""Of the largest command, which is given to try what a motor does."""
_EXACT: Final = 0.02
"""Largest difference of command and motor, as a part of the largest command; and of what is measured."""
_OFF_WITHIN_S: Final = 0.5
_WATCHDOG_SLACK_S: Final = 0.03
"""Beyond its time, for the firmware's own clock and the ramp of a current."""
_STOP_WITHIN_S: Final = 0.01
_STALE_WITHIN_S: Final = 0.2
_CUT_S: Final = 0.5
_MOVES_ON: Final = 0.1
"""What was on the way as the silence began, as a part of the value before."""
_GARBAGE: Final = 500
_REMOTE: Final = 0.1
"""Of them so many ask for a frame."""
_FD: Final = 0.7
"""On a bus of CAN FD so many of the others are of it."""
_NOTHING: Final = 1e-3
"""Of the largest command: a motor that gives less gives nothing."""


def _require(fulfilled: bool, problem: str) -> None:  # noqa: FBT001 - as assert
    if not fulfilled:
        raise NonconformanceError(problem)


class _Trial:
    def __init__(
        self, family: DriveFamily[Any], simulated: SimulatedDrives[Any, Any], settings: HardwareSettings
    ) -> None:
        self.family, self.settings = family, settings
        self.rig = DriveRig(family, simulated, settings)
        self.limits = dict(zip(self.rig.hardware.commands, self.rig.hardware.limits, strict=True))

    def half(self) -> list[float]:
        return [_SHARE * limit for limit in self.limits.values()]

    def moving(self) -> list[str]:
        """The commands whose motors give anything."""
        return [name for name, given in self.rig.motors.items() if abs(given) > _NOTHING * self.limits[name]]


def _arming(trial: _Trial) -> None:
    rig = trial.rig
    rig.run(0.1, trial.half())
    _require(not trial.moving(), f"motors give something before the drives are armed: {rig.motors}")
    rig.arm()
    _require(not trial.moving(), f"motors give something right after arming, where zero is commanded: {rig.motors}")
    _require(not rig.sensors.off, "reports the motors off while they are on")
    rig.run(0.2, trial.half())
    rig.hardware.disarm()
    rig.run_until(
        lambda: rig.sensors.off, _OFF_WITHIN_S, lambda: f"does not report off {_OFF_WITHIN_S:g} s after disarm"
    )
    rig.run(0.1, trial.half())
    _require(not trial.moving(), f"motors give something after disarm: {rig.motors}")


def _each_motor(trial: _Trial, look: Callable[[str, float], None]) -> None:
    """Command one motor after another, forward and back, and look once it has settled."""
    trial.rig.arm()
    for place, (name, limit) in enumerate(trial.limits.items()):
        for sign in (1.0, -1.0):
            commands = list(trial.rig.zero)
            commands[place] = sign * _SHARE * limit
            trial.rig.run(0.6, commands)
            look(name, commands[place])
            trial.rig.run(1.0)


def _direction(trial: _Trial) -> None:
    def look(name: str, command: float) -> None:
        given = trial.rig.motors
        _require(given[name] * command > 0.0, f"{name} {command:g}: its motor gives {given[name]:g}")
        others = [other for other in trial.moving() if other != name]
        _require(not others, f"{name} {command:g}: others move too: {', '.join(others)}")
        signal = f"{name.rpartition('.')[0]}.velocity"
        value, valid = trial.rig.measured[signal]
        _require(valid and value * command > 0.0, f"{name} {command:g}: {signal} reads {value:g}, valid {valid}")

    _each_motor(trial, look)


def _scale(trial: _Trial) -> None:
    def look(name: str, command: float) -> None:
        given, limit = trial.rig.motors[name], trial.limits[name]
        _require(abs(given - command) <= _EXACT * limit, f"{name} {command:g}: its motor gives {given:g}")
        for quantity in ("angle", "velocity"):
            signal = f"{name.rpartition('.')[0]}.{quantity}"
            if signal in trial.rig.measured:
                true, (read, _) = trial.rig.rotors[signal], trial.rig.measured[signal]
                # It is older than the rotor by the cycle and what the bus takes.
                beside = 2 * PERIOD_S * 10.0 if quantity == "angle" else trial.family.velocity_error
                allowed = _EXACT * max(abs(true), 1.0) + beside
                _require(abs(read - true) <= allowed, f"{signal} reads {read:g} where the rotor has {true:g}")

    _each_motor(trial, look)


def _stop(trial: _Trial) -> None:
    rig, stopper = trial.rig, trial.family.stopper(trial.settings)
    rig.arm()
    rig.run(0.2, trial.half())
    read = {found for frame in rig.seen if (found := stopper.read(frame)) is not None}
    unseen = [drive for drive in stopper.drives if (drive, Meaning.MOVE) not in read]
    _require(not unseen, f"the stopper reads no command that moves {', '.join(unseen)} among those that did")
    if stopper.reports:
        silent = [drive for drive in stopper.drives if (drive, Meaning.ON) not in read]
        _require(not silent, f"the stopper reads no report that {', '.join(silent)} is on")
    _require(bool(trial.moving()), "no motor gives anything before the stop, so that it would show nothing")
    guard = rig.guard()
    guard.open()
    for frame in stopper.stop():
        guard.send(frame)
    rig.wait(_STOP_WITHIN_S)
    _require(not trial.moving(), f"{_STOP_WITHIN_S * 1e3:g} ms after the stop frames the motors give {rig.motors}")


def _watchdog(trial: _Trial) -> None:
    rig, timeout_s = trial.rig, trial.family.watchdog(trial.settings).timeout_s
    rig.arm()
    rig.run(0.2, trial.half())
    _require(bool(trial.moving()), "no motor gives anything while commands come, so that silence would show nothing")
    rig.wait(timeout_s + _WATCHDOG_SLACK_S)
    _require(
        not trial.moving(),
        f"{(timeout_s + _WATCHDOG_SLACK_S) * 1e3:g} ms without commands (watchdog {timeout_s * 1e3:g} ms) "
        f"the motors give {rig.motors}",
    )


def _silence(trial: _Trial) -> None:
    rig = trial.rig
    rig.arm()
    rig.run(0.5, trial.half())
    wheels = [name for name in rig.measured if name.endswith((".angle", ".velocity"))]
    before = {name: rig.measured[name][0] for name in wheels}
    stale = [name for name in wheels if not rig.measured[name][1]]
    _require(not stale, f"not valid although the drives send: {', '.join(stale)}")
    rig.link.fault = LinkFault.CUT
    rig.run(_STALE_WITHIN_S + trial.settings.ride_through_s)
    valid = [name for name in wheels if rig.measured[name][1]]
    _require(not valid, f"still valid after {_STALE_WITHIN_S:g} s of silence: {', '.join(valid)}")
    wrong = [
        name for name in wheels if abs(rig.measured[name][0] - before[name]) > _EXACT * max(abs(before[name]), 1.0)
    ]
    _require(not wrong, f"other values than the last ones after a silence: {', '.join(wrong)}")


def _garbage(trial: _Trial) -> None:
    rig, chance = trial.rig, random.Random(1)  # noqa: S311 - repeatable, and no secret
    rig.arm()
    is_fd_bus = isinstance(trial.settings, BusSettings) and trial.settings.can.fd
    # Answers to what is asked once are among them: one frame that happens to read as such must not last.
    keys = sorted({FrameKey(*key) for drive in rig.drives for key in drive.listens_to})
    for _ in range(_GARBAGE):
        identifier, is_extended = chance.choice(keys)
        data = chance.randbytes(chance.randrange(9))
        frame = Frame(identifier, data, is_extended=is_extended, is_remote=chance.random() < _REMOTE)
        if is_fd_bus and not frame.is_remote and chance.random() < _FD:
            data = chance.randbytes(chance.choice(FD_LENGTHS))
            frame = Frame(identifier, data, is_extended=is_extended, is_fd=True)
        rig.disturb(frame)
        rig.cycle()
        _require(
            all(map(math.isfinite, rig.sensors.values)), f"a frame {identifier:X}#{data.hex()} makes a value infinite"
        )
    rig.hardware.disarm()
    rig.run(1.0)
    rig.arm()


def _reconnection(trial: _Trial) -> None:
    rig = trial.rig
    rig.arm()
    rig.run(0.2, trial.half())
    rig.link.fault = LinkFault.CUT
    cut_s = max(_CUT_S, trial.family.watchdog(trial.settings).timeout_s + _WATCHDOG_SLACK_S)
    rig.run(cut_s, trial.half())
    _require(not trial.moving(), f"{cut_s:g} s after the cable was cut the motors give {rig.motors}")
    rig.link.fault = None
    rig.hardware.disarm()
    rig.run(0.1)
    rig.arm()
    rig.run(0.2, trial.half())
    still = set(trial.limits) - set(trial.moving())
    _require(not still, f"armed again after a cut, and no motion of {', '.join(sorted(still))}")


def _timing(trial: _Trial) -> None:
    rig = trial.rig
    rig.arm()
    rig.seen.clear()
    rig.run(1.0)
    received: dict[tuple[int, bool], list[int]] = {}
    for frame in rig.seen:
        received.setdefault((frame.arbitration_id, frame.is_extended), []).append(frame.received_ns)
    for drive in rig.drives:
        for key, period_s in drive.periods_s.items():
            count = len(received.get((key[0], key[1]), []))
            expected = 1.0 / period_s
            _require(
                0.8 * expected - 1 <= count <= 1.2 * expected + 1,
                f"frame 0x{key[0]:X} came {count} times in a second, and not {expected:.0f} times as periods_s has it",
            )
        for key in drive.commanded_by:
            count = len(received.get((key[0], key[1]), []))
            _require(count <= 2.0 / PERIOD_S, f"command 0x{key[0]:X} was sent {count} times in {1 / PERIOD_S:g} cycles")


_ASPECTS: Final[Mapping[str, Callable[[_Trial], None]]] = {
    "arming": _arming,
    "direction": _direction,
    "scale": _scale,
    "stop": _stop,
    "watchdog": _watchdog,
    "silence": _silence,
    "garbage": _garbage,
    "reconnection": _reconnection,
    "timing": _timing,
}
CONFORMANCE_ASPECTS: Final = tuple(_ASPECTS)
"""What `check_conformance` can try."""


def check_conformance(
    aspect: str, family: DriveFamily[Any], simulated: SimulatedDrives[Any, Any], settings: HardwareSettings
) -> None:
    """Try one aspect of a drive family with its simulated drives; takes no real time but that of its arithmetic.

    Args:
        aspect: One of `CONFORMANCE_ASPECTS`.
        family: The family, which need not be installed.
        simulated: What stands in for its drives.
        settings: Its section of a robot file.

    Raises:
        NonconformanceError: What was found is not what the software relies on.
    """
    try:
        _ASPECTS[aspect](_Trial(family, simulated, settings))
    except NonconformanceError as error:
        raise NonconformanceError(f"{settings.__struct_config__.tag}, {aspect}: {error}") from None
