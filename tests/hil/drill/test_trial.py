# SPDX-License-Identifier: MIT
"""Verdicts, and one fault with real processes."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import pytest

from segway_ecc.hil.drill import trial
from segway_ecc.hil.drill.parts import DrillSetup
from segway_ecc.hil.drill.plant_control import Torque
from segway_ecc.hil.drill.trial import FAULTS, DrillOutcome, DrillResult, worst
from segway_ecc.node.config import load_robot

pytestmark = pytest.mark.real_time


def made(expected: DrillOutcome, torque: Torque | None) -> DrillResult:
    return DrillResult("a fault", expected, guard=True, torque=torque, messages=[])


@pytest.mark.parametrize(
    ("expected", "torque", "is_as_expected", "outcome"),
    [
        (DrillOutcome.ENDS, Torque(0.05, 0.055, 0.0), True, "torque ends"),
        (DrillOutcome.ENDS, Torque(0.0501, 0.055, 0.0), False, "torque ends"),
        (DrillOutcome.ENDS, Torque(0.01, None, 0.0), False, "drives on"),
        (DrillOutcome.ENDS, None, False, "failed"),
        (DrillOutcome.DRIVES_ON, Torque(1.0, None, 0.0), True, "drives on"),
        (DrillOutcome.DRIVES_ON, Torque(1.0, None, 0.1), True, "drives on"),
        (DrillOutcome.DRIVES_ON, Torque(1.0, None, 0.101), False, "drives on"),
        (DrillOutcome.DRIVES_ON, Torque(0.9, 0.905, 0.0), False, "torque ends"),
        (DrillOutcome.DRIVES_ON, None, False, "failed"),
    ],
)
def test_verdicts(expected: DrillOutcome, torque: Torque | None, *, is_as_expected: bool, outcome: str) -> None:
    found = made(expected, torque)
    assert (found.is_as_expected, found.outcome) == (is_as_expected, outcome)


def test_a_fault_can_have_a_limit_of_its_own() -> None:
    found = made(DrillOutcome.ENDS, Torque(0.12, 0.125, 0.0))
    verdicts = [dataclasses.replace(found, within_s=limit_s).is_as_expected for limit_s in (0.1, 0.15)]
    assert verdicts == [False, True]
    assert {fault.within_s for fault in FAULTS.values() if "frozen" not in fault.name} == {0.05}


def ends(*last_s: float) -> list[DrillResult]:
    return [made(DrillOutcome.ENDS, Torque(s, s + 0.005, 0.0)) for s in last_s]


def test_the_worst_is_what_was_not_expected_then_the_longest() -> None:
    assert worst(ends(0.01, 0.04, 0.02)) == ends(0.04)[0]
    goes_on = made(DrillOutcome.ENDS, Torque(0.001, None, 0.0))
    assert worst([*ends(0.04), goes_on]) == goes_on
    failed = made(DrillOutcome.ENDS, None)
    assert worst([*ends(0.2), failed, goes_on]) == failed
    gaps = [made(DrillOutcome.DRIVES_ON, Torque(1.0, None, gap)) for gap in (0.01, 0.03, 0.02)]
    assert worst(gaps) == gaps[1]


def test_faults_have_names_of_their_own_and_each_part_is_harmed() -> None:
    assert all(name == fault.name for name, fault in FAULTS.items())
    assert {name.split()[0] for name in FAULTS} == {
        "node", "guard", "recorder", "drives", "bus", "cable", "left", "clock", "disk"
    }  # fmt: skip


@pytest.fixture(autouse=True)
def _in_a_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Long enough to see what happens: what counts here is that it happens, and not when."""
    monkeypatch.setattr(trial, "_DRIVEN_S", 0.3)
    monkeypatch.setattr(trial, "_LOOK_S", 0.6)
    monkeypatch.setattr(trial, "_AFTER_S", 0.3)


def setup(tmp_path: Path, robot: str = "cart-can", **changes: bool) -> DrillSetup:
    bus = ["--interface", "local", "--channel", f"trial {tmp_path}"]
    options = {"serial": False, "guard": False, "stepped": False, **changes}
    return DrillSetup(robot, bus, options["serial"], options["guard"], options["stepped"], tmp_path / "drill")


def lines(found: Sequence[str], beginning: str) -> list[str]:
    return [line for line in found if line.startswith(beginning)]


def test_a_stopped_node_leaves_the_motors_off_also_when_it_goes_on(tmp_path: Path) -> None:
    found = trial.run(FAULTS["node stopped"], setup(tmp_path))

    assert found.torque is not None, found.note
    assert found.outcome == "torque ends"
    # It went on later, and torque did not come back; generous, since the machine may be busy.
    assert found.torque.last_s < 0.6
    # In the line of the fault or, where the run ends before that is written, in that of the end.
    assert any("FAULT: this node sent no command for" in line for line in found.messages), found.messages


@pytest.mark.parametrize("fault", ["node killed", "node stopped"])
def test_the_guard_ends_torque_on_a_serial_line_that_is_all_there_is(tmp_path: Path, fault: str) -> None:
    """The board itself would drive on for 0.8 s: what ends it sooner is the guard."""
    where = DrillSetup(
        "cart-hoverboard",
        ["--serial", str(tmp_path / "line")],
        serial=False,
        guard=True,
        stepped=False,
        folder=tmp_path / "drill",
    )
    found = trial.run(FAULTS[fault], where)

    assert found.torque is not None, found.note
    assert found.outcome == "torque ends"
    assert found.torque.last_s < 0.6, "generous, since the machine may be busy"
    assert lines(found.messages, "guard: stopping the drives: the node's heartbeats stopped"), found.messages


def test_a_drive_that_waits_for_long_is_given_its_time_where_nobody_else_ends_torque() -> None:
    def limit(fault: str, robot: str, *, guard: bool) -> float:
        return trial.limit_s(FAULTS[fault], load_robot(robot), guard=guard)

    assert limit("cable cut", "cart-hoverboard", guard=True) == pytest.approx(0.825, abs=0.001)
    assert limit("node killed", "cart-hoverboard", guard=False) == pytest.approx(0.825, abs=0.001)
    assert limit("node killed", "cart-hoverboard", guard=True) == 0.05
    assert {limit(fault, "cart-can", guard=False) for fault in ("cable cut", "node killed")} == {0.05}
    assert limit("drives mute", "segway", guard=True) == pytest.approx(0.1)


def test_a_full_disk_is_reported_and_the_robot_drives_on(tmp_path: Path) -> None:
    found = trial.run(FAULTS["disk full"], setup(tmp_path))

    assert found.outcome == "drives on", found
    assert lines(found.messages, "recorder: Writing the log ")
    assert not lines(found.messages, "FAULT")
    assert found.note
    assert not (tmp_path / "drill" / "log").is_mount(), "nothing is left mounted"


def test_a_full_disk_without_a_file_system_of_our_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.drill.parts.os.geteuid", lambda: 1000)
    found = trial.run(FAULTS["disk full"], setup(tmp_path))

    assert found.outcome == "drives on", found
    assert lines(found.messages, "recorder: Writing the log ")
    assert "file size limited" in found.note


def test_a_stepped_clock_is_read_by_every_process_and_the_robot_drives_on(tmp_path: Path) -> None:
    where = setup(tmp_path, stepped=True)
    found = trial.run(FAULTS["clock an hour back"], where)

    assert found.outcome == "drives on", found
    rows = [row.split(",") for row in where.trace.read_text().splitlines()[1:-1]]
    apart_s = [(int(wall) - int(monotonic)) * 1e-9 for monotonic, wall, *_ in rows]
    assert apart_s[0] - apart_s[-1] == pytest.approx(3600.0, abs=1.0)


def test_a_cut_cable_is_survived_over_the_serial_line(tmp_path: Path) -> None:
    found = trial.run(FAULTS["cable cut with serial line"], setup(tmp_path, serial=True))

    assert found.outcome == "drives on", found
    assert lines(found.messages, "link: from can to serial")


def test_a_plant_that_does_not_start_is_reported(tmp_path: Path) -> None:
    found = trial.run(FAULTS["node killed"], setup(tmp_path, robot="cart"))

    assert (found.outcome, found.is_as_expected) == ("failed", False)
    assert "did not answer 'heal'" in found.note
    assert "is on no CAN bus" in found.note


def test_harm_that_cannot_be_done_is_reported(tmp_path: Path) -> None:
    found = trial.run(FAULTS["guard killed"], setup(tmp_path))

    assert (found.outcome, found.is_as_expected, found.note) == ("failed", False, "there is no guard")
