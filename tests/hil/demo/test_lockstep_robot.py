# SPDX-License-Identifier: MIT
"""A robot at the pace of real time, which waits where that does not keep up; and what other threads ask of it."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats
from segway_ecc.hil.demo.lockstep_robot import LockstepRobot, NodeKilledError, PacedClock, WatchedClock
from segway_ecc.hil.errors import RigError
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.testing import ScriptedClock
from tests.patience import PATIENCE_S

NS_PER_MS = 1_000_000
TIMES_FASTER = 20


class HurriedClock:
    """Real time, twenty times as fast; see `Clock`."""

    def now_ns(self) -> int:
        return TIMES_FASTER * time.monotonic_ns()

    def wall_ns(self) -> int:
        return self.now_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        time.sleep(max(deadline_ns - self.now_ns(), 0) * 1e-9 / TIMES_FASTER)


def until(is_so: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline_s
        time.sleep(0.001)


@pytest.fixture
def real() -> ScriptedClock:
    return ScriptedClock()


@pytest.fixture
def paced(real: ScriptedClock) -> PacedClock:
    return PacedClock(LockstepRig(1_000_000), real)


def test_the_robots_time_goes_with_real_time(paced: PacedClock, real: ScriptedClock) -> None:
    began_ns = real.now_ns()
    for cycle in range(1, 11):
        paced.sleep_until_ns(cycle * 5 * NS_PER_MS)
    assert (paced.now_ns(), real.now_ns() - began_ns) == (50 * NS_PER_MS, 50 * NS_PER_MS)
    assert paced.wall_ns() == real.wall_ns()


def test_what_is_a_little_late_is_made_up_for(paced: PacedClock, real: ScriptedClock) -> None:
    began_ns = real.now_ns()
    real.sleep_until_ns(began_ns + 50 * NS_PER_MS)
    paced.sleep_until_ns(0)
    paced.sleep_until_ns(60 * NS_PER_MS)
    assert real.now_ns() - began_ns == 60 * NS_PER_MS


def test_a_robot_that_is_too_late_is_behind_from_then_on(paced: PacedClock, real: ScriptedClock) -> None:
    began_ns = real.now_ns()
    real.sleep_until_ns(began_ns + 51 * NS_PER_MS)
    paced.sleep_until_ns(0)
    paced.sleep_until_ns(60 * NS_PER_MS)
    assert real.now_ns() - began_ns == 111 * NS_PER_MS


def test_what_another_thread_asks_is_done_by_the_one_that_waits(paced: PacedClock) -> None:
    done = list[object]()
    asking = threading.Thread(target=lambda: done.append(paced.ask(threading.get_ident)))
    asking.start()
    while not done:
        paced.sleep_until_ns(paced.now_ns() + 1)
    asking.join()
    assert done == [threading.get_ident()]


def test_what_fails_is_for_who_asked(paced: PacedClock) -> None:
    failures = list[BaseException | None]()

    def ask() -> None:
        with pytest.raises(ZeroDivisionError) as found:
            paced.ask(lambda: 1 // 0)
        failures.append(found.value)

    asking = threading.Thread(target=ask)
    asking.start()
    while not failures:
        paced.sleep_until_ns(paced.now_ns() + 1)
    asking.join()


def test_who_asks_in_vain_is_told(paced: PacedClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.demo.lockstep_robot._ANSWERS_WITHIN_S", 0.01)
    with pytest.raises(RigError, match=r"did not answer within 0\.01 s"):
        paced.ask(threading.get_ident)


def test_a_node_is_killed_once(paced: PacedClock) -> None:
    paced.node_is_killed = True
    with pytest.raises(NodeKilledError):
        paced.sleep_until_ns(1)
    paced.sleep_until_ns(2)


def test_others_wait_for_the_robots_time_but_not_for_ever(paced: PacedClock, real: ScriptedClock) -> None:
    began_ns = real.now_ns()
    WatchedClock(paced, real).sleep_until_ns(10 * NS_PER_MS)
    assert 100 * NS_PER_MS <= real.now_ns() - began_ns < 103 * NS_PER_MS
    paced.sleep_until_ns(10 * NS_PER_MS)
    began_ns = real.now_ns()
    WatchedClock(paced, real).sleep_until_ns(10 * NS_PER_MS)
    assert real.now_ns() == began_ns


class Watched:
    """A robot that runs as fast as it can, and a station that looks at it."""

    def __init__(self, robot: LockstepRobot) -> None:
        self.robot = robot
        events = EventLog(lambda: 0)
        self._handler = CommandHandler(events, Heartbeats("base"), Setpoint(1.0, 1.0))
        self.connected = robot.network.connect(self._handler, None, events)

    def state(self) -> str:
        self.robot.network.poll(everything=True)
        robots = self._handler.view(time.monotonic_ns()).robots
        return f"{robots[0].mode} {robots[0].posture}" if robots else ""


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[Watched]:
    with LockstepRobot(load_robot("segway"), tmp_path, HurriedClock()) as robot:
        made = Watched(robot)
        with made.connected:
            yield made


def test_it_stands_up_falls_without_its_node_and_is_there_again(watched: Watched, tmp_path: Path) -> None:
    robot = watched.robot
    until(lambda: watched.state() == "ARMED BALANCING")
    robot.tell("write PushForce 10")
    assert robot.last_driven_ns() is not None
    killed_ns = robot.kill("node")
    until(lambda: not robot.network.is_alive)
    robot.clock.sleep_until_ns(killed_ns + 500 * NS_PER_MS)
    driven_ns = robot.last_driven_ns()
    assert driven_ns is not None
    assert 0 < driven_ns - killed_ns <= 34 * NS_PER_MS, "by the guard"
    robot.revive()
    until(lambda: robot.network.is_alive)
    until(lambda: watched.state() in {"DISARMED RESTING", "ARMED BALANCING"})
    assert list(tmp_path.glob("segway-*.mcap"))


def test_without_its_guard_the_drives_watchdog_ends_it(watched: Watched) -> None:
    robot = watched.robot
    until(lambda: watched.state() == "ARMED BALANCING")
    robot.kill("guard")
    killed_ns = robot.kill("node")
    robot.clock.sleep_until_ns(killed_ns + 500 * NS_PER_MS)
    driven_ns = robot.last_driven_ns()
    assert driven_ns is not None
    assert 34 * NS_PER_MS < driven_ns - killed_ns <= 54 * NS_PER_MS


def test_what_the_plant_refuses_is_said(watched: Watched) -> None:
    with pytest.raises(RigError, match="the plant: refused: nothing measured begins with 'tail'"):
        watched.robot.tell("freeze tail")
