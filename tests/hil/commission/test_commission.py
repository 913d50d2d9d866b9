# SPDX-License-Identifier: MIT
"""Commissioning of a simulated robot: the right one passes, and each wiring or mounting error is found and named."""

import datetime as dt
import random
from collections.abc import Mapping

import pytest

from segway_ecc.hil.commission import commission as commissioning
from segway_ecc.hil.commission.commission import commission, passes
from segway_ecc.hil.commission.miswiring import ERRORS
from segway_ecc.hil.commission.person import Answer, Task
from segway_ecc.hil.commission.simulated import EXACTLY, SimulatedSite
from segway_ecc.hil.commission.site import RealSite
from segway_ecc.hil.errors import RigError
from segway_ecc.node.commissioning import STEPS, CommissioningReport
from segway_ecc.node.config import load_robot

ROBOTS = ("segway", "segway-odrive")
NOW = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
FOUND_EARLIER = {("segway-odrive", "no watchdog"): "signals"}
"""The driver of ODrives has their watchdog prove itself before anything is armed."""


def commissioned(robot: str, error: str | None = None) -> CommissioningReport:
    """Commission a simulated robot."""
    file = load_robot(robot)
    return commission(file, SimulatedSite(file, None if error is None else ERRORS[error]), NOW)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.variants(1)
def test_right_robot_passes_every_step(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commissioning, "HELD_S", 2.0)
    monkeypatch.setattr(commissioning, "ALONE_S", 3.0)

    report = commissioned(robot)

    assert [step.step for step in report.steps] == list(STEPS)
    assert {step.step: step.text for step in report.steps if step.verdict == "refused"} == {}
    assert {step.step for step in report.steps if step.verdict == "left out"} == {"guard", "kill"}
    assert passes(report)
    assert report.is_simulated
    measured = {name: value for step in report.steps for name, value in step.measured.items()}
    assert measured["radius_m"] == pytest.approx(0.05, rel=0.01)
    assert measured["track_m"] == pytest.approx(0.3048, rel=0.02)
    assert measured["pitch_rad"] == pytest.approx(0.0, abs=0.01)


def test_there_are_more_than_twenty_errors() -> None:
    assert len(ERRORS) > 20


@pytest.mark.parametrize(("robot", "error"), [(robot, error) for error in ERRORS for robot in ROBOTS])
@pytest.mark.variants(5)
def test_wiring_or_mounting_error_is_found_named_and_refused(robot: str, error: str) -> None:
    expected = ERRORS[error]

    report = commissioned(robot, error)

    last = report.steps[-1]
    assert last.verdict == "refused"
    assert last.step == FOUND_EARLIER.get((robot, error), expected.step)
    assert expected.says in last.text
    assert not passes(report)
    assert all(step.verdict in {"passed", "confirmed", "left out"} for step in report.steps[:-1])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.variants(1)
def test_right_robot_passes_in_hands_that_are_not_exact(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commissioning, "HELD_S", 1.0)
    monkeypatch.setattr(commissioning, "ALONE_S", 1.0)
    file, draw = load_robot("segway"), random.Random(seed)  # noqa: S311 - no secret
    site = SimulatedSite(file)

    def inexact(task: Task, states: Mapping[str, float]) -> Mapping[str, float]:
        """Up to 0.2 rad off where it is tilted, 3 % where it is turned, 1 cm of the metre, and 0.02 rad in balance."""
        lean = 0.02 if task is Task.BALANCE else 0.1
        off = {
            "HandPitch": draw.uniform(-lean, lean) * (2.0 if task is Task.TILT_FORWARD else 1.0),
            "HandRoll": draw.uniform(-lean, lean) * (2.0 if task is Task.TILT_RIGHT else 1.0),
            "HandYaw": draw.uniform(-0.1, 0.1),
            "HandTravel": draw.uniform(-0.01, 0.01),
            "LeftTurn": draw.uniform(-0.2, 0.2),
            "RightTurn": draw.uniform(-0.2, 0.2),
        }
        return {name: value + off.get(name, 0.0) for name, value in states.items()}

    site.person.does = {task: (seconds, inexact(task, states)) for task, (seconds, states) in EXACTLY.items()}

    report = commission(file, site, NOW)

    assert {step.step: step.text for step in report.steps if step.verdict == "refused"} == {}
    assert passes(report)


class _NoPerson:
    """Is asked nothing; see `Person`."""

    def begin(self, task: Task) -> None:
        raise AssertionError(task)

    def answer(self) -> Answer | None:
        raise AssertionError

    def read(self, line: str) -> None:
        raise AssertionError(line)


@pytest.mark.parametrize(
    ("robot", "axes"),
    [
        ("skid-steer", "front_left, front_right, rear_left, rear_right"),
        ("pan-tilt", "pan, tilt"),
        ("arm", "shoulder, elbow, wrist"),
    ],
)
def test_robot_with_other_axes_is_refused_by_their_names(robot: str, axes: str) -> None:
    file = load_robot(robot)
    message = f"^robot '{robot}' has the axes {axes}: commissioning is for a robot that balances on two wheels"
    with pytest.raises(RigError, match=message):
        SimulatedSite(file)
    with pytest.raises(RigError, match=message):
        RealSite(file, _NoPerson(), ())
