# SPDX-License-Identifier: MIT
"""The cart of the case study on CiA 402 drives, in lock step with its plant."""

from pathlib import Path
from typing import Any

import pytest

from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.devices.cia402 import SimulatedCia402
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot
from segway_ecc.node.sequence.manoeuvre import single_segment
from tests.hil.devices.cia402_faults import latch_fault

ROBOT = "cart-cia402"


def test_the_cart_ends_where_its_model_does_and_the_same_bits_every_time(tmp_path: Path) -> None:
    manoeuvre = single_segment(2.0, 2.0, 10.0)
    first, second = (LockstepCanSeat(None, ROBOT).run(name, manoeuvre).trajectory for name in ("first", "second"))
    offline = OfflineSeat(tmp_path).run("same", manoeuvre).trajectory

    assert first == second
    assert first.x[-1] == pytest.approx(offline.x[-1], abs=0.08)
    assert first.y[-1] == pytest.approx(offline.y[-1], abs=0.08)


class Rig:
    """The cart's hardware and its simulated drives, a cycle at a time."""

    def __init__(self) -> None:
        file = load_robot(ROBOT)
        self.rig = LockstepRig.of(hardware_of(file))
        robot = simulated_robot(file, self.rig.bus.attach("plant"))
        self.rig.attach(robot)
        self.hardware: Any = build_robot(file, self.rig, self.rig.bus.attach("node")).hardware
        (drives,) = robot.devices
        assert isinstance(drives, SimulatedCia402)
        self.drives = drives
        self.hardware.open()
        self.cycle(times=10)

    def cycle(self, *torques: float, times: int = 1) -> Any:
        for _ in range(times):
            self.rig.sleep_until_ns(self.rig.now_ns() + 10_000_000)
            sensors = self.hardware.exchange(torques or (0.0, 0.0))
        return sensors

    def arm(self) -> None:
        self.hardware.arm()
        assert self.cycle(times=6).ready


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_armed_drives_give_and_report_the_requested_torque(rig: Rig) -> None:
    rig.arm()
    rig.cycle(0.3, -0.6, times=2)
    assert (rig.drives.axes["left"].torque, rig.drives.axes["right"].torque) == pytest.approx((0.3, -0.6))
    sensors = rig.cycle(0.3, -0.6)
    told = dict(zip(rig.hardware.signals, sensors.values, strict=True))
    assert (told["left.torque"], told["right.torque"]) == pytest.approx((0.3, -0.6))
    assert told["left.velocity"] > 0.0 > told["right.velocity"]
    assert sensors.faults == ()


def test_a_loop_that_stops_loses_its_torque_within_the_watchdogs_time(rig: Rig) -> None:
    rig.arm()
    rig.cycle(1.0, 1.0, times=3)
    assert rig.drives.axes["left"].torque == pytest.approx(1.0, abs=0.001)
    rig.rig.sleep_until_ns(rig.rig.now_ns() + 53_000_000)
    assert (rig.drives.axes["left"].torque, rig.drives.axes["right"].torque) == (0.0, 0.0)

    faults = rig.cycle(1.0, 1.0).faults
    assert len(faults) >= 2
    rig.hardware.disarm()
    rig.cycle(times=10)
    rig.arm()


def test_a_latched_fault_is_reported_stops_both_and_is_reset_by_arming(rig: Rig) -> None:
    rig.arm()
    rig.cycle(1.0, 1.0, times=2)
    latch_fault(rig.drives.axes["right"])
    sensors = rig.cycle(1.0, 1.0, times=2)
    assert any("right drive reports EMCY 0x2310 (current)" in fault for fault in sensors.faults)
    assert rig.drives.axes["right"].torque == 0.0
    assert rig.drives.axes["left"].torque == 0.0
    rig.hardware.disarm()
    rig.cycle(times=5)
    rig.hardware.arm()
    assert rig.cycle(times=10).ready
    assert rig.cycle().faults == ()


def test_a_drive_that_was_switched_off_and_on_is_set_up_again_and_its_angle_goes_on(rig: Rig) -> None:
    rig.arm()
    rig.cycle(0.5, 0.5, times=30)
    rig.drives.axes["left"].switch_off()
    assert rig.cycle(0.0, 0.0, times=5).faults
    rig.hardware.disarm()
    rig.cycle(times=200)
    angle = rig.cycle().values[0]
    assert angle > 5.0
    rig.drives.axes["left"].switch_on()
    rig.cycle(times=100)
    values = rig.cycle().values
    assert values[0] >= angle
    rig.arm()
    rig.cycle(0.5, 0.5, times=3)
    assert rig.drives.axes["left"].torque == pytest.approx(0.5, abs=0.001)


def test_a_drive_that_restarts_while_armed_is_a_fault(rig: Rig) -> None:
    rig.arm()
    rig.drives.axes["left"].switch_on()
    assert "the left drive has restarted" in rig.cycle(times=2).faults
    assert rig.drives.axes["left"].torque == 0.0


def test_drives_that_are_switched_on_after_the_node_refuse_arming() -> None:
    file = load_robot(ROBOT)
    rig = LockstepRig.of(hardware_of(file))
    hardware: Any = build_robot(file, rig, rig.bus.attach("node")).hardware
    hardware.open()
    (drives,) = hardware._drives
    assert all("is not set up: its object 0x1000:00 cannot be read: no answer" in r for r in drives.arming_failures())
