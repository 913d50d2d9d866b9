# SPDX-License-Identifier: MIT
"""Sequences that arrive as they do offline, to the last bit, whatever is stopped or killed meanwhile."""

import csv
import json
import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.case_study.study import Trajectory
from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment
from tests.patience import PATIENCE_S
from tests.ros_processes import Ask, Start, output, receive_until

pytestmark = pytest.mark.ros

NS_PER_S = 1_000_000_000


@pytest.fixture
def offline(tmp_path: Path) -> Callable[[Manoeuvre], Trajectory]:
    seat = OfflineSeat(tmp_path)
    return lambda manoeuvre: seat.run("offline", manoeuvre).trajectory


def received(path: Path) -> list[dict[str, float]]:
    with path.open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def assert_same_bits(rows: list[dict[str, float]], expected: Trajectory) -> None:
    assert [row["x"] for row in rows] == expected.x
    assert [row["y"] for row in rows] == expected.y
    assert [row["linear_velocity"] for row in rows] == expected.linear_velocity
    assert [row["angular_velocity"] for row in rows] == expected.angular_velocity


def test_three_numbers_give_the_bits_of_the_offline_seat(
    start: Start, tmp_path: Path, offline: Callable[[Manoeuvre], Trajectory]
) -> None:
    expected = offline(Manoeuvre(segments=(Segment(linear=2.0, angular=2.0, duration=1.0),)))
    start("three.node", "run", "cart", "--ros", "--no-log", "--namespace", "/three")
    words = ["sequence", "2", "2", "1", "--namespace", "/three", "--json", "--csv", str(tmp_path / "heard.csv")]
    sequence = start("three", *words)
    result = json.loads(output(sequence))

    assert sequence.returncode == 0
    assert (result["end"]["x"], result["end"]["y"]) == (expected.x[-1], expected.y[-1])
    assert result["end_ns"] - result["start_ns"] == NS_PER_S
    assert result["end"]["stamp_ns"] == result["end_ns"]
    assert {
        "publisher": "/three/sequence_control",
        "topic": "/three/cmd_trajectory",
        "type_name": "trajectory_msgs/msg/MultiDOFJointTrajectory",
        "subscriber": "/three/model",
    } in result["graph"]
    assert_same_bits(received(tmp_path / "heard.csv"), expected)


def test_a_file_of_two_segments_gives_the_bits_of_the_offline_seat(
    start: Start, tmp_path: Path, messages: Path, offline: Callable[[Manoeuvre], Trajectory]
) -> None:
    file = tmp_path / "turn.yaml"
    file.write_text(
        "segments:\n  - {linear: 1.0, angular: 0.5, duration: 0.7}\n  - {angular: -2.0, duration: 0.5}\n", "utf-8"
    )
    segments = (Segment(linear=1.0, angular=0.5, duration=0.7), Segment(linear=0.0, angular=-2.0, duration=0.5))
    expected = offline(Manoeuvre(segments=segments))
    start("two.node", "run", "cart", "--ros", "--no-log", "--namespace", "/two")
    sequence = start("two", "sequence", str(file), "--namespace", "/two", "--csv", str(tmp_path / "heard.csv"))
    printed = output(sequence)

    assert sequence.returncode == 0
    assert printed.startswith(f"after 1.2 s at x {expected.x[-1]:.4f} m, y {expected.y[-1]:.4f} m, heading ")
    assert not (messages / "two.txt").read_text()
    assert_same_bits(received(tmp_path / "heard.csv"), expected)


@pytest.mark.parametrize("stop_s", [0.8, 3.0])
def test_a_player_that_is_stopped_meanwhile_changes_no_bit_and_loses_no_odometry(
    start: Start, foreign: Ask, tmp_path: Path, offline: Callable[[Manoeuvre], Trajectory], stop_s: float
) -> None:
    expected = offline(Manoeuvre(segments=(Segment(linear=1.0, angular=0.5, duration=5.0),)))
    space = f"/stopped{stop_s * 10:.0f}"
    start(f"{space[1:]}.node", "run", "cart", "--ros", "--no-log", "--namespace", space)
    way = tmp_path / "way.csv"
    sequence = start(space[1:], "sequence", "1", "0.5", "5", "--namespace", space, "--json", "--csv", str(way))
    receive_until(foreign, f"{space}/odom", lambda odom: odom["linear"] > 0.5)
    (worker,) = Path(f"/proc/{sequence.pid}/task/{sequence.pid}/children").read_text().split()
    for number in (signal.SIGSTOP, signal.SIGCONT):
        for pid in (sequence.pid, int(worker)):
            os.kill(pid, number)
        time.sleep(stop_s if number is signal.SIGSTOP else 0.0)
    result = json.loads(output(sequence))
    assert sequence.returncode == 0
    assert (result["end"]["x"], result["end"]["y"]) == (expected.x[-1], expected.y[-1])
    assert_same_bits(received(way), expected)


@pytest.mark.parametrize("killed", ["player", "ros process"])
def test_whatever_is_killed_meanwhile_changes_no_bit(
    start: Start, foreign: Ask, messages: Path, offline: Callable[[Manoeuvre], Trajectory], killed: str
) -> None:
    expected = offline(Manoeuvre(segments=(Segment(linear=1.0, angular=0.5, duration=3.0),)))
    space = f"/{killed.replace(' ', '_')}"
    log, way = messages / f"{space[1:]}.mcap", messages / f"{space[1:]}.csv"
    node = start(f"{space[1:]}.node", "run", "cart", "--ros", "--log", str(log), "--namespace", space)
    sequence = start(space[1:], "sequence", "1", "0.5", "3", "--namespace", space, "--csv", str(way))
    receive_until(foreign, f"{space}/odom", lambda odom: odom["linear"] > 0.5)
    ros_process = helpers_of(node.pid)["ros"]
    os.kill(sequence.pid if killed == "player" else ros_process, signal.SIGKILL)
    output(sequence)
    if killed == "player":
        assert sequence.returncode == -signal.SIGKILL
    else:  # ROS is back before the player gives up, and before the end or after it: then nothing shows the cause
        assert sequence.returncode == 13
        (line,) = (messages / f"{space[1:]}.txt").read_text().splitlines()
        assert re.search(r" lost(, .*)?: (the robot's ROS process ended meanwhile|on the way, it is not known)", line)
    assert not way.exists()
    end = (expected.x[-1], expected.y[-1])
    deadline_s = time.monotonic() + PATIENCE_S
    while end not in (driven := recorded_way(log)):
        assert time.monotonic() < deadline_s, "the robot does not get where it was to go"
        time.sleep(0.5)
    last = driven.index(end) + 1
    assert driven[last - len(expected.x) : last] == list(zip(expected.x, expected.y, strict=True))
    node.send_signal(signal.SIGINT)
    output(node)


def recorded_way(log: Path) -> list[tuple[float, float]]:
    """Where the robot was in each cycle of a log that may not be finished."""
    run = RecordedRun(log)
    x, y = (run.layout.published.index(name) for name in ("odometry.x", "odometry.y"))
    return [(record.published[x], record.published[y]) for record in run.cycles()]
