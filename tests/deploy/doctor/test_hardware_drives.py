# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.doctor.check import Verdict
from segway_ecc.deploy.doctor.hardware import check_drives
from tests.deploy.doctor.fake_machine import FakeMachine, workload


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


@pytest.mark.parametrize(("period_ns", "verdict"), [(13_333_333, Verdict.GOOD), (13_400_000, Verdict.WARNING)])
def test_watchdog_must_outlast_three_cycles(fake: FakeMachine, period_ns: int, verdict: Verdict) -> None:
    (found,) = check_drives(fake.machine, workload(fake.root, "cart-can", period_ns))
    assert found.verdict is verdict


def test_settings_that_can_does_not_read_back_are_asked_of_the_person(fake: FakeMachine) -> None:
    _, found = check_drives(fake.machine, workload(fake.root, "cart-odrive"))
    assert found.verdict is Verdict.WARNING
    assert found.found == "vel_limit, enable_overspeed_error and dc_max_negative_current are not read back over CAN"
    assert found.remedy is not None
    for command in ("axis0.controller.config.vel_limit", "axis1.controller.config.enable_overspeed_error"):
        assert f"odrv0.{command}" in found.remedy
    assert "odrv0.config.dc_max_negative_current" in found.remedy
