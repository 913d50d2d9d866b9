# SPDX-License-Identifier: MIT
"""What every verb shares: one line per error, the documented exit codes, and standard streams that may be pipes."""

import importlib.metadata
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.errors import HardwareError
from segway_ecc.hil.errors import RigError
from segway_ecc.node.cli import main as cli
from segway_ecc.node.errors import (
    ConfigurationError,
    ModelError,
    NobodyListensError,
    NodeError,
    RecordingError,
    RobotLostError,
    RosUnavailableError,
)

Run = Callable[..., Any]
COMMAND = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main"]


def without_ros(*words: str, env: Mapping[str, str] | None = None) -> "subprocess.CompletedProcess[str]":
    """Run a command where ROS 2 is not installed: what looks for it, or imports it, does not find it."""
    program = (
        "import importlib.util, sys\n"
        "find = importlib.util.find_spec\n"
        "hidden = ('rclpy', 'geometry_msgs', 'nav_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs', 'diagnostic_msgs')\n"
        "importlib.util.find_spec = lambda name, *rest: None if name in hidden else find(name, *rest)\n"
        "sys.modules.update(dict.fromkeys(hidden))\n"
        "from segway_ecc.node.cli.main import main\n"
        "sys.exit(main())\n"
    )
    return subprocess.run(
        [sys.executable, "-c", program, *words],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, **(env or {})},
    )


def test_version_is_that_of_the_distribution(segway_ecc: Run) -> None:
    outcome = segway_ecc("--version")

    assert outcome.code == 0
    assert outcome.out == importlib.metadata.version("segway-ecc") + "\n"


def test_help_lists_a_dozen_verbs_by_section_each_with_an_example(segway_ecc: Run) -> None:
    outcome = segway_ecc("--help")

    assert outcome.code == 0
    verbs = [line.split()[0] for line in outcome.out.splitlines() if line.startswith("  ") and " segway-ecc " in line]
    assert verbs == [
        *("run", "guard", "sequence", "demo", "play", "plant", "lock-step"),
        *("model", "design"),
        *("log", "station", "deploy"),
        *("case-study", "prove", "bench"),
    ]


def test_no_words_show_what_to_try_first(segway_ecc: Run) -> None:
    outcome = segway_ecc()

    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.errors[0] == "Try first:"
    shown = [line.split("  ")[1].split() for line in outcome.errors[1:4]]
    assert [words[:2] for words in shown] == [
        ["segway-ecc", "case-study"],
        ["segway-ecc", "demo"],
        ["segway-ecc", "model"],
    ]


@pytest.mark.parametrize(
    ("words", "suggestion"),
    [
        (("campain",), "prove campaign"),
        (("doctor",), "deploy doctor"),
        (("hil", "can-cut"), "prove fault"),
        (("replay", "run.mcap"), "log replay"),
        (("status",), "station status"),
        (("base-station", "--dry-run"), "station install"),
        (("study", "growth"), "prove growth"),
        (("prove", "replay"), "log replay"),
        (("rnu", "cart"), "run"),
        (("model", "inspct", "x"), "model inspect"),
    ],
)
def test_a_verb_that_does_not_exist_is_answered_with_the_closest(
    segway_ecc: Run, words: tuple[str, ...], suggestion: str
) -> None:
    outcome = segway_ecc(*words)

    assert outcome.code == 2
    (line,) = outcome.errors
    assert f"did you mean 'segway-ecc {suggestion}'?" in line


@pytest.mark.parametrize("name", [verb.name for verb in cli.find_verbs().values()])
def test_every_verb_shows_its_help_with_an_example(segway_ecc: Run, name: str) -> None:
    outcome = segway_ecc(*name.split(), "--help")

    assert outcome.code == 0
    example = " ".join(outcome.out.split()).partition("Example: ")[2].removeprefix("sudo ")
    assert example.startswith(f"segway-ecc {name}")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_knows_verbs_and_options(segway_ecc: Run, shell: str) -> None:
    outcome = segway_ecc("--completion", shell)

    assert outcome.code == 0
    assert "kill-drill" in outcome.out
    assert "log-limit" in outcome.out


def test_completion_without_shtab_names_the_remedy(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    outcome = segway_ecc("--completion", "bash")

    assert outcome.code == 2
    assert outcome.errors == ["segway-ecc: completion needs shtab: pip install 'segway-ecc[completion]'"]


@pytest.mark.parametrize(
    "words",
    [
        ("frobnicate",),
        ("run",),
        ("prove",),
        ("run", "cart", "--frobnicate"),
        ("run", "cart", "--duration", "soon"),
        ("run", "cart", "--no-log", "--log", "x.mcap"),
        ("case-study", "--seat", "moon"),
        ("sequence",),
        ("sequence", "1", "0", "1", "--wait", "long"),
        ("sequence", "1", "0", "1", "--wait", "nan"),
        ("sequence", "1", "0", "1", "--wait=-inf"),
        ("sequence", "1", "0", "1", "--node", "bad node"),
        ("sequence", "1", "0", "1", "--node", "/"),
        ("sequence", "1", "0", "1", "--namespace", "/robot 1"),
        ("run", "cart", "--namespace", "1st"),
        ("run", "cart", "--namespace", "/robot1/"),
        ("run", "cart", "--namespace", "n" * 121),
    ],
    ids=" ".join,
)
def test_arguments_that_do_not_parse_end_with_exit_code_2_and_one_line(segway_ecc: Run, words: list[str]) -> None:
    outcome = segway_ecc(*words)

    assert outcome.code == 2
    assert outcome.out == ""
    (line,) = outcome.errors
    assert line.startswith("segway-ecc: ")
    assert line.endswith(" --help")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (NodeError, 1),
        (ConfigurationError, 2),
        (ModelError, 3),
        (HardwareError, 4),
        (RosUnavailableError, 5),
        (NobodyListensError, 6),
        (RobotLostError, 7),
        (RigError, 8),
        (RecordingError, 9),
        (KeyboardInterrupt, 130),
    ],
)
def test_each_error_has_the_exit_code_of_the_docstring(
    segway_ecc: Run, monkeypatch: pytest.MonkeyPatch, error: type[BaseException], code: int
) -> None:
    def fail(_options: object) -> int:
        raise error("it broke")

    monkeypatch.setattr("segway_ecc.hil.verbs.plant.run", fail)
    outcome = segway_ecc("plant", "cart-can")

    assert outcome.code == code
    assert outcome.errors == ([] if error is KeyboardInterrupt else ["segway-ecc: it broke"])


def test_the_exit_code_of_a_verb_is_handed_on(segway_ecc: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.verbs.plant.run", lambda _options: 42)

    assert segway_ecc("plant", "cart-can").code == 42


def test_what_follows_ros_args_is_for_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    def keep(options: Any) -> int:
        seen.extend([options.robot, options.ros_arguments])
        return 0

    monkeypatch.setattr("segway_ecc.node.verbs.run.run", keep)

    assert cli.main(["run", "cart", "--ros-args", "-r", "odom:=odometry"]) == 0
    assert seen == ["cart", ["--ros-args", "-r", "odom:=odometry"]]


@pytest.mark.parametrize(
    "words",
    [
        ("run", "cart", "--no-ros", "--no-log", "--duration", "0.02", "--json"),
        ("run", "cart", "--no-ros", "--no-log", "--duration", "0.02"),
        ("--version",),
        ("run", "--help"),
    ],
    ids=["json", "table", "version", "help"],
)
@pytest.mark.parametrize("unbuffered", ["", "1"], ids=["buffered", "unbuffered"])
def test_output_into_a_closed_pipe_gives_no_traceback(words: list[str], unbuffered: str) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ended = subprocess.run(
            [*COMMAND, *words],
            check=False,
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )
    finally:
        os.close(writer)

    assert [line for line in ended.stderr.splitlines() if not line.startswith("segway-ecc: ")] == []
    assert ended.returncode == 0


INHERITED = """
import os, signal, sys
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
os.execv(sys.executable, [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *sys.argv[1:]])
"""


def test_the_signals_of_whoever_starts_it_change_nothing() -> None:
    words = [sys.executable, "-c", INHERITED]
    model = "segway_ecc.node.models.cart:Cart"
    inspected = subprocess.run([*words, "model", "inspect", model], check=False, capture_output=True, text=True)
    assert (inspected.returncode, inspected.stderr) == (0, "")

    robot = [*words, "run", "cart", "--no-ros", "--no-log"]
    with subprocess.Popen(robot, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        for line in running.stderr:
            if " runs at " in line:
                running.terminate()
        assert running.wait() == 0


def test_only_the_verb_in_use_is_imported() -> None:
    program = (
        "import sys; import segway_ecc.node.cli.main as m; m.main(['plant', 'cart']); print('rclpy' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)

    assert ended.stdout == "False\n"


def test_robot_runs_without_ros_and_logs_it() -> None:
    ended = without_ros("run", "cart", "--duration", "0.1", "--no-log", "--json")
    first = ended.stderr.splitlines()[0]

    assert ended.returncode == 0
    assert first.startswith("segway-ecc: ROS 2 is not available here (no rclpy, geometry_msgs, ")
    assert first.endswith(": running without it")
    assert '"cycles": 10' in ended.stdout


def test_without_ros_a_robot_that_does_not_want_it_does_not_miss_it() -> None:
    ended = without_ros("run", "cart", "--duration", "0.02", "--no-log", "--no-ros")

    assert ended.returncode == 0
    assert "ROS" not in ended.stderr


@pytest.mark.parametrize(
    "words",
    [("sequence", "1", "0", "1"), ("run", "cart", "--ros", "--no-log"), ("case-study", "--seat", "ros")],
    ids=" ".join,
)
def test_what_needs_ros_ends_with_exit_code_5_where_there_is_none(words: list[str], tmp_path: Path) -> None:
    out = ["--out", str(tmp_path)] if words[0] == "case-study" else []
    ended = without_ros(*words, *out)
    (line,) = ended.stderr.splitlines()

    assert ended.returncode == 5
    assert line.startswith("segway-ecc: ROS 2 is not available here (no rclpy, ")
    assert "segway-ecc[ros]" in line


def test_an_argument_that_is_no_text_is_refused(segway_ecc: Run) -> None:
    outcome = segway_ecc("run", "cart", "--no-ros", "--log", "\udcff.mcap")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.errors == ["segway-ecc: an argument is not UTF-8 text: '\\udcff.mcap'; rename the file"]
