# SPDX-License-Identifier: MIT
"""No process of ours imports what lies in the folder that the user is in."""

import ast
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.node.recording.salvage import Salvage
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[1]
PRODUCT = ("firmware_io", "node", "deploy", "hil")
FILES = (
    "node.py", "node/__init__.py", "msgspec.py", "json.py", "can.py", "yaml.py", "segway_ecc.py",
    "pickle.py", "socket.py", "numpy.py", "rclpy.py", "mcap.py",
)  # fmt: skip
MARKER = "import pathlib\npathlib.Path(__file__).with_suffix('.ran').touch()\nraise SystemExit(77)\n"
SCRIPT = "import sys\nfrom segway_ecc.node.cli.main import main\nif __name__ == '__main__':\n    sys.exit(main())\n"
SAFE = {"-P", "-I"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder whose files have the names of modules, and note that they ran."""
    folder = tmp_path / "robots"
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(MARKER)
    return folder


@pytest.fixture
def program(tmp_path: Path) -> list[str]:
    """Our command as pip installs it: a script outside the current folder, started without -P."""
    script = tmp_path / "bin" / "segway-ecc"
    script.parent.mkdir()
    script.write_text(SCRIPT)
    return [sys.executable, str(script)]


def ran(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*.ran"))


def run_in(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


def test_run_and_its_recorder_leave_the_current_folder_alone(folder: Path, program: list[str], tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    done = run_in(folder, *program, "run", "cart", "--no-ros", "--duration", "0.3", "--log", str(log), "--json")

    assert (done.returncode, ran(folder)) == (0, []), done.stderr
    messages = Salvage(log)
    cycles = sum(topic == "/cycle" for topic, _ in messages.messages())
    assert (messages.is_whole, cycles) == (True, json.loads(done.stdout)["cycles"])


@pytest.mark.ros
def test_the_ros_process_leaves_the_current_folder_alone(folder: Path, program: list[str], tmp_path: Path) -> None:
    done = run_in(folder, *program, "run", "cart", "--ros", "--duration", "0.3", "--log", str(tmp_path / "run.mcap"))

    assert (done.returncode, ran(folder)) == (0, []), done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("prove", "fault", "can-cut"),
        ("prove", "campaign", "can-cut", "encoder-stuck", "--jobs", "2", "--seeds", "1"),
        ("prove", "endurance", "--hours", "0.001", "--seeds", "2", "--jobs", "2"),
        ("deploy", "check", "cart"),
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_what_proves_a_robot_leaves_the_current_folder_alone(
    folder: Path, program: list[str], words: tuple[str, ...]
) -> None:
    done = run_in(folder, *program, *words)

    assert (done.returncode, ran(folder)) == (0, []), done.stderr


def test_a_plant_leaves_the_current_folder_alone(folder: Path, program: list[str]) -> None:
    words = [*program, "plant", "cart-can", "--interface", "local", "--channel", f"here{os.getpid()}"]
    with subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as plant:
        assert plant.stderr is not None
        first = plant.stderr.readline()
        plant.send_signal(signal.SIGTERM)
        errors = plant.communicate(timeout=PATIENCE_S)[1]

    assert (plant.returncode, ran(folder)) == (0, []), first + errors


def started() -> Iterator[tuple[str, list[object]]]:
    """Where product code names this interpreter in a list of words: the place, and the words that follow."""
    for path in (path for room in PRODUCT for path in sorted((ROOT / room).rglob("*.py"))):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if not isinstance(node, ast.List | ast.Tuple):
                continue
            texts = [ast.unparse(word) for word in node.elts]
            if "sys.executable" in texts:
                after = node.elts[texts.index("sys.executable") + 1 :]
                words: list[object] = [word.value if isinstance(word, ast.Constant) else None for word in after]
                if words:
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", words


def test_every_interpreter_is_started_without_the_current_folder() -> None:
    found = list(started())

    assert len(found) > 8
    # `-m` and `-c` put the current folder first, unless an option before them does not let them.
    assert [place for place, words in found if not SAFE & set(words[:1])] == []


def test_pools_of_processes_are_made_in_one_place() -> None:
    makes = [
        str(path.relative_to(ROOT))
        for room in PRODUCT
        for path in sorted((ROOT / room).rglob("*.py"))
        if re.search(r"multiprocessing\.(get_context|Pool|Process)|ProcessPoolExecutor", path.read_text("utf-8"))
    ]
    assert makes == ["hil/processes.py"]


def test_shell_and_documentation_start_our_modules_without_the_current_folder() -> None:
    places = [ROOT / "Makefile", ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "deploy").rglob("*.sh")]
    places += [path for room in (*PRODUCT, "yocto-notes") for path in (ROOT / room).rglob("*.py")]
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in places
        for line in path.read_text("utf-8").splitlines()
        if re.search(r"(python3?\"?|bin/python) -m (segway_ecc|can|pip)\b", line)
    ]
    assert found == []
