# SPDX-License-Identifier: MIT
"""The first arming after power-on, wherever the wheels were turned to before: the whole node in lock step."""

import msgspec
import pytest

from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.hil.devices.odrive import TICK_NS, Release, SimulatedOdrive
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_plant
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder, NoStage
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Mode

POWERED_NS = 50_000_000
"""How long the drives have power before somebody turns the wheels and starts the node."""
CYCLES = 300
ANGLES = [0.61 * number - 5.8 for number in range(20)]
"""Of the left wheel, rad, almost a turn either way; the right one is turned the other way and further."""
ZEROS_FAULT = pytest.mark.xfail(
    strict=True, reason="the driver takes the jump of the estimates at closed loop for motion of the wheel"
)


def armed_from(release: Release, angle: float) -> tuple[Mode, str]:
    """The mode that the cart ends in, and why."""
    file = load_robot("cart-odrive")
    assert isinstance(file.hardware, OdriveSettings)
    settings = msgspec.structs.replace(file.hardware, firmware=release.firmware.value)
    assert file.safety is not None
    # 0.5.4 does not send the voltage of its supply unless asked.
    safety = msgspec.structs.replace(file.safety, supply=None) if release is Release.V0_5_4 else file.safety
    file = msgspec.structs.replace(file, hardware=settings, safety=safety)
    rig = LockstepRig(settings.can.bitrate)
    end = rig.bus.attach("drives")
    simulated = SimulatedRobot(end, [SimulatedOdrive(end, settings, release=release)], simulated_plant(file), TICK_NS)
    rig.attach(simulated)
    rig.sleep_until_ns(POWERED_NS)
    simulated.errors |= {"left.angle": angle, "right.angle": -1.7 * angle}
    loop = build_robot(file, rig, rig.bus.attach("node")).loop(NoStage(), NoRecorder())
    loop.run(CYCLES)
    return loop.modes.mode, loop.modes.reason


@pytest.mark.parametrize("release", [Release.V0_5_4, pytest.param(Release.V0_5_6, marks=ZEROS_FAULT), Release.V0_6_10])
def test_the_first_arming_succeeds_from_every_angle(release: Release) -> None:
    failed = {}
    for angle in ANGLES:
        mode, reason = armed_from(release, angle)
        if mode is not Mode.ARMED:
            failed[round(angle, 2)] = f"{mode}: {reason}"
    assert failed == {}
