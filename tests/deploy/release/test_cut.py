# SPDX-License-Identifier: MIT
"""The connection cut at every step, by the death of sshd's end of it."""

import contextlib

import pytest

from segway_ecc.deploy.release.host import ConnectionLostError, Event, Host
from tests.deploy.release.robot import Robot, Sshd

BEFORE = ("check", "receive", "need", "venv", "install", "complete", "selftest", "ready")
AFTER = ("switch", "restart", "trial", "end")
MAY_END = (*AFTER, "back")
REPORTED = "deploy status robot"


@pytest.fixture(scope="module")
def running(module_robot: Robot, sshd: Sshd) -> str:
    """A first release, healthy."""
    with Host("robot", config=sshd.config) as host:
        ended = module_robot.push(host, "1.0")
    assert ended["outcome"] == "healthy"
    return str(ended["current"])


def cut_push(robot: Robot, sshd: Sshd, version: str, at: str) -> None:
    def cut(event: Event) -> None:
        if at in {event.get("step"), event["event"]}:
            sshd.cut()

    # After the switch the robot does not wait for us: it may have reported its end before the cut took effect.
    expected = (
        contextlib.suppress(ConnectionLostError)
        if at in MAY_END
        else pytest.raises(ConnectionLostError, match=REPORTED)
    )
    with Host("robot", config=sshd.config) as host, expected:
        robot.push(host, version, cut)
    robot.wait_until_settled()
    robot.check_works()


@pytest.mark.variants(2)
@pytest.mark.parametrize("at", BEFORE)
@pytest.mark.usefixtures("running")
def test_cut_before_the_switch_nothing_is_switched(module_robot: Robot, sshd: Sshd, ssh_host: Host, at: str) -> None:
    before, version = module_robot.store.current(), f"2.{BEFORE.index(at)}"
    cut_push(module_robot, sshd, version, at)
    assert module_robot.store.current() == before
    assert module_robot.journal.pending() is None
    ended = module_robot.push(ssh_host, version)
    assert (ended["outcome"], ended["release"].partition("-")[0]) == ("healthy", version)
    module_robot.check_works()


@pytest.mark.variants(2)
@pytest.mark.parametrize("at", AFTER)
@pytest.mark.usefixtures("running")
def test_cut_after_the_switch_the_robot_ends_by_itself_what_it_began(
    module_robot: Robot, sshd: Sshd, ssh_host: Host, at: str
) -> None:
    version = f"3.{AFTER.index(at)}"
    cut_push(module_robot, sshd, version, at)
    last = module_robot.journal.last()
    assert last is not None
    assert (last.outcome, last.release, module_robot.journal.pending()) == (
        "healthy",
        module_robot.store.current(),
        None,
    )
    assert last.release.startswith(version)
    assert module_robot.push(ssh_host, version)["outcome"] == "already"


@pytest.mark.usefixtures("running")
@pytest.mark.parametrize("at", ["trial", "back"])
def test_cut_in_the_trial_of_a_broken_version_the_robot_goes_back_by_itself(
    module_robot: Robot, sshd: Sshd, ssh_host: Host, at: str
) -> None:
    before = module_robot.store.current()
    cut_push(module_robot, sshd, f"4.0+bad.{at}", at)
    last = module_robot.journal.last()
    assert last is not None
    assert (last.outcome, module_robot.store.current()) == ("went-back", before)
    assert module_robot.push(ssh_host, f"4.1.{len(at)}")["outcome"] == "healthy"


@pytest.mark.usefixtures("running")
def test_what_was_received_before_the_cut_is_not_sent_again(module_robot: Robot, sshd: Sshd, ssh_host: Host) -> None:
    cut_push(module_robot, sshd, "5.0", "venv")
    asked: list[str] = []

    def note(event: Event) -> None:
        if event["event"] == "need":
            asked.extend(event["files"])

    module_robot.push(ssh_host, "5.0", note)
    assert asked == []
