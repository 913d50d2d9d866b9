# SPDX-License-Identifier: MIT
"""Sequence control against a running model node, each a process of its own."""

import json
import re
import signal
from itertools import pairwise
from pathlib import Path

import pytest

from tests.ros_processes import Ask, Start, output, receive_until

pytestmark = pytest.mark.ros

NS_PER_S = 1_000_000_000


@pytest.fixture(scope="module", autouse=True)
def robot(start_for_all: Start, foreign: Ask) -> None:
    """A robot in /shared for all tests that do not mind what was done to it before."""
    start_for_all("shared", "run", "cart", "--ros", "--no-log", "--namespace", "/shared")
    assert foreign("wait_for", node="model", namespace="/shared")


@pytest.fixture
def armed(foreign: Ask) -> None:
    """The shared robot at rest and armed, whatever the test before left."""
    foreign("call", service="/shared/model/disarm")
    assert foreign("call", service="/shared/model/arm")[0] is True
    foreign("listen", topic="/shared/setpoint")
    receive_until(foreign, "/shared/odom", lambda odom: abs(odom["linear"]) < 0.01)


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
