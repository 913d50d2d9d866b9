# SPDX-License-Identifier: MIT
"""The CAN seat on every drive family, through the kernel's driver of two real controllers."""

import pytest

from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.node.sequence.manoeuvre import single_segment


@pytest.mark.parametrize("name", ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402"])
def test_frames_from_can0_to_can1_drive_the_cart_as_those_of_the_simulated_bus_do(name: str) -> None:
    """Time stands still while a frame is on its way, so that no load can disturb this one."""
    manoeuvre = single_segment(2.0, 2.0, 2.0)
    over_kvaser = LockstepCanSeat(None, name, ("can0", "can1")).run("same", manoeuvre)
    simulated = LockstepCanSeat(None, name).run("same", manoeuvre)
    assert over_kvaser.position == pytest.approx(simulated.position, abs=0.02)
