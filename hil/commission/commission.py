# SPDX-License-Identifier: MIT
"""All steps in their order, and the report of them; the first that is refused ends it."""

import contextlib
import datetime as dt
import math
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.firmware_io.errors import SegwayEccError
from segway_ecc.hil.commission import body_steps, safety_steps, wheel_steps
from segway_ecc.hil.commission.expected import Expected, expected_of
from segway_ecc.hil.commission.person import Task
from segway_ecc.hil.commission.session import Session
from segway_ecc.hil.commission.site import Workplace
from segway_ecc.hil.commission.standing import stand
from segway_ecc.hil.commission.wheel_steps import Found
from segway_ecc.node.commissioning import STEPS, CommissioningReport, StepReport, digests_of
from segway_ecc.node.config import RobotFile
from segway_ecc.node.errors import ConfigurationError

Step = Callable[[Session, Expected], Found]
WITH_SESSION: Final[dict[str, Step]] = {
    "signals": safety_steps.signals,
    "encoders": wheel_steps.encoders,
    "motors": wheel_steps.motors,
    "strength": wheel_steps.strength,
    "imu": body_steps.imu,
    "pitch zero": body_steps.pitch_zero,
    "wheel radius": body_steps.wheel_radius,
    "track": body_steps.track,
    "limits": safety_steps.limits,
    "watchdog": safety_steps.watchdog,
    "e-stop": safety_steps.e_stop,
    "guard": safety_steps.guard,
}
"""The steps over the open hardware, in the order of `STEPS`."""
HELD_S: Final = 10.0
ALONE_S: Final = 30.0
_IN_THE_AIR: Final = frozenset({"watchdog"})
"""Steps before which the wheels go back into the air."""


def commission(file: RobotFile, site: Workplace, now: dt.datetime | None = None) -> CommissioningReport:
    """Go through the steps; the person is shown each outcome.

    Args:
        file: The robot file that the report is to hold for.
        site: Where the robot is.
        now: What the report is dated; the time by default.

    Raises:
        SegwayEccError: The robot cannot be built, or its bus not opened.
    """
    expected, steps = expected_of(site.file), list[StepReport]()

    def take(name: str, found: Found) -> None:
        finite = {key: value for key, value in found.measured.items() if math.isfinite(value)}
        steps.append(StepReport(step=name, verdict=found.verdict, text=found.text, measured=finite))
        site.person.read(f"{name}: {found.verdict}: {found.text}")

    with _stops_at_refusal(take) as begin:
        with site.session() as session:
            for name, step in WITH_SESSION.items():
                begin(name)
                if name in _IN_THE_AIR:
                    session.ask(Task.LIFT)
                if name == "guard" and site.is_simulated:
                    take(name, Found("simulated in lock step: there is no process to watch", {}, "left out"))
                elif name == "guard" and not safety_steps.has_guard(session):
                    take(name, Found("the robot file does not require a guard: hardware.guard", {}, "left out"))
                else:
                    take(name, step(session, expected))
            begin("kill")
            session.ask(Task.KEEP_CLEAR)
        take("kill", site.kill())
        for name, task, seconds in (("held", Task.HOLD_LOOSELY, HELD_S), ("alone", Task.STAND_CLEAR, ALONE_S)):
            begin(name)
            take(name, _stand(site, task, seconds))
    date = (now or dt.datetime.now(dt.UTC)).isoformat(timespec="seconds")
    return CommissioningReport(
        robot=file.name,
        date=date,
        version=metadata.version("segway-ecc"),
        is_simulated=site.is_simulated,
        digests=digests_of(file),
        steps=tuple(steps),
    )


@contextlib.contextmanager
def _stops_at_refusal(take: Callable[[str, Found], None]) -> Iterator[Callable[[str], None]]:
    """End at the first step that is refused, or in which something fails, and report it under its name.

    It yields what is to be called with the name of each step that begins.
    """
    name = STEPS[0]

    def begin(step: str) -> None:
        nonlocal name
        name = step

    try:
        yield begin
    except SegwayEccError as error:
        take(name, Found(str(error), {}, "refused"))
    except KeyboardInterrupt:
        take(name, Found("broken off by the person; zero was sent, and the drives are off", {}, "refused"))


def _stand(site: Workplace, task: Task, seconds: float) -> Found:
    """Lay it down, tell the person, and have it stand up by its own loop."""
    with site.session() as session:
        session.ask(Task.SET_DOWN)
        session.ask(task)
    with site.robot() as robot:
        return stand(robot, seconds)


def passes(report: CommissioningReport) -> bool:
    """Whether all went well: in simulation there is nothing to kill."""
    lacking = set(report.lacking)
    return not lacking - ({"kill"} if report.is_simulated else set())


def write_report(report: CommissioningReport, path: Path) -> None:
    """Write a report as YAML.

    Raises:
        ConfigurationError: It cannot be written.
    """
    try:
        path.write_bytes(msgspec.yaml.encode(report))
    except OSError as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}") from error
