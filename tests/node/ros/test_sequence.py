# SPDX-License-Identifier: MIT
"""Sequence control against a running model node, each a process of its own."""

import csv
import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.case_study.study import Trajectory
from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.node.replay.recorded import RecordedRun
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

pytestmark = pytest.mark.ros

Ask = Callable[..., Any]
Start = Callable[..., "subprocess.Popen[str]"]
PERIOD_NS = 10_000_000
NS_PER_S = 1_000_000_000
ENDS_WITHIN_S = 30.0
TRIES = 2000


@pytest.fixture
def offline(tmp_path: Path) -> Callable[[Manoeuvre], Trajectory]:
    seat = OfflineSeat(tmp_path)
    return lambda manoeuvre: seat.run("offline", manoeuvre).trajectory


@pytest.fixture(scope="module", autouse=True)
def robot(start: Start, foreign: Ask) -> None:
    """A robot in /shared for all tests that do not mind what was done to it before."""
    start("shared", "run", "cart", "--ros", "--no-log", "--namespace", "/shared")
    assert foreign("wait_for", node="model", namespace="/shared")


@pytest.fixture
def armed(foreign: Ask) -> None:
    """The shared robot at rest and armed, whatever the test before left."""
    foreign("call", service="/shared/model/disarm")
    assert foreign("call", service="/shared/model/arm")[0] is True
    foreign("listen", topic="/shared/setpoint")
    receive_until(foreign, "/shared/odom", lambda odom: abs(odom["linear"]) < 0.01)


def receive_until(foreign: Ask, topic: str, wanted: Callable[[Any], bool]) -> Any:
    """The first message on a topic that is as wanted."""
    for _ in range(TRIES):
        received = foreign("receive", topic=topic)
        assert received, f"nothing comes on {topic}"
        for message in received:
            if wanted(message):
                return message
    pytest.fail(f"no message on {topic} is as wanted; the last was {received[-1]}")


def output(process: "subprocess.Popen[str]") -> str:
    text, _ = process.communicate(timeout=ENDS_WITHIN_S)
    return text


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


def test_a_missing_model_node_is_reported_with_the_nodes_seen(start: Start, messages: Path) -> None:
    sequence = start("nobody", "sequence", "1", "0", "1", "--namespace", "/empty", "--wait", "4")

    assert output(sequence) == ""
    assert sequence.returncode == 6
    (line,) = (messages / "nobody.txt").read_text().splitlines()
    assert line.startswith("segway-ecc: no model node subscribed to /empty/cmd_trajectory")
    assert "within 4 s in namespace /empty" in line
    assert re.search(r"; nodes seen: .*/\w+/model", line)
    assert "segway-ecc run ROBOT" in line


def test_a_disarmed_robot_is_reported_and_arm_arms_it(
    start: Start, messages: Path, foreign: Ask, on_request: str
) -> None:
    start("waiting.node", "run", on_request, "--ros", "--no-log", "--namespace", "/waiting")
    refused = start("refused", "sequence", "1", "0", "0.2", "--namespace", "/waiting")

    assert output(refused) == ""
    assert refused.returncode == 6
    (line,) = (messages / "refused.txt").read_text().splitlines()
    assert line == (
        "segway-ecc: the robot is DISARMED (just started) and takes no set-points: arm it first, or add --arm"
    )
    arming = start("arming", "sequence", "1", "0", "0.2", "--namespace", "/waiting", "--arm")
    assert output(arming).startswith("after 0.2 s at x ")
    assert arming.returncode == 0
    assert foreign("call", service="/waiting/model/arm") == [True, "armed already"]


def test_a_refusal_to_arm_is_reported_with_its_reason(start: Start, messages: Path, foreign: Ask) -> None:
    assert foreign("call", service="/shared/model/stop")[0] is True
    refused = start("stopped", "sequence", "1", "0", "0.2", "--namespace", "/shared", "--arm")
    output(refused)
    foreign("call", service="/shared/model/clear_fault")

    assert refused.returncode == 6
    (line,) = (messages / "stopped.txt").read_text().splitlines()
    assert line == "segway-ecc: the robot refuses to arm: clear the fault first: stop was pressed"


def test_a_signal_ends_the_waiting_for_a_robot(start: Start, messages: Path, foreign: Ask) -> None:
    sequence = start("waiting", "sequence", "1", "0.5", "60", "--namespace", "/nobody", "--wait", "600")
    assert foreign("wait_for", node="sequence_control", namespace="/nobody")
    sequence.send_signal(signal.SIGTERM)
    output(sequence)

    assert sequence.returncode == 1
    (line,) = (messages / "waiting.txt").read_text().splitlines()
    assert line == "segway-ecc: abandoned by SIGTERM while waiting for the robot"


@pytest.mark.usefixtures("armed")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_sequence_leaves_the_robot_at_rest(
    start: Start, messages: Path, foreign: Ask, number: signal.Signals
) -> None:
    sequence = start(f"interrupted.{number}", "sequence", "1", "0.5", "60", "--namespace", "/shared")
    receive_until(foreign, "/shared/odom", lambda odom: odom["linear"] > 0.9)
    foreign("receive", topic="/shared/setpoint")
    sequence.send_signal(number)
    output(sequence)

    assert sequence.returncode == 1
    (line,) = (messages / f"interrupted.{number}.txt").read_text().splitlines()
    assert line == f"segway-ecc: abandoned by {number.name}; the robot was stopped"
    rest = receive_until(foreign, "/shared/odom", lambda odom: abs(odom["linear"]) < 0.01)
    receive_until(foreign, "/shared/odom", lambda odom: odom["stamp_ns"] > rest["stamp_ns"] + NS_PER_S)
    receive_until(foreign, "/shared/setpoint", lambda setpoint: (setpoint["linear"], setpoint["angular"]) == (0.0, 0.0))
    # Cancelled, the robot rests and stays armed.
    foreign("receive", topic="/shared/diagnostics")
    assert foreign("receive", topic="/shared/diagnostics")[-1]["cart: mode"]["mode"] == "ARMED"


@pytest.mark.usefixtures("armed")
def test_a_robot_that_is_disarmed_meanwhile_ends_the_sequence(start: Start, messages: Path, foreign: Ask) -> None:
    sequence = start("disarmed", "sequence", "1", "0", "60", "--namespace", "/shared")
    receive_until(foreign, "/shared/odom", lambda odom: odom["linear"] > 0.9)
    assert foreign("call", service="/shared/model/disarm")[0] is True
    output(sequence)

    assert sequence.returncode == 7
    (line,) = (messages / "disarmed.txt").read_text().splitlines()
    assert line == "segway-ecc: the robot went to DISARMED: asked to disarm"


def test_a_model_node_that_is_killed_ends_the_sequence(start: Start, messages: Path, foreign: Ask) -> None:
    node = start("killed.node", "run", "cart", "--ros", "--no-log", "--namespace", "/killed")
    sequence = start("killed", "sequence", "1", "0", "60", "--namespace", "/killed")
    receive_until(foreign, "/killed/odom", lambda odom: odom["linear"] > 0.5)
    node.kill()
    output(sequence)

    assert sequence.returncode == 7
    (line,) = (messages / "killed.txt").read_text().splitlines()
    assert line == "segway-ecc: the model node has published no odometry for 8 s; is it still running?"


@pytest.mark.usefixtures("armed")
def test_a_manoeuvre_that_the_robot_refuses_ends_with_its_reason(start: Start, messages: Path) -> None:
    sequence = start("refused.sequence", "sequence", "1e308", "0", "1", "--namespace", "/shared")
    assert output(sequence) == ""
    assert sequence.returncode == 13
    (line,) = (messages / "refused.sequence.txt").read_text().splitlines()
    assert line.startswith("segway-ecc: the robot refused the sequence: it asks for 1e+308 m/s; at most ")


@pytest.mark.usefixtures("armed")
def test_a_segment_that_is_shorter_than_half_a_cycle_is_refused(start: Start, messages: Path) -> None:
    sequence = start("short", "sequence", "1", "0", "0.004", "--namespace", "/shared")
    assert (output(sequence), sequence.returncode) == ("", 13)
    assert (messages / "short.txt").read_text() == (
        "segway-ecc: the robot refused the sequence: points 0 and 1 fall into one cycle, of 0.01 s: one would not be "
        "driven\n"
    )


@pytest.mark.usefixtures("armed")
def test_the_duration_that_is_printed_is_the_one_that_was_driven(start: Start) -> None:
    sequence = start("rounded", "sequence", "1", "0", "0.015", "--namespace", "/shared")
    assert output(sequence).startswith("after 0.02 s at x ")
    assert sequence.returncode == 0


@pytest.mark.usefixtures("armed")
def test_of_several_players_at_once_each_has_its_whole_manoeuvre_or_an_exit_code(start: Start, messages: Path) -> None:
    durations = {"once": 1, "twice": 2, "same": 2}
    players = {
        name: start(name, "sequence", "1", "0", str(seconds), "--namespace", "/shared", "--json")
        for name, seconds in durations.items()
    }
    results = {name: output(player) for name, player in players.items()}
    done = {name: json.loads(printed) for name, printed in results.items() if players[name].returncode == 0}
    assert done
    assert {name: (way["end_ns"] - way["start_ns"]) / NS_PER_S for name, way in done.items()} == {
        name: durations[name] for name in done
    }
    # More than one only where the machine was so slow that one had ended before the next began.
    assert all(one["end_ns"] <= other["start_ns"] for one, other in pairwise(sorted(done.values(), key=_start_ns)))
    for name in results.keys() - done:
        assert (results[name], players[name].returncode) == ("", 7)
        assert (messages / f"{name}.txt").read_text() == "segway-ecc: another trajectory took its place\n"


def _start_ns(way: dict[str, int]) -> int:
    return way["start_ns"]


def test_two_robots_in_one_namespace_are_refused(start: Start, foreign: Ask, messages: Path) -> None:
    for name in ("one", "other"):
        start(f"{name}.node", "run", "cart", "--ros", "--no-log", "--namespace", "/both")
    assert foreign("wait_for_publishers", topic="/both/odom", count=2)
    sequence = start("both", "sequence", "1", "0", "60", "--namespace", "/both", "--wait", "60")
    assert (output(sequence), sequence.returncode) == ("", 6)
    assert (messages / "both.txt").read_text() == (
        "segway-ecc: 2 robots are in namespace /both, and which one answers is not known: give each its own with "
        "--namespace\n"
    )


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
    deadline_s = time.monotonic() + ENDS_WITHIN_S
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
