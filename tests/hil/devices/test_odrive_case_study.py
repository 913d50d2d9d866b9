# SPDX-License-Identifier: MIT
"""The cart of the case study on ODrives, in lock step: the whole node, the bus, the drives and the plant."""

from pathlib import Path

import msgspec
import pytest

from segway_ecc.firmware_io.drives.odrive.driver import Odrive
from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.devices.odrive import DEFAULT_RELEASES, TICK_NS, SimulatedOdrive
from segway_ecc.hil.plants.cart import CartTorquePlant
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.config import load_robot
from segway_ecc.node.sequence.manoeuvre import single_segment

MS = 1_000_000
CYCLE_NS = 10 * MS


@pytest.mark.parametrize("duration", [2.0, 10.0])
def test_the_cart_ends_where_the_model_does(tmp_path: Path, duration: float) -> None:
    manoeuvre = single_segment(2.0, 2.0, duration)
    found = LockstepCanSeat(None, "cart-odrive").run("t", manoeuvre).trajectory
    offline = OfflineSeat(tmp_path).run("same", manoeuvre).trajectory

    assert found.x[-1] == pytest.approx(offline.x[-1], abs=0.12)
    assert found.y[-1] == pytest.approx(offline.y[-1], abs=0.12)
    assert abs(offline.x[-1]) + abs(offline.y[-1]) > 0.5, "it went somewhere"


class Bench:
    """Both axes with the cart's plant on a simulated bus, without the node."""

    def __init__(self, runs: Firmware, configured: str) -> None:
        file = load_robot("cart-odrive")
        assert isinstance(file.hardware, OdriveSettings)
        settings = msgspec.structs.replace(file.hardware, firmware=configured)
        self.rig = LockstepRig(500_000)
        self.link = self.rig.bus.attach("node")
        device_link = self.rig.bus.attach("drives")
        self.device = SimulatedOdrive(device_link, settings, release=DEFAULT_RELEASES[runs])
        self.rig.attach(SimulatedRobot(device_link, [self.device], CartTorquePlant(), TICK_NS))
        self.drives = [Odrive(self.link, name, settings, 0.01, self.rig.now_ns) for name in ("left", "right")]
        for drive in self.drives:
            drive.start()

    def run(self, cycles: int, torque: float = 0.0) -> list[str]:
        """Cycles; the faults seen in them."""
        faults: list[str] = []
        for _ in range(cycles):
            for frame in self.link.receive():
                for drive in self.drives:
                    drive.take_frame(frame)
            for drive in self.drives:
                faults += drive.faults()
                drive.command([torque])
            self.rig.sleep_until_ns(self.rig.now_ns() + CYCLE_NS)
        return faults

    def arming_failures(self) -> list[str]:
        return [text for drive in self.drives for text in drive.arming_failures()]

    def enable(self) -> None:
        for drive in self.drives:
            drive.enable()

    @property
    def is_enabled(self) -> bool:
        return all(drive.is_enabled for drive in self.drives)


RUNS = pytest.mark.parametrize(
    ("runs", "configured"),
    [(Firmware.V0_5, "0.5"), (Firmware.V0_6, "0.6"), (Firmware.V0_5, "auto"), (Firmware.V0_6, "auto")],
)


@RUNS
def test_both_firmwares_prove_their_watchdogs_arm_turn_and_disarm(runs: Firmware, configured: str) -> None:
    bench = Bench(runs, configured)
    bench.run(60 if configured == "auto" else 15)
    assert bench.arming_failures() == []
    assert {drive.health["firmware"][:3] for drive in bench.drives} == {runs.value}

    bench.enable()
    assert bench.run(10) == []
    assert bench.is_enabled
    assert bench.run(50, 0.1) == []
    left, right = (drive.read() for drive in bench.drives)
    assert left.values[1] == pytest.approx(right.values[1], abs=0.01)
    assert left.values[1] > 1.0
    assert left.values[2] == pytest.approx(0.1, rel=1e-6)
    assert left.valid == (True, True, True, True)
    assert left.values[3] == pytest.approx(36.0)

    for drive in bench.drives:
        drive.disable()
    bench.run(5)
    assert {axis.state.name for axis in bench.device.axes} == {"IDLE"}
    assert bench.arming_failures() == []


@RUNS
def test_it_is_not_armed_while_a_watchdog_is_off(runs: Firmware, configured: str) -> None:
    bench = Bench(runs, configured)
    bench.device.axes[1].watchdog_s = None
    bench.run(100)
    (failure,) = bench.arming_failures()
    assert failure.startswith("right ODrive axis (node 1): its watchdog was not seen to expire")


@pytest.mark.parametrize("watchdog_s", [0.02, 0.03, 0.035, 0.04])
def test_every_time_out_up_to_the_allowed_one_is_proved_however_the_heartbeats_fall(watchdog_s: float) -> None:
    for offset_ms in range(20):
        bench = Bench(Firmware.V0_5, "0.5")
        for axis, cycles in zip(bench.device.axes, bench.device.cycles, strict=True):
            axis.watchdog_s = watchdog_s
            cycles[0].last_ns = -offset_ms * MS
        bench.run(150)
        proved = [float(drive.health["watchdog_ms"]) for drive in bench.drives if drive.arming_failures() == []]
        assert all(watchdog_s * 1e3 <= took_ms <= watchdog_s * 1e3 + 24 for took_ms in proved)
        assert len(proved) == 2


@pytest.mark.parametrize("watchdog_s", [0.09, 0.2, 1.0])
def test_a_longer_one_is_refused_however_the_heartbeats_fall(watchdog_s: float) -> None:
    for offset_ms in range(0, 20, 3):
        bench = Bench(Firmware.V0_5, "0.5")
        for axis, cycles in zip(bench.device.axes, bench.device.cycles, strict=True):
            axis.watchdog_s = watchdog_s
            cycles[0].last_ns = -offset_ms * MS
        bench.run(250)
        assert len(bench.arming_failures()) == 2


def test_a_drive_that_restarts_while_disarmed_proves_itself_again() -> None:
    bench = Bench(Firmware.V0_5, "0.5")
    bench.run(15)
    bench.device.switch_off()
    bench.run(30)
    assert any("sends no heartbeat" in failure for failure in bench.arming_failures())
    for axis in bench.device.axes:
        axis.watchdog_s = None
    bench.device.switch_on()
    bench.run(30)
    assert any("was not seen to expire" in failure for failure in bench.arming_failures())


def test_a_drive_that_loses_power_or_errs_while_armed_is_a_fault_within_its_time() -> None:
    bench = Bench(Firmware.V0_5, "0.5")
    bench.run(15)
    bench.enable()
    bench.run(10)
    bench.device.axes[0].latch(0x100)
    assert "ENCODER_FAILED" in bench.run(4)[0]
    bench.device.switch_off()
    assert any("estimates too old" in fault for fault in bench.run(5))


def test_errors_that_come_back_keep_it_from_enabling() -> None:
    bench = Bench(Firmware.V0_5, "0.5")
    bench.run(15)
    bench.enable()
    for _ in range(60):
        bench.device.axes[1].latch(0x40)
        faults = bench.run(1)
    assert not bench.is_enabled
    assert any("right ODrive axis does not go to closed loop: IDLE, errors: " in fault for fault in faults)
