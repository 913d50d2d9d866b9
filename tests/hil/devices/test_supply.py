# SPDX-License-Identifier: MIT
"""The voltage of the supply, from the plant through each drive family to the robot's signal, in lock step."""

from typing import Any

import pytest

from segway_ecc.hil.devices.cia402 import DriveKind, SimulatedCia402
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.robot import build_robot

CYCLE_NS = 10_000_000
CARTS = ("cart-can", "cart-odrive", "cart-vesc", "cart-cia402", "cart-moteus")
PLANT = "truth.supply_voltage"


class Bench:
    """A robot and its simulated drives, a cycle at a time."""

    def __init__(self, name: str, device: type[SimulatedCia402] | None = None, **options: Any) -> None:
        file: RobotFile = load_robot(name)
        self.rig = LockstepRig.of(hardware_of(file))
        ends = self.rig.ends(hardware_of(file))
        end = ends.devices
        self.robot = simulated_robot(file, end, ends.port)
        if device is not None:
            drives = device(end, file.hardware, **options)  # type: ignore[arg-type]  # whose settings the file has
            self.robot = SimulatedRobot(end, [drives], self.robot.plant, self.robot.tick_ns)
        self.rig.attach(self.robot)
        self.hardware: Any = build_robot(file, self.rig, ends.node).hardware
        self.place = list(self.hardware.signals).index("supply.voltage")
        self.hardware.open()

    def cycle(self, times: int = 1) -> Any:
        for _ in range(times):
            self.rig.sleep_until_ns(self.rig.now_ns() + CYCLE_NS)
            sensors = self.hardware.exchange((0.0,) * len(self.hardware.commands))
        return sensors

    def supply(self, times: int = 30) -> tuple[float, bool]:
        """The signal after some cycles, V, and whether it is valid."""
        sensors = self.cycle(times)
        return round(sensors.values[self.place], 3), sensors.valid[self.place]


@pytest.mark.parametrize("name", CARTS)
def test_a_plant_without_a_supply_is_fed_by_a_constant_one(name: str) -> None:
    assert Bench(name).supply() == (36.0, True)


@pytest.mark.parametrize("name", CARTS)
def test_the_plants_supply_is_measured_within_a_third_of_a_second(name: str) -> None:
    bench = Bench(name)
    bench.cycle(30)
    for volts in (23.4, 19.8):
        bench.robot.stuck[PLANT] = volts
        assert bench.supply() == (volts, True)


@pytest.mark.parametrize("name", ["segway", "segway-odrive", "segway-moteus"])
def test_the_segways_battery_is_the_robots_supply(name: str) -> None:
    bench = Bench(name)
    volts, is_valid = bench.supply()
    assert is_valid
    assert volts == pytest.approx(dict(zip(bench.robot.output_names, bench.robot.outputs, strict=True))[PLANT], abs=0.5)
    assert volts != pytest.approx(36.0, abs=1.0), "the constant of a plant without a battery"


@pytest.mark.parametrize("name", CARTS)
@pytest.mark.parametrize("volts", [0.0, -5.0, 100.0])
def test_a_supply_out_of_range_stops_no_device(name: str, volts: float) -> None:
    bench = Bench(name)
    bench.robot.stuck[PLANT] = volts
    told, is_valid = bench.supply()
    assert is_valid
    assert -5.0 <= told <= 100.0


@pytest.mark.parametrize("name", CARTS)
def test_the_robot_has_one_signal_of_its_supply_with_its_unit(name: str) -> None:
    signals = Bench(name).hardware.signals
    assert {signal: unit for signal, unit in signals.items() if signal.startswith("supply")} == {"supply.voltage": "V"}


def test_drives_without_the_object_are_armed_and_their_supply_is_never_fresh() -> None:
    bench = Bench("cart-cia402", SimulatedCia402, kind=DriveKind(lacks=(0x6079,)))
    assert bench.supply(150) == (0.0, False)
    bench.hardware.arm()
    sensors = bench.cycle(10)
    assert (sensors.ready, sensors.faults) == (True, ())
    assert bench.hardware.health["drives.left.bus_voltage_v"] == "not reported"
    assert bench.hardware.arming_failures() == []


def test_a_drive_that_was_off_and_is_set_up_again_reports_its_supply_again() -> None:
    bench = Bench("cart-cia402")
    bench.cycle(30)
    drives = bench.robot.devices[0]
    assert isinstance(drives, SimulatedCia402)
    drives.axes["left"].switch_off()
    assert bench.supply(150)[1] is False
    drives.axes["left"].switch_on()
    bench.robot.stuck[PLANT] = 20.0
    assert bench.supply(200) == (20.0, True)
    assert bench.hardware.arming_failures() == []
