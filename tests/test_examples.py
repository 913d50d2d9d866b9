# SPDX-License-Identifier: MIT
"""The examples work as they stand, and import only what is public."""

import ast
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from tests.patience import PATIENCE_S

Run = Callable[..., Any]
ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
ALLOWED = {"segway_ecc", "segway_ecc.drives", "segway_ecc.testing", "pocket_drive", "numpy", "rclpy"}
ROBOT = str(EXAMPLES / "robot" / "robot.yaml")


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    before = set(sys.modules)
    yield
    for name in {"tank", "wheels", "controller"} - before:
        sys.modules.pop(name, None)


def test_the_model_is_inspected_and_simulated(segway_ecc: Run) -> None:
    source = str(EXAMPLES / "model" / "tank:Tank")
    inspected = segway_ecc("model", "inspect", source, "--json")
    simulated = segway_ecc("model", "simulate", source, "--duration", "20", "--input", "Inflow=1", "--json")

    assert (inspected.code, simulated.code) == (0, 0)
    assert json.loads(inspected.out)["name"] == "tank"
    # What runs in runs out in the end.
    assert json.loads(simulated.out)["outputs"]["Outflow"] == pytest.approx(1.0, abs=1e-3)


def test_the_robot_loads_and_has_at_most_ten_lines(segway_ecc: Run) -> None:
    assert segway_ecc("deploy", "check", ROBOT).out == "stand loads, and runs at 100 Hz\n"
    assert len(Path(ROBOT).read_text("utf-8").splitlines()) <= 10


@pytest.mark.real_time
def test_the_robot_drives_its_plant(tmp_path: Path) -> None:
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main"]
    bus = ["--interface", "local", "--channel", f"examples{os.getpid()}"]
    sequence, truth = tmp_path / "ahead.yaml", tmp_path / "truth.csv"
    sequence.write_text("segments: [{linear: 0.5, duration: 1.0}]\n")
    with subprocess.Popen(
        [*command, "plant", ROBOT, *bus, "--truth", str(truth)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
    ) as plant:
        try:
            assert plant.stderr is not None
            plant.stderr.readline()
            words = [*command, "run", ROBOT, *bus, "--no-ros", "--no-log", "--sequence", str(sequence)]
            done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        finally:
            plant.terminate()
    names, *rows = [line.split(",") for line in truth.read_text("utf-8").splitlines()]
    speeds = [float(row[names.index("left.velocity")]) for row in rows]

    assert done.returncode == 0, done.stderr
    # 0.5 m/s is 10 rad/s, of which the proportional controller holds 8 once it has settled.
    assert median(speed for speed in speeds if speed > 4.0) == pytest.approx(8.0, rel=0.1)


def test_a_campaign_reports_a_plant_that_does_not_say_where_the_robot_is(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "fault", "can-cut", "--robot", ROBOT)
    text = "segway-ecc: a campaign needs the plant's output truth.x and truth.y: where the robot is"

    assert (outcome.code, outcome.errors) == (8, [text])


def test_failover_reports_a_robot_without_a_position(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "failover", ROBOT, "--interface", "local", "--channel", f"examples{os.getpid()}")
    text = "segway-ecc: robot 'stand' has no odometry.x and odometry.y: wire its model's position"

    assert (outcome.code, outcome.errors[-1]) == (2, text)


@pytest.mark.ros
def test_the_ros_client_drives_a_robot(ros_environment: dict[str, str]) -> None:
    words = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "run", "cart", "--ros", "--no-log"]
    environment = {**os.environ, **ros_environment}
    with subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as robot:
        try:
            client = [sys.executable, str(EXAMPLES / "ros_client" / "drive.py")]
            done = subprocess.run(
                client, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
            )
        finally:
            robot.terminate()

    assert done.returncode == 0, done.stderr
    match = re.fullmatch(r"x = (\S+) m, y = (\S+) m\n", done.stdout)
    assert match is not None
    assert float(match[1]) > 0.1


def imports(text: str) -> Iterator[tuple[str, list[str]]]:
    """The modules that Python source imports, with the names taken from each."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, []) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ".", [alias.name for alias in node.names]


def blocks(markdown: str) -> Iterator[str]:
    """The import statements of a page's code, each with its continuation lines."""
    for line in markdown.splitlines():
        match = re.match(r"\s+(?:>>> )?((?:from|import) [A-Za-z_][\w.]*(?: .*)?)$", line)
        if match is not None and ("import" in match[1].split()[:3]):
            yield match[1].removesuffix("(").strip()


def is_public(module: str, names: list[str]) -> bool:
    if module.startswith("segway_ecc"):
        public = __import__("importlib").import_module(module) if module in ALLOWED else None
        return public is not None and all(hasattr(public, name) for name in names)
    top = module.partition(".")[0]
    return top in ALLOWED | set(sys.stdlib_module_names) or top.endswith(("_msgs", "_srvs"))


@pytest.mark.parametrize("path", sorted(EXAMPLES.rglob("*.py")), ids=lambda path: path.name)
def test_an_example_imports_only_what_is_public(path: Path) -> None:
    assert [module for module, names in imports(path.read_text("utf-8")) if not is_public(module, names)] == []


PAGES = [ROOT / "README.md", EXAMPLES / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_code_of_a_page_imports_only_what_is_public(path: Path) -> None:
    found = [
        f"{module}: {', '.join(names)}"
        for statement in blocks(path.read_text("utf-8"))
        for module, names in imports(statement)
        if not is_public(module, names)
    ]
    assert found == []


def test_the_public_names_are_found_in_the_how_to() -> None:
    taken = {m for s in blocks((ROOT / "docs" / "how-to.md").read_text("utf-8")) for m, _ in imports(s)}
    assert {"segway_ecc", "segway_ecc.testing"} <= taken
