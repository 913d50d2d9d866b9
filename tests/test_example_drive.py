# SPDX-License-Identifier: MIT
"""The example of a drive of one's own, installed as a distribution of its own, conforms and drives a robot."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.testing import CONFORMANCE_ASPECTS

EXAMPLE = Path(__file__).parents[1] / "examples" / "drive"
_CONFORMS = """
import sys
from pocket_drive import FAMILY, PocketSettings, PocketWheel
from pocket_drive_simulated import SIMULATED
from segway_ecc.testing import check_conformance

left = PocketWheel(node=1, max_torque=4.0)
right = PocketWheel(node=2, max_torque=4.0, direction=-1, gear_ratio=2.0)
check_conformance(sys.argv[1], FAMILY, SIMULATED, PocketSettings(axes={"left": left, "right": right}))
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """That of a process for which the example is installed beside the rest."""
    folder = tmp_path_factory.mktemp("example")
    source, target = folder / "source", folder / "installed"
    shutil.copytree(EXAMPLE, source)
    pip = [sys.executable, "-P", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index"]
    words = [*pip, "--no-deps", "--no-build-isolation", "--target", str(target), str(source)]
    subprocess.run(words, check=True, capture_output=True)
    return {**os.environ, "PYTHONPATH": str(target)}


def run(environment: dict[str, str], *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("aspect", CONFORMANCE_ASPECTS)
def test_the_drive_conforms(environment: dict[str, str], aspect: str) -> None:
    done = run(environment, "-c", _CONFORMS, aspect)
    assert done.returncode == 0, done.stderr


def test_a_robot_file_names_it_as_any_other(environment: dict[str, str]) -> None:
    done = run(environment, "-m", "segway_ecc.node.cli.main", "deploy", "check", str(EXAMPLE / "robot.yaml"))
    assert (done.returncode, done.stdout) == (0, "cart-on-pocket-drives loads, and runs at 100 Hz\n"), done.stderr


def test_a_cart_on_it_is_simulated_in_lock_step_and_stops_where_the_cable_is_cut(environment: dict[str, str]) -> None:
    words = ("prove", "fault", "can-cut", "--robot", str(EXAMPLE / "robot.yaml"))
    done = run(environment, "-m", "segway_ecc.node.cli.main", *words)
    assert done.returncode == 0, done.stderr
    assert "the left pocket drive is silent; the right pocket drive is silent" in done.stdout


def test_where_it_is_not_installed_the_families_that_are_are_listed() -> None:
    done = run({**os.environ}, "-m", "segway_ecc.node.cli.main", "deploy", "check", str(EXAMPLE / "robot.yaml"))
    assert done.returncode == 2
    families = "cia402, hoverboard, moteus, odrive, vesc, wheel_board"
    assert f"there is no drive family 'pocket'; installed are {families}" in done.stderr


def test_the_whole_example_has_at_most_200_lines_of_code() -> None:
    lines = [line for path in EXAMPLE.glob("*.py") for line in path.read_text("utf-8").splitlines()]
    assert len([line for line in lines if line.strip() and not line.strip().startswith(('"""', "#"))]) <= 200
