# SPDX-License-Identifier: MIT
"""A simulated robot in ROS by simulated time, as somebody's controller drives it: the same bits every time."""

import itertools
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

from segway_ecc.node.replay.replay import replay
from tests.ros_processes import Ask, Start, output

pytestmark = pytest.mark.ros

CLIENT = Path(__file__).with_name("sim_time_client.py")
TURNS = 60
TURN_NS = 50_000_000
FIRST_NS = 1_700_000_000_000_000_000
Drive = Callable[..., list[list[float]]]


@pytest.fixture
def drive(ros_environment: dict[str, str]) -> Drive:
    """Called with further words for the client; returns what it saw and did."""

    def drive(*words: str) -> list[list[float]]:
        found = subprocess.run(
            [sys.executable, str(CLIENT), str(TURNS), *words],
            env=ros_environment,
            check=True,
            capture_output=True,
            text=True,
        )
        rows: list[list[float]] = json.loads(found.stdout)
        return rows

    return drive


def simulated(start: Start, robot: str, *words: str, turns: int = TURNS) -> "subprocess.Popen[str]":
    """A robot that stands still after each turn, and ends before one that nobody takes."""
    return start("robot", "lock-step", robot, "--turn", "0.05", "--duration", f"{0.05 * turns}", "--json", *words)


def result(process: "subprocess.Popen[str]") -> Any:
    return json.loads(output(process))


def test_the_same_controller_drives_the_same_trajectory_to_the_last_bit(start: Start, drive: Drive) -> None:
    runs = []
    for _ in range(2):
        robot = simulated(start, "cart")
        runs.append(drive())
        found = result(robot)
        assert (found["cycles"], found["unanswered"]) == (TURNS * 5, 0)
    first, second = runs
    assert len(first) == TURNS
    assert first == second
    times = [int(row[0]) - FIRST_NS for row in first]
    assert [after - before for before, after in itertools.pairwise(times)] == [TURN_NS] * (TURNS - 1)
    assert 0 < times[0] < TURN_NS
    assert first[-1][1] > 0.5, "it drives"


def test_a_recorded_run_is_read_as_a_bag_and_its_commands_drive_the_same_way(
    start: Start, drive: Drive, tmp_path: Path
) -> None:
    log, commands = tmp_path / "run.mcap", tmp_path / "commands.json"
    robot = simulated(start, "cart", "--log", str(log))
    driven = drive()
    assert result(robot)["unanswered"] == 0
    with AnyReader([log]) as bag:
        topics = {connection.topic: connection.msgtype for connection in bag.connections}
        assert topics["/odom"] == "nav_msgs/msg/Odometry"
        setpoints: list[Any] = [
            bag.deserialize(data, connection.msgtype)
            for connection, _, data in bag.messages()
            if connection.topic == "/setpoint"
        ]
    applied = {
        each.header.stamp.sec * 10**9 + each.header.stamp.nanosec: [each.twist.linear.x, each.twist.angular.z]
        for each in setpoints
    }
    # A set-point is taken in the cycle after the clock for which it was sent.
    times = [int(row[0]) for row in driven]
    commands.write_text(json.dumps({str(at): applied[at + 10_000_000] for at in times}), "utf-8")
    again = simulated(start, "cart")
    assert drive(str(commands)) == driven
    assert result(again)["unanswered"] == 0
    assert replay(log).is_identical


def test_a_controller_that_arms_the_robot_drives_the_same_way_every_time(
    start: Start, drive: Drive, on_request: str
) -> None:
    runs = []
    for _ in range(2):
        robot = simulated(start, on_request, turns=TURNS + 1)
        runs.append(drive("arm"))
        assert result(robot)["unanswered"] == 0
    assert len(runs[0]) == TURNS
    assert runs[0] == runs[1]
    assert runs[0][-1][1] > 0.5


def test_a_segway_balances_in_turns_with_a_controller(start: Start, drive: Drive) -> None:
    runs = []
    for _ in range(2):
        robot = simulated(start, "segway")
        runs.append(drive())
        found = result(robot)
        assert (found["unanswered"], found["refused_frames"]) == (0, 0)
        assert found["diagnostics"]["segway: mode"]["mode"] in ("ARMED", "HOLD")
    assert runs[0] == runs[1]


def test_without_turns_the_clock_goes_on_by_itself(start: Start, foreign: Ask) -> None:
    start("robot", "lock-step", "cart", "--speed", "20")
    first, last = foreign("receive", topic="/clock")[0], foreign("receive", topic="/clock")[-1]
    assert FIRST_NS < first < last
    odom = foreign("receive", topic="/odom")[-1]
    assert odom["stamp_ns"] > FIRST_NS
    assert odom["stamp_ns"] < FIRST_NS + 10**14, "simulated time"
    accepted, reason = foreign("set_parameter", node="/model", name="use_sim_time", value=False)
    assert not accepted
    assert reason == "'use_sim_time' must be true: this robot is simulated, and runs by the time that is on /clock"


@pytest.mark.parametrize("robot", ["cart-hoverboard", "segway-moteus", "arm"])
def test_a_robot_on_any_line_is_armed_on_simulated_time(start: Start, robot: str) -> None:
    found = result(start("robot", "lock-step", robot, "--speed", "1000", "--duration", "2", "--json"))
    assert found["simulated_s"] == 2.0
    assert found["diagnostics"][f"{robot}: mode"]["mode"] == "ARMED"
    assert found["refused_frames"] == 0


NO_SIM_TIME = (
    "'use_sim_time' must be false: this robot runs by its machine's clock; simulate it by one of its own, which it "
    "publishes on /clock, with segway-ecc lock-step ROBOT"
)


def test_a_robot_that_runs_in_real_time_refuses_simulated_time_in_one_line(start: Start, messages: Path) -> None:
    words = ["run", "cart", "--ros", "--no-log", "--duration", "9", "--ros-args", "-p", "use_sim_time:=true"]
    assert start("refused", *words).wait() == 2
    (line,) = (messages / "refused.txt").read_text().splitlines()
    assert line == f"segway-ecc: parameter override: {NO_SIM_TIME}"


def test_a_robot_that_runs_in_real_time_refuses_simulated_time_later_too(start: Start, foreign: Ask) -> None:
    start("robot", "run", "cart", "--ros", "--no-log", "--namespace", "/real")
    assert foreign("wait_for", node="model", namespace="/real")
    assert foreign("set_parameter", node="/real/model", name="use_sim_time", value=True) == [False, NO_SIM_TIME]
    assert foreign("set_parameter", node="/real/model", name="use_sim_time", value=False) == [True, ""]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--speed", "0"], "--speed must be more than 0 and at most 1e+06, not 0"),
        (["--turn", "0.001"], "--turn is 0.001 s, less than a step of 0.01 s"),
        (["--patience", "0"], "--patience must be more than 0 s and at most 1e+09 s"),
    ],
)
def test_a_pace_that_cannot_be_kept_is_refused(start: Start, messages: Path, words: list[str], line: str) -> None:
    assert start("refused", "lock-step", "cart", *words).wait() == 2
    assert (messages / "refused.txt").read_text().splitlines() == [f"segway-ecc: {line}"]


def test_who_takes_no_turn_is_waited_for_no_longer_than_the_patience(start: Start, foreign: Ask) -> None:
    robot = start("robot", "lock-step", "cart", "--turn", "1", "--patience", "0.1", "--duration", "3", "--json")
    assert foreign("publish", topic="/cmd_vel", kind="Twist", linear=0.5, angular=0.0)
    found = result(robot)
    assert (found["cycles"], found["unanswered"]) == (300, 2)
