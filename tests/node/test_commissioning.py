# SPDX-License-Identifier: MIT
"""The report of a commissioning, and whether a robot may arm by it."""

from pathlib import Path

import msgspec
import pytest

from segway_ecc.firmware_io.build import imu_line, with_imu_port, with_port
from segway_ecc.node.commissioning import (
    STEPS,
    CommissioningReport,
    StepReport,
    digests_of,
    read_report,
    report_path,
    why_not_commissioned,
)
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot
from segway_ecc.node.errors import ConfigurationError

ROBOT = msgspec.structs.replace(load_robot("segway"), commissioned="required")


def report(**changes: object) -> CommissioningReport:
    """A report that passed, but for some changes."""
    good = CommissioningReport(
        robot="segway",
        date="2026-01-01T00:00:00+00:00",
        version="0.2.0",
        is_simulated=False,
        digests=digests_of(ROBOT),
        steps=tuple(StepReport(step=step, verdict="passed", text="good") for step in STEPS),
    )
    return msgspec.structs.replace(good, **changes)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Where a report that passed lies."""
    path = tmp_path / "segway.commissioned.yaml"
    path.write_bytes(msgspec.yaml.encode(report()))
    return path


def test_robot_with_a_report_that_passed_is_commissioned(path: Path) -> None:
    assert read_report(path) == report()
    assert why_not_commissioned(ROBOT, path) is None


def test_robot_that_does_not_require_it_needs_no_report() -> None:
    assert why_not_commissioned(load_robot("segway"), None) is None


def test_missing_report_is_named(tmp_path: Path) -> None:
    reason = why_not_commissioned(ROBOT, tmp_path / "none.yaml")
    assert reason == f"there is no commissioning report {tmp_path / 'none.yaml'}: No such file or directory"
    assert why_not_commissioned(ROBOT, None) == "no commissioning report was named"


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"robot": "other"}, "is the report of robot 'other', not 'segway'"),
        ({"is_simulated": True}, "is of a simulated robot"),
        ({"steps": ()}, f"has not passed: {', '.join(STEPS)}"),
        ({"digests": {}}, "is stale: hardware, wiring, model, safety changed in the robot file since"),
    ],
)
def test_report_that_does_not_hold_is_named(path: Path, changes: dict[str, object], reason: str) -> None:
    path.write_bytes(msgspec.yaml.encode(report(**changes)))
    assert why_not_commissioned(ROBOT, path) == f"{path} of 2026-01-01T00:00:00+00:00 {reason}"


@pytest.mark.parametrize(
    ("verdict", "step", "holds"),
    [
        ("confirmed", "e-stop", True),
        ("refused", "imu", False),
        ("left out", "kill", False),
        ("left out", "guard", True),
    ],
)
def test_each_verdict_counts_as_it_is_meant(path: Path, verdict: str, step: str, holds: bool) -> None:  # noqa: FBT001
    steps = [msgspec.structs.replace(each, verdict=verdict) if each.step == step else each for each in report().steps]
    path.write_bytes(msgspec.yaml.encode(report(steps=tuple(steps))))
    assert (why_not_commissioned(ROBOT, path) is None) is holds


def _changed(file: RobotFile, part: str) -> RobotFile:
    match part:
        case "hardware":
            hardware = msgspec.structs.replace(file.hardware, watchdog_s=0.03)
            return msgspec.structs.replace(file, hardware=hardware)
        case "wiring":
            return msgspec.structs.replace(file, wiring={**file.wiring, "LeftAngle": "right.angle"})
        case "model":
            model = msgspec.structs.replace(file.model, parameters={**file.model.parameters, "WheelRadius": 0.051})
            return msgspec.structs.replace(file, model=model)
    assert file.safety is not None
    return msgspec.structs.replace(file, safety=msgspec.structs.replace(file.safety, max_command=8.0))


@pytest.mark.parametrize("part", ["hardware", "wiring", "model", "safety"])
def test_change_of_a_part_makes_the_report_stale(path: Path, part: str) -> None:
    reason = why_not_commissioned(_changed(ROBOT, part), path)
    assert reason is not None
    assert reason.endswith(f"is stale: {part} changed in the robot file since")


def test_other_bus_leaves_the_report_good(path: Path) -> None:
    hardware = ROBOT.hardware
    can = msgspec.structs.replace(hardware.can, interface="socketcan", channel="can7")  # type: ignore[union-attr]
    file = msgspec.structs.replace(ROBOT, hardware=msgspec.structs.replace(hardware, can=can))
    assert why_not_commissioned(file, path) is None


def test_other_serial_lines_of_drives_and_imu_count_no_more_than_another_bus() -> None:
    file = load_robot("segway-hoverboard")
    assert not isinstance(file.hardware, NoHardwareSection)
    moved = with_imu_port(with_port(file.hardware, "/dev/wheels"), "/dev/imu")
    assert moved != file.hardware
    assert digests_of(msgspec.structs.replace(file, hardware=moved)) == digests_of(file)
    imu = imu_line(file.hardware)
    assert imu is not None
    turned = msgspec.structs.replace(imu, mounting=("+y", "-x", "+z"))
    other = msgspec.structs.replace(file.hardware, external_imu=turned)
    assert digests_of(msgspec.structs.replace(file, hardware=other))["hardware"] != digests_of(file)["hardware"]


def test_broken_report_is_refused_with_its_place(path: Path) -> None:
    path.write_text("robot: segway\nsteps: 3\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"commissioning report .*steps"):
        read_report(path)


def test_report_lies_beside_the_robot_file() -> None:
    assert report_path("/etc/segway-ecc/robot.yaml") == Path("/etc/segway-ecc/robot.commissioned.yaml")
    assert report_path("segway") == Path("segway.commissioned.yaml")
