# SPDX-License-Identifier: MIT
"""`log compare`: what it prints and writes, and what it refuses in one line."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from segway_ecc.hil.campaign.run import run_scenario
from segway_ecc.hil.campaign.scenario import Expectation, Scenario, ScenarioRun
from segway_ecc.node.cli.main import main
from segway_ecc.node.sequence.manoeuvre import Segment

Record = Callable[..., Path]


@pytest.fixture
def recorded(tmp_path: Path) -> Record:
    """Called with a robot's name; returns the log of a short drive."""

    def record(robot: str) -> Path:
        scenario = Scenario(
            name="test",
            robot=robot,
            segments=(Segment(linear=1.0, angular=0.5, duration=0.4),),
            faults=(),
            expect=Expectation(outcome="drives_on"),
        )
        run_scenario(ScenarioRun("test", scenario, robot, 0, {}), tmp_path / "run.mcap")
        return tmp_path / "run.mcap"

    return record


@pytest.mark.variants(1)
@pytest.mark.parametrize(
    "robot", ["cart-can", "cart-odrive", "cart-cia402", "cart-vesc", "cart-hoverboard", "cart-moteus"]
)
def test_a_cart_is_simulated_in_one(recorded: Record, robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "compare", str(recorded(robot)), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["windows"], found["window_s"], found["pitch_offset_rad"]) == (1, None, 0.0)
    velocity = next(each for each in found["signals"] if each["name"] == "left.velocity")
    assert velocity["rms"] < 0.1 * 20.0  # of 1 m/s


def test_plots_and_report_are_written(recorded: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, plot, out = recorded("cart-can"), tmp_path / "plot.png", tmp_path / "out"
    assert main(["log", "compare", str(log), "--window", "0.2", "--plot", str(plot), "--out", str(out)]) == 0
    assert "windows of 0.2 s" in capsys.readouterr().out
    assert plot.stat().st_size > 10_000
    assert (out / "report.html").read_text(encoding="utf-8").count("<img") == 4
    assert json.loads((out / "compare.json").read_text(encoding="utf-8"))["robot"] == "cart-can"


def test_a_log_that_is_cut_off_is_compared_and_reported(
    recorded: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = recorded("cart-can").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[:-2000])
    assert main(["log", "compare", str(cut)]) == 9
    assert "the log ends before its time" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--window", "0"], "--window must be more than 0 s"),
        (["--delay", "-1"], "--delay must be 0 to 100 ms"),
        (["--begin", "2", "--end", "1"], "--begin must be 0 s or more, and less than --end"),
    ],
)
def test_options_out_of_range_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert main(["log", "compare", str(tmp_path / "run.mcap"), *options]) == 2
    assert message in capsys.readouterr().err


def test_what_is_no_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "run.mcap").write_bytes(b"nothing of the kind")
    assert main(["log", "compare", str(tmp_path / "run.mcap")]) == 9
    assert capsys.readouterr().err.count("\n") == 1


def test_a_part_in_which_nothing_was_commanded_is_refused(recorded: Record, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "compare", str(recorded("cart-can")), "--begin", "1000"]) == 9
    assert "in no cycle of it do the drives follow commands" in capsys.readouterr().err
