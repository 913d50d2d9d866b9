# SPDX-License-Identifier: MIT
"""Where a robot is commissioned: on its own bus and in real time, or simulated in lock step."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, Protocol

import msgspec

from segway_ecc.firmware_io.build import build_hardware, make_link
from segway_ecc.firmware_io.clock import NS_PER_S, RealClock
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.commission.expected import require_two_wheels
from segway_ecc.hil.commission.person import Person
from segway_ecc.hil.commission.session import Session, StepRefusedError
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.hil.processes import command
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulation import hardware_of
from segway_ecc.node.config import RobotFile
from segway_ecc.node.robot import Robot, build_robot

SPIN: Final = "segway_ecc.hil.commission.spin"
_TURNS_WITHIN_S: Final = 30.0
_LOOK_S: Final = 0.5
_REPORT_S: Final = 0.05
_TURNING_RAD_S: Final = 1.0


class Workplace(Protocol):
    """See the module."""

    file: RobotFile
    is_simulated: bool

    @property
    def person(self) -> Person:
        """Who has the robot in hand."""

    def session(self) -> contextlib.AbstractContextManager[Session]:
        """The robot's hardware, open while the context lasts; then zero has been sent, and the drives are off."""

    def robot(self) -> contextlib.AbstractContextManager[Robot]:
        """The robot whose own loop is to run, once."""

    def kill(self) -> Found:
        """Kill a process that turns a wheel, and see when torque ends.

        Raises:
            StepRefusedError: It does not end, or not in time.
        """


class RealSite:
    """A robot on its bus; see `Workplace`."""

    is_simulated = False

    def __init__(self, file: RobotFile, person: Person, words: Sequence[str]) -> None:
        """Commission the robot of a file; `words` name it and its bus on a command line.

        Raises:
            RigError: It is not on two wheels; see `require_two_wheels`.
        """
        require_two_wheels(file)
        self.file = msgspec.structs.replace(file, commissioned="optional")
        self.person = person
        self._words = words

    @contextlib.contextmanager
    def session(self) -> Iterator[Session]:
        """See `Workplace.session`; the drives are to be tried without the guard too, also where `run` requires it."""
        hardware = msgspec.structs.replace(hardware_of(self.file), guard="optional")
        robot = build_robot(msgspec.structs.replace(self.file, hardware=hardware), RealClock())
        try:
            robot.hardware.open()
            yield Session(self.file, robot.hardware, robot.clock, robot.period_ns / NS_PER_S, self.person)
        finally:
            robot.hardware.close()

    @contextlib.contextmanager
    def robot(self) -> Iterator[Robot]:
        """See `Workplace.robot`."""
        yield build_robot(msgspec.structs.replace(self.file, arming="on_request"), RealClock())

    def kill(self) -> Found:
        """See `Workplace.kill`: the process is a child of this one, which only listens to the bus."""
        clock, settings = RealClock(), hardware_of(self.file)
        period_s = build_robot(self.file, clock).period_ns / NS_PER_S
        listener = build_hardware(settings, period_s, clock, _MutedLink(make_link(settings, clock)))
        places = [list(listener.signals).index(f"{side}.velocity") for side in ("left", "right")]

        def look() -> tuple[bool, float]:
            """Whether the drives report off, and how fast the faster wheel turns, rad/s."""
            clock.sleep_until_ns(clock.now_ns() + round(0.2 * period_s * NS_PER_S))
            sensors = listener.exchange((0.0,) * len(listener.commands))
            return sensors.off, max(abs(sensors.values[place]) for place in places)

        with TemporaryDirectory(prefix="segway-ecc-commission-") as folder, contextlib.ExitStack() as stack:
            stack.callback(listener.close)
            listener.open()
            child = stack.enter_context(command(self._words, Path(folder) / "spin.txt", module=SPIN, listens=True))
            child.ask("turn", _TURNS_WITHIN_S)
            begun_ns, state = clock.now_ns(), look()
            while state[0] or state[1] < _TURNING_RAD_S:
                if clock.now_ns() - begun_ns > _LOOK_S * NS_PER_S:
                    raise StepRefusedError("the process that is to be killed does not turn a wheel")
                state = look()
            child.process.kill()
            killed_ns = clock.now_ns()
            while not state[0] and clock.now_ns() - killed_ns < _LOOK_S * NS_PER_S:
                state = look()
            took_s = (clock.now_ns() - killed_ns) / NS_PER_S
        allowed_s = settings.watchdog_s + _REPORT_S
        if not state[0] or took_s > allowed_s:
            raise StepRefusedError(
                f"killed with a wheel turning, the drives report off {'after' if state[0] else 'not within'} "
                f"{took_s * 1e3:.0f} ms, allowed is {allowed_s * 1e3:.0f}: see the drives' watchdog"
            )
        text = f"killed with a wheel turning, the drives report off after {took_s * 1e3:.0f} ms"
        return Found(f"{text}, allowed {allowed_s * 1e3:.0f}", {"off_after_s": took_s})


class _MutedLink(LinkFront):
    """Receives, and sends nothing; see `Link`."""

    def send(self, frame: Frame) -> bool:
        """Discard a frame."""
        del frame
        return True
