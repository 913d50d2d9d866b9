# SPDX-License-Identifier: MIT
"""What is sent to the drives while a person has the robot in hand, and that it always ends at zero."""

from collections.abc import Iterator

import pytest

from segway_ecc.hil.commission.miswiring import ERRORS
from segway_ecc.hil.commission.person import Answer, Task
from segway_ecc.hil.commission.session import FASTEST_RAD_S, Session, StepRefusedError
from segway_ecc.hil.commission.simulated import SimulatedSite
from segway_ecc.node.config import load_robot


@pytest.fixture
def site() -> SimulatedSite:
    """The packaged robot, wired rightly."""
    return SimulatedSite(load_robot("segway"))


@pytest.fixture
def session(site: SimulatedSite) -> Iterator[Session]:
    """Its hardware."""
    with site.session() as session:
        session.wait_until_fit()
        yield session


def given(site: SimulatedSite) -> list[float]:
    """What its motors are given now."""
    assert site.person.robot is not None
    return list(site.person.robot.inputs)


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_motors_are_off_whatever_ends_a_drive(
    site: SimulatedSite, session: Session, failure: type[BaseException]
) -> None:
    def drive() -> None:
        with session.driving():
            session.record(0.1, {"left": 0.3})
            assert given(site)[0] > 0.0
            raise failure

    with pytest.raises(failure):
        drive()

    assert given(site) == [0.0, 0.0]
    assert session.newest.off


def test_command_is_limited_to_a_share_of_the_robots_own(site: SimulatedSite, session: Session) -> None:
    with session.driving():
        session.record(0.1, {"left": 100.0})
        assert given(site)[0] == pytest.approx(0.2 * 7.0, rel=0.01)


def test_wheel_that_turns_too_fast_ends_a_drive(session: Session) -> None:
    with session.driving():
        recording = session.drive(5.0, {"left": 100.0})

    assert recording.times[-1] < 1.0
    assert recording.of("left.velocity")[-1] > FASTEST_RAD_S


def test_nothing_is_sent_outside_of_a_drive(site: SimulatedSite, session: Session) -> None:
    session.ask(Task.TURN_LEFT_WHEEL)
    assert given(site) == [0.0, 0.0]


def test_task_that_cannot_be_done_is_refused(
    site: SimulatedSite, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(site.person, "answer", lambda: Answer.CANNOT)
    with pytest.raises(StepRefusedError, match="cannot do it: Put the robot on a stand"):
        session.ask(Task.LIFT)


def test_drive_that_faults_is_named(site: SimulatedSite, session: Session) -> None:
    def drive() -> None:
        with session.driving():
            assert site.person.robot is not None
            site.person.robot.devices[0].is_broken = True  # type: ignore[attr-defined]  # it is a wheel board
            session.drive(1.0, {"left": 0.1})

    with pytest.raises(
        StepRefusedError, match="while a wheel was driven: the wheel board switched its motors off: FAULT"
    ):
        drive()


def test_missing_watchdog_does_not_let_a_wheel_get_away() -> None:
    site = SimulatedSite(load_robot("segway"), ERRORS["no watchdog"])
    with site.session() as session, session.driving():
        session.drive(0.1, {"left": 1.0})
        session.record(5.0, until=lambda _: session.too_fast(), silent=True)
    assert given(site) == [0.0, 0.0]
