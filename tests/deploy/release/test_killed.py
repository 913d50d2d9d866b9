# SPDX-License-Identifier: MIT
"""The robot's side killed at every step, as when the power goes, and at every change that it makes to the disk."""

import pytest

from segway_ecc.deploy.release.agent.store import Store
from segway_ecc.deploy.release.host import ConnectionLostError, UnreachableError, UpdateRefusedError
from segway_ecc.node.errors import NodeError
from tests.deploy.release.robot import LocalHost, Robot

STEPS = ("check", "receive", "venv", "install", "complete", "selftest", "switch", "restart", "trial", "end")


@pytest.fixture(scope="module")
def running(module_robot: Robot) -> str:
    """A first release, healthy."""
    with LocalHost(module_robot) as host:
        return str(module_robot.push(host, "1.0")["current"])


def killed_push(robot: Robot, version: str, kill_at: str) -> None:
    with LocalHost(robot, kill_at) as host, pytest.raises((ConnectionLostError, UnreachableError)):
        robot.push(host, version)
    robot.wait_until_settled()
    robot.check_works()


@pytest.mark.variants(2)
@pytest.mark.parametrize("at", STEPS)
@pytest.mark.usefixtures("running")
def test_killed_at_a_step(module_robot: Robot, at: str) -> None:
    version = f"2.{STEPS.index(at)}"
    killed_push(module_robot, version, kill_at=at)
    with LocalHost(module_robot) as host:
        assert module_robot.push(host, version)["outcome"] in {"healthy", "already"}
    assert str(module_robot.store.current()).startswith(version)
    module_robot.check_works()
    assert module_robot.store.incomplete() == []


@pytest.mark.variants(1)
@pytest.mark.parametrize("at", ["trial", "back"])
@pytest.mark.usefixtures("running")
def test_killed_in_the_trial_of_a_broken_version_the_next_push_goes_back_first(module_robot: Robot, at: str) -> None:
    before = module_robot.store.current()
    broken = f"3.0+bad.{at}"
    killed_push(module_robot, broken, kill_at=at)
    assert module_robot.journal.pending() is not None
    with LocalHost(module_robot, "settle") as host, pytest.raises(ConnectionLostError):
        module_robot.push(host, f"3.1.{len(at)}")
    # A node in FAULT is not armed: the services may be restarted.
    with LocalHost(module_robot) as host, pytest.raises(UpdateRefusedError, match="no complete release"):
        module_robot.rollback(host, "nowhere")
    assert module_robot.store.current() == before
    assert module_robot.journal.pending() is None
    states = {m.version: m.state for m in module_robot.store.complete()}
    assert states[broken] == ("failed" if at == "back" else "interrupted")


@pytest.mark.proof
def test_killed_at_every_change_of_the_disk(robot: Robot) -> None:
    with LocalHost(robot) as host:
        robot.push(host, "1.0")
    count = changes = 0
    while True:
        count += 1
        with LocalHost(robot, kill_after=count) as host:
            try:
                robot.push(host, f"2.{count}")
                break
            except NodeError:
                changes += 1
        robot.wait_until_settled()
        robot.check_works()
        with LocalHost(robot) as host:
            assert robot.push(host, f"2.{count}")["outcome"] in {"healthy", "already"}, count
        robot.check_works()
        assert len(Store(robot.root).complete()) <= 4
    print(f"killed at each of {changes} changes")  # noqa: T201 - the figure of the proof
    assert changes > 20
