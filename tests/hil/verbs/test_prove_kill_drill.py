# SPDX-License-Identifier: MIT
"""`segway-ecc prove kill-drill`: which faults, the table and the exit code, with a stand-in for the trials."""

import importlib.resources
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.drill import trial
from segway_ecc.hil.drill.parts import DrillSetup
from segway_ecc.hil.drill.plant_control import Torque
from segway_ecc.hil.drill.trial import FAULTS, DrillFault, DrillOutcome, DrillResult

Run = Callable[..., Any]
WELL = {DrillOutcome.ENDS: Torque(0.0312, 0.0362, 0.0), DrillOutcome.DRIVES_ON: Torque(1.5, None, 0.02)}
CHOSEN = [name for name in FAULTS if name != "bus down"]
NO_INTERFACE = "it needs a network interface: --interface socketcan --channel vcan0"


class Trials:
    """Stands in for real trials; the n-th of a fault ends as it is told to, and well where nothing is told."""

    def __init__(self) -> None:
        self.setups: list[tuple[str, DrillSetup]] = []
        self.told: dict[str, list[Torque | None]] = {}

    def __call__(self, fault: DrillFault, setup: DrillSetup) -> DrillResult:
        self.setups.append((fault.name, setup))
        torque = self.told[fault.name].pop(0) if self.told.get(fault.name) else WELL[fault.expected]
        return DrillResult(fault.name, fault.expected, setup.guard, torque, [f"{fault.name} noticed"], "a note")


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch) -> Trials:
    found = Trials()
    monkeypatch.setattr(trial, "run", found)
    return found


def test_every_fault_once_is_the_default_and_all_well_is_zero(segway_ecc: Run, trials: Trials) -> None:
    outcome = segway_ecc("prove", "kill-drill")

    assert outcome.code == 0
    assert [name for name, _ in trials.setups] == CHOSEN
    assert {setup.robot for _, setup in trials.setups} == {"cart-can"}
    assert all(setup.guard for _, setup in trials.setups)
    assert [name for name, setup in trials.setups if setup.serial] == ["cable cut with serial line"]
    assert [name for name, setup in trials.setups if setup.stepped] == ["clock an hour ahead", "clock an hour back"]
    channels = [setup.bus[3] for _, setup in trials.setups]
    assert len(set(channels)) == len(channels), "a bus of its own for each"
    assert {tuple(setup.bus[:3]) for _, setup in trials.setups} == {("--interface", "local", "--channel")}
    assert outcome.errors == [f"segway-ecc: {name}" for name in CHOSEN]
    assert outcome.out.splitlines()[-1] == f"bus down: left out, {NO_INTERFACE}"


@pytest.mark.usefixtures("trials")
def test_the_table(segway_ecc: Run) -> None:
    lines = segway_ecc("prove", "kill-drill", "--fault", "node killed", "--fault", "recorder killed").out.splitlines()

    assert lines == [
        "fault            expected            measured     last torque, ms  zero from, ms  gap, ms  guard  verdict",
        "node killed      torque ends, 50 ms  torque ends  31.2             36.2           -        ran    as expected",
        "    (a note)",
        "    robot: node killed noticed",
        "recorder killed  drives on           drives on    -                -              20.0     ran    as expected",
        "    (a note)",
        "    robot: recorder killed noticed",
    ]


def test_the_guard_can_be_left_out(segway_ecc: Run, trials: Trials) -> None:
    words = [word for name in ("node killed", "guard killed", "guard stopped") for word in ("--fault", name)]
    outcome = segway_ecc("prove", "kill-drill", "--no-guard", *words)

    assert [(name, setup.guard) for name, setup in trials.setups] == [("node killed", False)]
    assert " no     as expected" in outcome.out
    assert outcome.out.splitlines()[-2:] == [
        "guard killed: left out, there is no guard",
        "guard stopped: left out, there is no guard",
    ]


def test_of_repeats_the_worst_is_reported(segway_ecc: Run, trials: Trials) -> None:
    trials.told["node killed"] = [Torque(0.01, 0.015, 0.0), Torque(0.045, 0.05, 0.0), Torque(0.02, 0.025, 0.0)]
    outcome = segway_ecc("prove", "kill-drill", "--fault", "node killed", "--repeat", "3")

    assert outcome.code == 0
    assert (
        " ".join(outcome.out.splitlines()[1].split()[:11]) == "node killed x3 torque ends, 50 ms torque ends 45.0 50.0"
    )
    folders = [setup.folder for _, setup in trials.setups]
    assert len(set(folders)) == 3


@pytest.mark.parametrize("torque", [Torque(0.06, 0.065, 0.0), Torque(1.0, None, 0.0), None])
def test_one_that_is_not_as_expected_is_exit_code_1(segway_ecc: Run, trials: Trials, torque: Torque | None) -> None:
    trials.told["node killed"] = [WELL[DrillOutcome.ENDS], torque, WELL[DrillOutcome.ENDS]]
    outcome = segway_ecc("prove", "kill-drill", "--fault", "node killed", "--fault", "recorder killed", "--repeat", "3")

    assert outcome.code == 1
    assert "NOT as expected" in outcome.out.splitlines()[1]


def test_json(segway_ecc: Run, trials: Trials) -> None:
    trials.told["node killed"] = [Torque(0.06, 0.065, 0.0), None]
    outcome = segway_ecc("prove", "kill-drill", "--fault", "node killed", "--repeat", "2", "--json")
    result = json.loads(outcome.out)

    assert outcome.code == 1
    assert result["left_out"] == {}
    (row,) = result["faults"]
    assert (row["fault"], row["expected"], row["outcome"]) == ("node killed", "torque ends", "failed")
    assert row["within_s"] == 0.05
    assert (row["as_expected"], row["repeats"], row["last_torque_s"]) == (False, 2, [0.06, None])
    assert row["guard"] is True


def test_the_bus_can_be_named(segway_ecc: Run, trials: Trials) -> None:
    segway_ecc("prove", "kill-drill", "--fault", "cable cut", "--interface", "socketcan", "--channel", "vcan0")

    assert list(trials.setups[0][1].bus) == ["--interface", "socketcan", "--channel", "vcan0"]


def test_drives_without_a_serial_line_cannot_lose_the_cable_only(segway_ecc: Run, trials: Trials) -> None:
    outcome = segway_ecc(
        "prove", "kill-drill", "cart-cia402", "--fault", "cable cut", "--fault", "cable cut with serial line"
    )

    assert [name for name, _ in trials.setups] == ["cable cut"]
    assert outcome.out.splitlines()[-1] == "cable cut with serial line: left out, its drives have no serial line"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--repeat", "0"), "--repeat must be 1 to 1000"),
        (("cart",), "robot 'cart' is all model: it has no drives to be cut off from"),
        (("no such robot",), "cannot read robot file 'no such robot'"),
    ],
)
@pytest.mark.usefixtures("trials")
def test_what_cannot_be_done_is_reported_in_one_line(segway_ecc: Run, words: tuple[str, ...], told: str) -> None:
    outcome = segway_ecc("prove", "kill-drill", *words)

    assert outcome.code == 2
    (line,) = outcome.errors
    assert told in line


@pytest.mark.usefixtures("trials")
def test_a_serial_line_does_not_carry_on_a_robot_whose_imu_is_on_the_bus_alone(segway_ecc: Run) -> None:
    words = ["prove", "kill-drill", "segway-odrive", "--fault", "cable cut with serial line", "--json"]
    (found,) = json.loads(segway_ecc(*words).out)["faults"]
    assert found["expected"] == "torque ends"


@pytest.mark.usefixtures("trials")
def test_a_robot_without_a_bus_has_lines_of_its_own_each_time(segway_ecc: Run, trials: Trials) -> None:
    for robot, names in (("cart-hoverboard", ["serial"]), ("segway-hoverboard", ["imu", "serial"])):
        segway_ecc("prove", "kill-drill", robot, "--fault", "node killed", "--repeat", "2")
        for _, setup in trials.setups[-2:]:
            assert list(setup.bus[1::2]) == [str(setup.folder / name) for name in names]
            assert setup.bus[::2] == [f"--{'imu-serial' if name == 'imu' else 'serial'}" for name in names]
            assert setup.channel == str(setup.folder / "serial")


def test_a_robot_that_names_a_serial_line_is_refused(segway_ecc: Run, tmp_path: Path) -> None:
    text = importlib.resources.files("segway_ecc.node").joinpath("robots/cart-can.yaml").read_text("utf-8")
    path = tmp_path / "serial.yaml"
    path.write_text(text.replace("  watchdog_s", "  serial:\n    port: /dev/ttyUSB0\n  watchdog_s"), "utf-8")
    outcome = segway_ecc("prove", "kill-drill", str(path))

    assert outcome.code == 2
    assert "names a serial line" in outcome.errors[0]


INTERFACE = ("--fault", "bus down", "--interface", "socketcan", "--channel", "vcan7")


def test_an_interface_that_can_be_set_down_is(segway_ecc: Run, trials: Trials, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.verbs.prove_kill_drill.why_not_down", {"vcan7": None}.__getitem__)
    outcome = segway_ecc("prove", "kill-drill", *INTERFACE)

    assert outcome.code == 0
    assert [(name, setup.channel) for name, setup in trials.setups] == [("bus down", "vcan7")]


@pytest.mark.usefixtures("trials")
def test_an_interface_that_is_not_there_is_reported(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "kill-drill", *INTERFACE)

    assert outcome.out.splitlines()[-1] == "bus down: left out, vcan7 cannot be set down: No such device"


@pytest.mark.usefixtures("trials")
def test_a_bus_that_is_no_interface_of_the_kernel_cannot_be_set_down(segway_ecc: Run) -> None:
    outcome = segway_ecc("prove", "kill-drill", "--fault", "bus down", "--interface", "socketcan")

    assert outcome.out.splitlines()[-1] == f"bus down: left out, {NO_INTERFACE}"
