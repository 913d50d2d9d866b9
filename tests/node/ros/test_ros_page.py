# SPDX-License-Identifier: MIT
"""The page for ROS users: its table against a robot that runs, and its programs as they stand."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.ros_package.test_bringup import PACKAGE, commands, options_of, parsed
from tests.ros_processes import Ask, Start, output

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "ros.md").read_text("utf-8")
ROW = re.compile(r"^\| (in|out) \| `([\w/]+)` \| ([\w/]+) \| ([^|]*) \|", re.MULTILINE)
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


COMMANDS = re.findall(r"^    (segway-ecc .*?)(?:\s+#.*)?$", PAGE, re.MULTILINE)
LAUNCHES = re.findall(r"^    ros2 launch segway_ecc_bringup (.*)$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_is_one_that_the_command_line_takes(command: str) -> None:
    assert options_of(shlex.split(command))


@pytest.mark.parametrize("launch", LAUNCHES)
def test_a_launch_of_the_page_has_arguments_that_its_file_takes(launch: str) -> None:
    name, *arguments = shlex.split(launch)
    given = dict(argument.split(":=") for argument in arguments)
    path = PACKAGE / "launch" / name
    assert given.keys() <= {each.get("name") for each in parsed(path).iter("arg")}
    (words,) = commands(path, **given)
    assert options_of(words)


def table() -> dict[str, dict[str, list[str]]]:
    """What the page's table has of topics, as a node sees them."""
    found: dict[str, dict[str, list[str]]] = {"in": {}, "out": {}}
    for direction, topic, kind, qos in ROW.findall(PAGE):
        reliability = "BEST_EFFORT" if "best effort" in qos else "RELIABLE"
        durability = "TRANSIENT_LOCAL" if "transient local" in qos else "VOLATILE"
        found[direction][f"/{topic}"] = [kind, reliability, durability]
    return found


def test_the_table_has_every_topic_of_the_segway_with_type_and_qos(start: Start, foreign: Ask) -> None:
    start("segway", "lock-step", "segway")
    names = ("arm", "disarm", "stop", "clear_fault", "stand_up", "sit_down")
    expected: dict[str, Any] = table()
    assert len(expected["in"]) + len(expected["out"]) > 20
    expected["services"] = {f"/model/{name}": ["std_srvs/srv/Trigger"] for name in names}
    for direction, reliability in (("in", "BEST_EFFORT"), ("out", "RELIABLE")):
        expected[direction]["/clock"] = ["rosgraph_msgs/msg/Clock", reliability, "VOLATILE"]
    assert foreign("wait_for", node="model", namespace="/")
    assert foreign("look", namespace="/", expected=expected) == expected
    assert all(f"`model/{name}`" in PAGE for name in names)


def test_the_programs_of_the_page_run_as_they_stand(
    start: Start, ros_environment: dict[str, str], tmp_path: Path
) -> None:
    reader, controller = PROGRAMS
    log = tmp_path / "run.mcap"
    robot = start("robot", "lock-step", "cart", "--turn", "0.05", "--duration", "5", "--log", str(log), "--json")
    words = [sys.executable, "-c"]
    environment = {**os.environ, **ros_environment}
    subprocess.run([*words, controller], cwd=tmp_path, env=environment, check=True)
    assert '"unanswered": 0' in output(robot)
    read = subprocess.run([*words, reader], cwd=tmp_path, check=True, capture_output=True, text=True)
    lines = read.stdout.splitlines()
    assert len(lines) >= 499
    assert float(lines[-1].split()[1]) > 1.0
