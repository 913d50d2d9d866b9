# SPDX-License-Identifier: MIT
"""The traps of a new ODrive's settings, with the cart's driver and plant in lock step: each ends with its cause."""

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.hil.devices.odrive import TICK_NS, Release, SimulatedOdrive
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_plant
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot


class Cart:
    """The hardware of an armed cart, a cycle at a time."""

    def __init__(self, release: Release) -> None:
        file = load_robot("cart-odrive")
        assert isinstance(file.hardware, OdriveSettings)
        settings = replace(file.hardware, firmware=release.firmware.value)
        self.rig = LockstepRig.of(settings)
        end = self.rig.bus.attach("drives")
        self.device = SimulatedOdrive(end, settings, release=release)
        self.rig.attach(SimulatedRobot(end, [self.device], simulated_plant(file), TICK_NS))
        self.hardware = build_robot(replace(file, hardware=settings), self.rig, self.rig.bus.attach("node")).hardware
        self.hardware.open()
        self.run(40)
        self.hardware.arm()
        assert self.run(20) == ""

    def run(self, cycles: int, torque: float = 0.0) -> str:
        """Cycles with a torque at both wheels, N m; the faults in them."""
        faults: set[str] = set()
        for _ in range(cycles):
            self.rig.sleep_until_ns(self.rig.now_ns() + 10_000_000)
            faults |= set(self.hardware.exchange((torque, torque)).faults)
        return "; ".join(sorted(faults))


@pytest.mark.parametrize("release", [Release.V0_5_6, Release.V0_6_10])
def test_the_first_braking_on_a_new_board_names_the_regeneration(release: Release) -> None:
    cart = Cart(release)
    for board in cart.device.boards:
        board.dc_max_negative_current_a = -0.01
    assert cart.run(30, 1.0) == ""
    assert "DC_BUS_OVER_REGEN_CURRENT" in cart.run(30, -1.0)


@pytest.mark.parametrize(
    ("release", "cause"), [(Release.V0_5_6, "OVERSPEED"), (Release.V0_6_10, "VELOCITY_LIMIT_VIOLATION")]
)
def test_too_fast_for_a_new_board_names_the_limit_of_speed(release: Release, cause: str) -> None:
    cart = Cart(release)
    for axis in cart.device.axes:
        axis.velocity_limit_rev_s, axis.enable_torque_mode_velocity_limit = 2.0, False
    assert cause in cart.run(60, 1.0)
