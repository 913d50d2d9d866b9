# SPDX-License-Identifier: MIT
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict, Workload
from segway_ecc.deploy.doctor.hardware import check_drives
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveEndpoints
from segway_ecc.firmware_io.links.settings import SerialSettings
from tests.deploy.doctor.fake_machine import FakeMachine, by_name, workload


@pytest.mark.parametrize(
    ("robot", "text"),
    [
        ("cart-can", "40 ms, set by the node, and read back before it arms"),
        ("cart-odrive", "40 ms, set with odrivetool; the node has each axis prove it before it arms"),
        ("cart-vesc", "30 ms, set with VESC Tool; the node measures it before it arms"),
        ("cart-moteus", "40 ms, sent in each command, and read back before arming"),
        ("cart-cia402", "40 ms, a heartbeat time that the node sets, and reads back before it arms"),
        ("cart", "no drives"),
        (None, "no robot is named"),
    ],
)
def test_how_the_watchdog_is_known(fake: FakeMachine, robot: str | None, text: str) -> None:
    found, *_ = check_drives(fake.machine, workload(fake.root, robot))
    assert (found.verdict, found.found) == (Verdict.GOOD, text)


def test_what_a_long_watchdog_leaves_open_is_named_with_and_without_a_guard(fake: FakeMachine) -> None:
    plain = workload(fake.root, "cart-hoverboard")
    assert plain.robot is not None
    assert isinstance(plain.hardware, HoverboardSettings)
    findings = by_name(list(check_drives(fake.machine, plain)))
    watchdog, risk = findings["drives' watchdogs"], findings["drives' watchdogs, residual risk"]
    assert watchdog.found == "815.062 ms, SERIAL_TIMEOUT 160 of its firmware, as the robot file has it"
    assert risk.verdict is Verdict.WARNING
    assert risk.found == "815 ms: the guard alone ends a dead node's torque"
    assert risk.effect == ("a cut cable, an unplugged adapter or a computer that dies leaves the torque on for 815 ms")
    assert risk.remedy is not None
    assert "#define SERIAL_TIMEOUT 8" in risk.remedy
    assert "TANK_STEERING" in (findings["hoverboard firmware"].remedy or "")

    robot, drives = plain.robot, plain.hardware

    def changed(**changes: object) -> dict[str, Finding]:
        hardware = msgspec.structs.replace(drives, **changes)
        file = msgspec.structs.replace(robot, hardware=hardware)
        return by_name(list(check_drives(fake.machine, Workload(plain.logs, plain.log_bytes, file, plain.period_ns))))

    risk = changed(guard="optional")["drives' watchdogs, residual risk"]
    assert risk.effect is not None
    assert risk.effect.endswith("and so does a node that dies while no guard runs")
    assert risk.remedy is not None
    assert risk.remedy.endswith("; hardware.guard: required")
    assert "drives' watchdogs, residual risk" not in changed(serial_timeout_cycles=8)


@pytest.mark.parametrize(("period_ns", "verdict"), [(13_333_333, Verdict.GOOD), (13_400_000, Verdict.WARNING)])
def test_watchdog_must_outlast_three_cycles(fake: FakeMachine, period_ns: int, verdict: Verdict) -> None:
    (found,) = check_drives(fake.machine, workload(fake.root, "cart-can", period_ns))
    assert found.verdict is verdict


def test_settings_that_can_does_not_read_back_are_asked_of_the_person(fake: FakeMachine) -> None:
    _, found = check_drives(fake.machine, workload(fake.root, "cart-odrive"))
    assert found.verdict is Verdict.WARNING
    assert found.found == "not read back: vel_limit, enable_overspeed_error, dc_max_negative_current"
    assert found.remedy is not None
    for command in ("axis0.controller.config.vel_limit", "axis1.controller.config.enable_overspeed_error"):
        assert f"odrv0.{command}" in found.remedy
    assert "odrv0.config.dc_max_negative_current" in found.remedy


def with_hardware(root: Path, **changes: object) -> Workload:
    """The cart on ODrives with other settings."""
    found = workload(root, "cart-odrive")
    assert found.robot is not None
    hardware = msgspec.structs.replace(found.robot.hardware, **changes)
    return replace(found, robot=msgspec.structs.replace(found.robot, hardware=hardware))


def test_settings_that_a_line_reads_back_are_not_asked_of_the_person(fake: FakeMachine) -> None:
    serial = with_hardware(fake.root, serial=SerialSettings(port="/dev/x", baudrate=921_600))
    assert len(list(check_drives(fake.machine, serial))) == 1


def test_of_endpoints_those_that_are_missing_are_asked_of_the_person(fake: FakeMachine) -> None:
    ids = {"axis0.controller.config.vel_limit": 1, "axis0.controller.config.enable_overspeed_error": 2}
    endpoints = OdriveEndpoints(firmware="0.6.10", hardware="4.4.58", ids=ids)
    _, found = check_drives(fake.machine, with_hardware(fake.root, firmware="0.6", endpoints=endpoints))
    assert found.found == "not read back: dc_max_negative_current"
    ids["config.dc_max_negative_current"] = 3
    whole = with_hardware(fake.root, firmware="0.6", endpoints=endpoints)
    assert len(list(check_drives(fake.machine, whole))) == 1
