# SPDX-License-Identifier: MIT
"""`segway-ecc run`, without ROS."""

import importlib.resources
import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from segway_ecc.node.config import packaged_robots
from segway_ecc.node.ring import RingWriter
from tests.patience import PATIENCE_S

Run = Callable[..., Any]
QUIET = ("--no-ros", "--no-log")
SHORT = ("--duration", "0.02")
NS_PER_S = 1_000_000_000


@pytest.fixture
def cart(tmp_path: Path) -> Callable[[str, str], str]:
    """Called with a text of cart.yaml and what to put in its place; returns the path of the changed file."""
    text = importlib.resources.files("segway_ecc.node").joinpath("robots/cart.yaml").read_text("utf-8")

    def change(old: str, new: str) -> str:
        assert old in text
        path = tmp_path / "changed.yaml"
        path.write_text(text.replace(old, new), "utf-8")
        return str(path)

    return change


def only_line(outcome: Any, code: int) -> str:
    """The one line that a refused command says."""
    assert outcome.code == code, outcome
    assert outcome.out == ""
    (line,) = outcome.errors
    assert line.startswith("segway-ecc: ")
    return str(line)


def test_json_has_the_documented_keys(segway_ecc: Run) -> None:
    outcome = segway_ecc("run", "cart", *QUIET, "--duration", "0.1", "--json")
    result = json.loads(outcome.out)

    assert outcome.code == 0
    assert set(result) == {
        "cycles",
        "late",
        "overrun",
        "skipped",
        "mean_rate_hz",
        "stop_reason",
        "timing",
        "sequence",
        "diagnostics",
    }
    assert result["cycles"] == 10
    assert result["stop_reason"] == "10 cycles were asked for"
    assert result["sequence"] is None
    assert list(result["diagnostics"]) == ["cart: mode", "cart: timing", "cart: set-points", "cart: hardware"]
    assert result["diagnostics"]["cart: mode"] == {"mode": "ARMED", "reason": "asked to arm"}
    assert result["diagnostics"]["cart: timing"]["cycles"] == "10"


def test_the_table_and_the_messages_keep_to_their_own_stream(segway_ecc: Run) -> None:
    outcome = segway_ecc("run", "cart", *QUIET, *SHORT)

    assert outcome.code == 0
    assert [line.split()[0] for line in outcome.out.splitlines()] == ["cycles", "late", "lateness"]
    assert outcome.out.startswith("cycles    2 at ")
    # Before these comes what this machine does not let the loop have.
    assert outcome.errors[-3:] == [
        "segway-ecc: robot 'cart' runs at 100 Hz",
        "segway-ecc: ARMED: asked to arm",
        "segway-ecc: stopped: 2 cycles were asked for",
    ]


def test_a_sequence_plays_and_ends_the_run(segway_ecc: Run, tmp_path: Path) -> None:
    file = tmp_path / "short.yaml"
    file.write_text("segments: [{linear: 1.0, duration: 0.2}]", "utf-8")
    result = json.loads(segway_ecc("run", "cart", *QUIET, "--sequence", str(file), "--json").out)

    assert result["stop_reason"] == "the sequence is over"
    assert result["sequence"]["end_ns"] - result["sequence"]["start_ns"] == NS_PER_S // 5
    # A set-point at 0 s and 0.1 s, and rest at 0.2 s, which comes into force in the last cycle or is still waiting.
    assert int(result["diagnostics"]["cart: set-points"]["applied"]) >= 2


def test_a_robot_that_faults_while_it_plays_a_sequence_is_lost_and_the_run_ends(
    segway_ecc: Run, tmp_path: Path, cart: Callable[[str, str], str]
) -> None:
    (tmp_path / "breaking_model.py").write_text(
        "import math\n"
        "from segway_ecc.node.models.cart import Cart\n"
        "class Breaking(Cart):\n"
        "    count = 0\n"
        "    def step(self, u):\n"
        "        self.count += 1\n"
        "        return [math.nan if self.count > 70 else y for y in super().step(u)]\n",
        "utf-8",
    )
    file = tmp_path / "short.yaml"
    file.write_text("segments: [{linear: 1.0, duration: 0.5}]", "utf-8")
    robot = cart("segway_ecc.node.models.cart:Cart", "breaking_model:Breaking")
    # Without the duration it would go on for ever.
    outcome = segway_ecc("run", robot, *QUIET, "--sequence", str(file), "--duration", "2")

    assert outcome.code == 7
    assert outcome.errors[-1].startswith("segway-ecc: the robot went to FAULT: output 'X' of the model is not finite")


def test_a_sequence_that_is_not_over_when_the_duration_is_has_failed(segway_ecc: Run, tmp_path: Path) -> None:
    file = tmp_path / "long.yaml"
    file.write_text("segments: [{linear: 1.0, duration: 60}]", "utf-8")

    outcome = segway_ecc("run", "cart", *QUIET, "--sequence", str(file), "--duration", "1")
    assert outcome.code == 13
    assert outcome.errors[-1] == "segway-ecc: the sequence was not over when --duration was: allow more time"


def test_a_sequence_to_a_robot_that_is_never_armed_has_failed(
    segway_ecc: Run, tmp_path: Path, cart: Callable[[str, str], str]
) -> None:
    file, robot = tmp_path / "short.yaml", cart("arming: at_start", "arming: on_request")
    file.write_text("segments: [{linear: 1.0, duration: 0.1}]", "utf-8")

    outcome = segway_ecc("run", robot, *QUIET, "--sequence", str(file), "--duration", "0.1")
    assert outcome.code == 7
    assert outcome.errors[-1] == "segway-ecc: the sequence never began: DISARMED: just started"


def test_log_option_sets_the_path_of_a_log_with_the_robot_file(segway_ecc: Run, tmp_path: Path) -> None:
    log = tmp_path / "deep" / "run.mcap"
    outcome = segway_ecc("run", "cart", "--no-ros", *SHORT, "--log", str(log))

    assert outcome.code == 0
    assert outcome.errors[0] == f"segway-ecc: log: {log}"
    with log.open("rb") as stream:
        found = {one.name: one.data for one in make_reader(stream, validate_crcs=True).iter_attachments()}
    assert set(found) == {"part.json", "layout.json", "robot.json", "robot.yaml", "end.json"}
    assert found["robot.yaml"] == importlib.resources.files("segway_ecc.node").joinpath("robots/cart.yaml").read_bytes()


def test_a_run_whose_log_lacks_records_drives_on_and_ends_with_an_error(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RingWriter, "put", lambda *_: False)
    outcome = segway_ecc("run", "cart", "--no-ros", *SHORT, "--json", "--log", str(tmp_path / "run.mcap"))

    assert (outcome.code, json.loads(outcome.out)["cycles"]) == (9, 2)
    assert outcome.errors[-1].startswith("segway-ecc: the robot ran to its end, and its log lacks at least ")


def test_log_goes_to_the_state_folder_by_default(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    assert segway_ecc("run", "cart", "--no-ros", *SHORT).code == 0
    (log,) = (tmp_path / "segway-ecc" / "logs").iterdir()
    assert log.name.startswith("cart-")
    assert log.suffix == ".mcap"


def test_old_logs_in_the_state_folder_make_room_for_new_ones(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    folder = tmp_path / "segway-ecc" / "logs"
    folder.mkdir(parents=True)
    (folder / "old.mcap").write_bytes(bytes(5_000_000))

    assert segway_ecc("run", "cart", "--no-ros", *SHORT, "--log-limit", "4").code == 0
    (log,) = folder.iterdir()
    assert log.name.startswith("cart-")


def test_logs_beside_a_file_that_was_named_stay(segway_ecc: Run, tmp_path: Path) -> None:
    (tmp_path / "old.mcap").write_bytes(bytes(5_000_000))

    words = ("--log", str(tmp_path / "run.mcap"), "--log-limit", "4", "--log-file-size", "2")
    assert segway_ecc("run", "cart", "--no-ros", *SHORT, *words).code == 0
    assert sorted(found.name for found in tmp_path.iterdir()) == ["old.mcap", "run.mcap"]


@pytest.mark.parametrize(
    "words",
    [
        ("--log-limit", "0.5"),
        ("--log-limit", "1e300"),
        ("--log-file-size", "0"),
        ("--log-limit", "100", "--log-file-size", "200"),
    ],
)
def test_bounds_of_logs_that_make_no_sense_are_refused(segway_ecc: Run, words: tuple[str, ...]) -> None:
    assert only_line(segway_ecc("run", "cart", "--no-ros", *SHORT, *words), 2).startswith(
        "segway-ecc: --log-file-size must"
    )


def test_no_log_keeps_none(segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    assert segway_ecc("run", "cart", *QUIET, *SHORT).code == 0
    assert list(tmp_path.iterdir()) == []


def test_missing_robot_file_error_lists_the_packaged_ones(segway_ecc: Run) -> None:
    line = only_line(segway_ecc("run", "nosuch.yaml"), 2)

    assert "'nosuch.yaml'" in line
    assert "No such file or directory" in line
    assert line.endswith(f"the packaged robots are {', '.join(packaged_robots())}")


@pytest.mark.parametrize(
    ("old", "new", "code", "expected"),
    [
        (
            "  X: odo",
            "  Xx: odo",
            3,
            "parameter of model 'cart' is called 'Xx'; there is X, Y, Heading, ",
        ),
        ("setpoint.linear_velocity", "setpoint.speed", 3, "there is setpoint.linear_velocity, setpoint.angular_ve"),
        ("odometry.x", "odometry.z", 3, "'odometry.z'; there is odometry.x, odometry.y, odometry.heading, "),
        ("arming: at_start", "arming: never", 2, "allowed is at_start, on_request"),
        ("arming: at_start", "armed: at_start", 2, "unknown field `armed`; the keys there are actuate, arming, "),
        ("name: cart", "name: [cart]", 2, "Expected `str`, got `array` at name"),
        ("name: cart", "name: cart: cart", 2, "is not YAML"),
        ("models.cart:Cart", "models.cart:Kart", 3, "module segway_ecc.node.models.cart has no class Kart"),
        ("segway_ecc.node.models.cart:Cart", "no_such_package:Cart", 3, "No module named 'no_such_package'"),
    ],
)
def test_robot_file_error_names_what_is_allowed(  # noqa: PLR0913, PLR0917 - one row of the table
    segway_ecc: Run, cart: Callable[[str, str], str], old: str, new: str, code: int, expected: str
) -> None:
    assert expected in only_line(segway_ecc("run", cart(old, new), *QUIET), code)


@pytest.mark.parametrize("duration", ["0", "-1", "nan", "inf", "-inf", "1e308", "0.0004", "1_0"])
def test_a_duration_that_makes_no_sense_is_refused(segway_ecc: Run, duration: str) -> None:
    line = only_line(segway_ecc("run", "cart", *QUIET, f"--duration={duration}"), 2)

    assert "--duration" in line


def test_a_bus_option_for_a_robot_without_a_bus_is_refused(segway_ecc: Run) -> None:
    line = only_line(segway_ecc("run", "cart", "--channel", "can0"), 2)

    assert line == "segway-ecc: --channel: robot 'cart' is on no CAN bus"


def test_missing_bus_is_reported_with_the_remedy(segway_ecc: Run) -> None:
    outcome = segway_ecc("run", "cart-can", *QUIET, "--interface", "socketcan", "--channel", "nosuch0")

    assert outcome.code == 4
    assert [line for line in outcome.errors if not line.startswith("segway-ecc: ")] == []
    assert outcome.errors[-1].startswith("segway-ecc: no CAN interface is called 'nosuch0'; ")
    assert "interface: auto" in outcome.errors[-1]


def test_robot_without_its_bus_is_never_reported_to_run(segway_ecc: Run) -> None:
    outcome = segway_ecc("run", "cart-can", *QUIET, "--interface", "socketcan", "--channel", "nosuch0")

    assert [line for line in outcome.errors if " runs at " in line] == []


def test_unknown_python_can_interface_is_reported(segway_ecc: Run) -> None:
    outcome = segway_ecc("run", "cart-can", *QUIET, "--interface", "telepathy")

    assert outcome.code == 4
    assert outcome.errors[-1].startswith("segway-ecc: cannot open CAN bus telepathy robot")


def test_unwritable_log_is_reported_before_the_robot_runs(segway_ecc: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    outcome = segway_ecc("run", "cart", "--no-ros", *SHORT, "--log", str(tmp_path / "file" / "run.mcap"))

    assert outcome.code == 9
    assert outcome.errors[-1].startswith(f"segway-ecc: cannot write the log {tmp_path}/file/run.mcap: ")
    assert outcome.errors[-1].endswith("; choose another with --log")
    assert [line for line in outcome.errors if " runs at " in line] == []


def test_missing_or_wrong_sequence_file_is_reported(segway_ecc: Run, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("segments: [{linear: 1.0, duration: 0}]", "utf-8")

    assert "nosuch.yaml" in only_line(segway_ecc("run", "cart", *QUIET, "--sequence", "nosuch.yaml"), 2)
    assert "at segments.0.duration" in only_line(segway_ecc("run", "cart", *QUIET, "--sequence", str(wrong)), 2)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_run_with_exit_code_0_and_its_result(number: signal.Signals) -> None:
    command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", "run", "cart", *QUIET, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        while process.stderr.readline() != "segway-ecc: ARMED: asked to arm\n":
            assert process.poll() is None
        process.send_signal(number)
        out, errors = process.communicate(timeout=PATIENCE_S)

    assert process.returncode == 0
    assert json.loads(out)["stop_reason"] == number.name
    assert errors.splitlines()[-1] == f"segway-ecc: stopped: {number.name}"


def test_signal_handlers_are_put_back(segway_ecc: Run) -> None:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    segway_ecc("run", "cart", *QUIET, *SHORT)

    assert [signal.getsignal(number) for number in numbers] == before
