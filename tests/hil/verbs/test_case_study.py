# SPDX-License-Identifier: MIT
"""`segway-ecc case-study`: its output, that lock step repeats itself, and what it makes of runs in real time."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.case_study.can import LockstepCanSeat, RealTimeCanSeat
from segway_ecc.hil.case_study.study import Cell, LoopTiming, RealTimeRun, Seat, Study, thesis_cells
from segway_ecc.hil.verbs.case_study import NEXT
from segway_ecc.node.cli.main import command_line, find_verbs
from tests.patience import PATIENCE_S

Run = Callable[..., Any]
THESIS_KEYS = ("linear", "angular", "offline_20sim", "standalone_ros_2019")
RUNS = 13


@pytest.fixture(scope="module")
def offline(tmp_path_factory: pytest.TempPathFactory) -> "tuple[Path, subprocess.CompletedProcess[str]]":
    out = tmp_path_factory.mktemp("offline")
    words = ["case-study", "--seat", "offline", "--json", "--out", str(out)]
    return out, subprocess.run(
        [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words], check=False, capture_output=True, text=True
    )


def test_json_holds_the_twelve_cells_of_the_thesis(
    offline: "tuple[Path, subprocess.CompletedProcess[str]]",
) -> None:
    result = json.loads(offline[1].stdout)

    assert offline[1].returncode == 0
    assert list(result) == ["cells", "real_time", "repeated"]
    assert (result["real_time"], result["repeated"]) == (None, [])
    assert len(result["cells"]) == 12
    assert {tuple(cell) for cell in result["cells"]} == {(*THESIS_KEYS, "offline")}
    # Tables 4.1 and 4.2 of the thesis, first row.
    by_setpoint = {(cell["linear"], cell["angular"]): cell for cell in result["cells"]}
    assert by_setpoint[6.0, 4.0]["offline_20sim"] == [1.29, 2.27]
    assert by_setpoint[6.0, 4.0]["standalone_ros_2019"] == [1.45, 1.87]


def test_every_cell_is_that_of_the_thesis_within_its_two_decimals(
    offline: "tuple[Path, subprocess.CompletedProcess[str]]",
) -> None:
    for cell in json.loads(offline[1].stdout)["cells"]:
        # Half of the last digit, and a little for how well the thesis lets its cart's parameters be known.
        assert cell["offline"] == pytest.approx(cell["offline_20sim"], abs=0.01), cell


def test_the_report_and_the_logs_are_where_they_were_asked_for(
    offline: "tuple[Path, subprocess.CompletedProcess[str]]",
) -> None:
    out, ended = offline

    assert (out / "report.html").stat().st_size > 0
    assert len(list((out / "logs").glob("offline_*.mcap"))) == RUNS
    assert ended.stderr.splitlines() == [
        f"segway-ecc: offline: {RUNS} of {RUNS} runs done",
        f"segway-ecc: report: {out / 'report.html'}",
    ]


def test_lock_step_gives_the_same_bytes_every_time(tmp_path: Path) -> None:
    words = ["case-study", "--seat", "can", "--no-real-time", "--json", "--out"]
    commands = [
        [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words, str(tmp_path / name)]
        for name in ("first", "second")
    ]
    processes = [subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) for words in commands]
    try:
        outputs = [process.communicate(timeout=PATIENCE_S)[0] for process in processes]
    finally:
        for process in processes:
            process.kill()
            process.wait()

    assert [process.returncode for process in processes] == [0, 0]
    assert outputs[0] == outputs[1]
    cells = json.loads(outputs[0])["cells"]
    assert {tuple(cell) for cell in cells} == {(*THESIS_KEYS, "can")}
    for cell in cells:
        assert cell["can"] == pytest.approx(cell["offline_20sim"], abs=0.05), cell


def test_an_out_folder_that_cannot_be_written_is_reported(segway_ecc: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    outcome = segway_ecc("case-study", "--seat", "offline", "--out", str(tmp_path / "file"))

    assert outcome.code == 2
    assert outcome.out == ""
    (line,) = outcome.errors
    assert line == (f"segway-ecc: cannot write to {tmp_path}/file: File exists; choose another --out")


def test_a_second_study_in_the_same_folder_is_refused_while_the_first_runs(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second: list[Any] = []
    words = ("case-study", "--seat", "offline", "--json", "--out", str(tmp_path))

    def conduct(*_arguments: object) -> Study:
        if not second:
            second.append(None)
            second[0] = segway_ecc(*words)
        return Study([], [], [], [], [], {})

    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", conduct)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [])

    assert segway_ecc(*words).code == 0
    assert second[0].code == 2
    assert second[0].errors == [
        f"segway-ecc: another study writes to {tmp_path}: wait for its end, or choose another --out"
    ]
    assert segway_ecc(*words).code == 0


SWALLOWS = """
import signal, sys, time
from segway_ecc.hil.verbs import case_study
from segway_ecc.node.cli.main import main

def conduct(*_):
    try:
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.1)
    except KeyboardInterrupt:
        pass
    print("swallowed")

case_study.conduct = conduct
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""


def test_ctrl_c_ends_a_study_also_where_what_runs_would_swallow_it(tmp_path: Path) -> None:
    words = ["case-study", "--seat", "offline", "--out", str(tmp_path)]
    ended = subprocess.run([sys.executable, "-c", SWALLOWS, *words], check=False, capture_output=True, text=True)

    assert (ended.returncode, ended.stdout) == (-signal.SIGINT, "")


@pytest.mark.parametrize("repeat", ["0", "-1"])
def test_a_study_cannot_be_repeated_less_than_once(segway_ecc: Run, tmp_path: Path, repeat: str) -> None:
    outcome = segway_ecc("case-study", "--seat", "offline", "--repeat", repeat, "--out", str(tmp_path))

    assert outcome.code == 2
    (line,) = outcome.errors
    assert "--repeat" in line


def test_repeated_runs_are_compared_bit_for_bit(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = iter([1.0, 1.0, 1.0 + 2**-52])

    def conduct(*_arguments: object) -> Study:
        (cell, *_) = thesis_cells()
        end = next(ends)
        found = Cell(cell.linear, cell.angular, cell.thesis_offline, cell.thesis_ros, {Seat.OFFLINE: (end, 2.0)})
        return Study([found], [Seat.OFFLINE], [], [], [], {})

    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", conduct)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [])
    outcome = segway_ecc("case-study", "--seat", "offline", "--repeat", "3", "--json", "--out", str(tmp_path))

    assert outcome.code == 0
    assert outcome.errors == ["segway-ecc: offline: 2 of 3 runs gave the same bits"]
    assert sorted(path.name for path in tmp_path.glob("*")) == [".lock", "run_1", "run_2", "run_3"]


def test_without_json_a_table_is_printed_with_the_seats_that_did_not_run(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (cell, *_) = thesis_cells()
    found = Cell(cell.linear, cell.angular, cell.thesis_offline, cell.thesis_ros, {Seat.OFFLINE: (1.5, 2.25)})
    study = Study([found], [Seat.OFFLINE], [], [], [], {})
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", lambda *_: study)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [])
    outcome = segway_ecc("case-study", "--seat", "offline", "--out", str(tmp_path))

    assert "1.500 2.250" in outcome.out
    assert "did not run" in outcome.out


def test_seat_given_twice_runs_both(segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seats: list[list[Seat]] = []

    def conduct(runners: Any, *_arguments: object) -> Study:
        seats.append([runner.seat for runner in runners])
        return Study([], [], [], [], [], {})

    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", conduct)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [])
    outcome = segway_ecc("case-study", "--seat", "submodel", "--seat", "offline", "--json", "--out", str(tmp_path))

    assert outcome.code == 0
    assert seats == [[Seat.OFFLINE, Seat.SUBMODEL]]


def test_all_seats_are_those_that_can_run_here(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[Seat]] = []

    def conduct(runners: Any, *_arguments: object) -> Study:
        asked.append([runner.seat for runner in runners])
        return Study([], [], [], [], [], {})

    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", conduct)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [])
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.missing_packages", lambda: ["rclpy"])
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.missing_compiler", lambda: "there is no C compiler here")
    outcome = segway_ecc("case-study", "--no-real-time", "--json", "--out", str(tmp_path))

    assert asked == [[Seat.OFFLINE, Seat.CAN]]
    assert outcome.errors[:2] == [
        "segway-ecc: the ros seat is left out: no ROS 2 here (no rclpy)",
        "segway-ecc: the submodel seat is left out: there is no C compiler here",
    ]


TIMING = LoopTiming(0.0001, 0.002, 3, 0.25)
COMPARED = RealTimeRun("1 m/s", TIMING, 0.0125)
SPOILED = RealTimeRun("1 m/s", failure="can in real time failed", is_spoiled=True)
FAILED = RealTimeRun("1 m/s", failure="can in real time failed")


@pytest.fixture
def can_study(segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Runs a study of one cell in the can seat; its run in real time has come out so."""

    def run(found: RealTimeRun, *words: str) -> Any:
        (cell, *_) = thesis_cells()
        end = Cell(cell.linear, cell.angular, cell.thesis_offline, cell.thesis_ros, {Seat.CAN: (1.5, 2.25)})
        study = Study([end], [Seat.CAN], [], [], [], {}, ["can in real time, try 1 of 3: it tripped"])
        monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", lambda *_: study)
        monkeypatch.setattr("segway_ecc.hil.verbs.case_study.run_in_real_time", lambda *_: found)
        monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [tmp_path / "report.html"])
        return segway_ecc("case-study", "--seat", "can", *words, "--out", str(tmp_path))

    return run


def test_the_run_in_real_time_stands_below_the_table(can_study: Callable[..., Any]) -> None:
    outcome = can_study(COMPARED)

    assert outcome.code == 0
    assert outcome.out.endswith(f"can       2.2500 m\n\n{COMPARED.text}\n\n")
    assert "0.0125 m from lock step; lateness p99 0.10 ms, worst 2.00 ms; 3 deadlines skipped" in COMPARED.text


def test_json_holds_the_run_in_real_time_and_what_was_repeated(can_study: Callable[..., Any]) -> None:
    result = json.loads(can_study(COMPARED, "--json").out)

    assert result["real_time"] == {
        "manoeuvre": "1 m/s",
        "timing": {"lateness_p99_s": 0.0001, "lateness_worst_s": 0.002, "skipped": 3, "stall_s": 0.25},
        "deviation_m": 0.0125,
        "failure": "",
        "is_spoiled": False,
    }
    assert result["repeated"] == ["can in real time, try 1 of 3: it tripped"]


def test_a_run_that_the_machine_spoiled_is_named_and_fails_nothing(can_study: Callable[..., Any]) -> None:
    outcome = can_study(SPOILED)

    assert outcome.code == 0
    assert "1.500 2.250" in outcome.out
    assert "no result. can in real time failed" in outcome.out


def test_a_table_in_real_time_that_the_machine_spoiled_is_named_and_fails_nothing(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = Study(list(thesis_cells()), [], [], [], [], {}, [], SPOILED)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", lambda *_: study)
    outcome = segway_ecc("case-study", "--seat", "can", "--real-time", "--out", str(tmp_path))

    assert outcome.code == 0
    assert "The can seat in real time (1 m/s): no result. can in real time failed" in outcome.out
    assert "The can seat did not run." in (tmp_path / "report.html").read_text("utf-8")


def test_a_run_that_failed_on_a_machine_that_did_not_stall_is_an_error(can_study: Callable[..., Any]) -> None:
    outcome = can_study(FAILED)

    assert outcome.code == 14
    assert "1.500 2.250" in outcome.out
    assert outcome.errors[-1] == "segway-ecc: can in real time failed"


def test_the_end_is_the_report_and_what_to_try_next(can_study: Callable[..., Any], tmp_path: Path) -> None:
    outcome = can_study(COMPARED)

    assert outcome.errors[-5:-3] == [f"segway-ecc: report: {tmp_path}/report.html", "Try next:"]
    assert [line.split("  ")[1].strip() for line in outcome.errors[-3:]] == [f"segway-ecc {words}" for words, _ in NEXT]


@pytest.mark.parametrize(("found", "typed"), [(None, ".venv/bin/segway-ecc"), ("/usr/bin/segway-ecc", "segway-ecc")])
def test_what_to_try_next_is_typed_as_this_command_was_where_no_shell_finds_it(
    can_study: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, found: str | None, typed: str
) -> None:
    monkeypatch.setattr("sys.argv", [".venv/bin/segway-ecc"])
    monkeypatch.setattr("shutil.which", lambda _name: found)

    assert can_study(COMPARED).errors[-1].startswith(f"  {typed} model inspect FOLDER ")


@pytest.mark.parametrize("words", [words for words, _ in NEXT])
def test_what_to_try_next_is_a_command_of_this_tool(words: str) -> None:
    assert command_line(find_verbs(), words.split()).parse_args(words.split()).function


@pytest.mark.parametrize(("words", "seat"), [([], LockstepCanSeat), (["--real-time"], RealTimeCanSeat)])
def test_the_table_over_can_is_in_lock_step_unless_real_time_is_asked_for(
    segway_ecc: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], seat: type
) -> None:
    asked: list[object] = []

    def conduct(runners: Any, *_arguments: object) -> Study:
        asked.extend(runners)
        return Study([], [], [], [], [], {})

    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.conduct", conduct)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study.run_in_real_time", lambda *_: COMPARED)
    monkeypatch.setattr(RealTimeCanSeat, "worst", lambda _: COMPARED)
    monkeypatch.setattr("segway_ecc.hil.verbs.case_study._write_report", lambda *_: [])
    outcome = segway_ecc("case-study", "--seat", "can", *words, "--json", "--out", str(tmp_path))

    assert [type(runner) for runner in asked] == [seat]
    assert json.loads(outcome.out)["real_time"]["deviation_m"] == 0.0125
