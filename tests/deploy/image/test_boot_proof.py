# SPDX-License-Identifier: MIT
"""What the booted image is held to, with figures: torque, restart, watchdog, power. For a machine that is not busy."""

from pathlib import Path

import pytest

from segway_ecc.hil.drill.plant_control import Tick, read_trace
from tests.deploy.image.robot import Robot, SwitchOn
from tests.deploy.image.test_boot import WRITE
from tests.deploy.image.uml_machine import Machine

pytestmark = [pytest.mark.image, pytest.mark.proof, pytest.mark.timeout(3600)]
CUTS = 10
# What writes nothing to the disk, and takes half of the guest's one slow processor while it starts.
LEFT_OUT = ("systemd.mask=segway-ecc-guard.service", "systemd.mask=segway-ecc-archive.service")
ZERO_WITHIN_S = 0.05
BACK_WITHIN_S = 3.0
HALF_SECOND_NS = 500_000_000
NEWEST = 200
PLANT = """systemd-run --quiet --unit=plant --property=CPUSchedulingPolicy=fifo --property=CPUSchedulingPriority=70 \
segway-ecc plant /etc/segway-ecc/robot.yaml --interface socketcan --channel vcan0 --trace /run/trace.csv"""


def ticks(machine: Machine) -> list[Tick]:
    machine.run("cp /run/trace.csv /run/share/trace.csv")
    return read_trace(machine.share / "trace.csv")


def wait_until_it_drives(robot: Robot) -> None:
    for _ in range(60):
        newest = ticks(robot.machine)[-NEWEST:]
        if newest and all(tick.is_driven for tick in newest):
            return
        if robot.status()["mode"] == "FAULT":
            robot.machine.run("systemctl restart segway-ecc-node")
        robot.machine.run("sleep 0.5")
    pytest.fail(f"the robot never drives: {robot.status()}")


def zero_after_s(found: list[Tick], at_ns: int) -> float:
    """From a fault to the first tick of half a second without any torque, s; a slow guest's plant leaves ticks out."""
    assert all(tick.is_driven for tick in [tick for tick in found if tick.monotonic_ns < at_ns][-20:])
    stamps = [tick.monotonic_ns for tick in found if tick.monotonic_ns >= at_ns]
    driven = [tick.monotonic_ns for tick in found if tick.is_driven]
    first = next(at for at in stamps if not any(at <= other < at + HALF_SECOND_NS for other in driven))
    assert first + HALF_SECOND_NS < stamps[-1]
    return (first - at_ns) * 1e-9


def test_a_node_that_is_killed_leaves_no_torque_and_is_back(
    switch_on: SwitchOn, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with switch_on(tmp_path) as machine:
        robot = Robot(machine)
        robot.wait_until_up()
        machine.run(PLANT)
        machine.wait_until("test -s /run/trace.csv", 120)
        wait_until_it_drives(robot)
        at_ns = robot.kill("SIGKILL")
        machine.run("sleep 4")
        zero_s = zero_after_s(ticks(machine), at_ns)
        back_s = robot.stamps(" runs at ")[-1] - at_ns * 1e-9
        with capsys.disabled():
            print(f"\nkilled: zero torque {zero_s * 1e3:.0f} ms, first cycle again {back_s:.2f} s")  # noqa: T201 - figures
        wait_until_it_drives(robot)
        stopped_ns = robot.kill("SIGSTOP")
        machine.run("sleep 4")
        frozen_s = zero_after_s(ticks(machine), stopped_ns)
        again_s = robot.stamps(" runs at ")[-1] - stopped_ns * 1e-9
        with capsys.disabled():
            print(f"frozen: {frozen_s * 1e3:.0f} ms, {again_s:.2f} s; {robot.times()}")  # noqa: T201 - figures
        assert zero_s <= ZERO_WITHIN_S
        assert frozen_s <= ZERO_WITHIN_S
        assert back_s <= BACK_WITHIN_S


def test_a_machine_that_is_cut_off_in_mid_write_boots_again_ten_times_of_ten(
    switch_on: SwitchOn, tmp_path: Path
) -> None:
    logs: set[str] = set()
    for boot in range(CUTS + 1):
        with switch_on(tmp_path / str(boot), *LEFT_OUT) as machine:
            robot = Robot(machine)
            robot.is_patient()
            robot.wait_until_up()
            assert logs < set(robot.logs())
            assert "/dev/ubdb /var ext4 rw" in machine.run("grep /var /proc/mounts"), "not the one in memory"
            logs = set(robot.logs())
            machine.run("sync; systemctl restart --no-block segway-ecc-node")
            machine.run(WRITE)
