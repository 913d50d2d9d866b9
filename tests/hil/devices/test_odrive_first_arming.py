# SPDX-License-Identifier: MIT
"""The cart on ODrives whose wheels stand anywhere at power-on, armed for the first time, in lock step."""

from typing import Final

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.hil.devices.odrive import TICK_NS, Release, SimulatedOdrive
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_plant
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.settings import ChecklistSettings
from segway_ecc.testing import ScriptedClock, ScriptedStage

ANGLES: Final = [(index - 9.5) * 2.3 for index in range(20)]
"""Of the left wheel at power-on or turned to after it, rad; the right one's are others, the other way."""
POWERED_NS: Final = 50_000_000
"""How long the drives have power before somebody turns the wheels and starts the node."""
ASKED: Final = 120
"""The cycle in which somebody asks the robot to arm."""


def start(release: Release, angle: float, *, is_absolute: bool = False) -> tuple[Loop, ScriptedStage]:
    """The loop of a cart that has a checklist and is asked to arm, once."""
    file = load_robot("cart-odrive")
    assert isinstance(file.hardware, OdriveSettings)
    assert file.safety is not None
    hardware = replace(file.hardware, firmware=release.firmware.value)
    # 0.5.4 does not send the voltage of its supply unless asked.
    supply = None if release is Release.V0_5_4 else file.safety.supply
    safety = replace(file.safety, checklist=ChecklistSettings(), supply=supply)
    file = replace(file, arming="on_request", hardware=hardware, safety=safety)
    rig = LockstepRig.of(hardware)
    end = rig.bus.attach("drives")
    device = SimulatedOdrive(end, hardware, release=release)
    for axis in device.axes:
        axis.has_absolute_encoder = is_absolute
    simulated = SimulatedRobot(end, [device], simulated_plant(file), TICK_NS)
    rig.attach(simulated)
    turned = {"left.angle": angle, "right.angle": -1.7 * angle}
    if is_absolute:
        simulated.errors |= turned
    rig.sleep_until_ns(POWERED_NS)
    simulated.errors |= turned
    robot = build_robot(file, rig, rig.bus.attach("node"))
    stage = ScriptedStage(ScriptedClock())
    stage.send_request(ASKED, Action.ARM)
    return robot.loop(stage, NoRecorder()), stage


@pytest.mark.parametrize("is_absolute", [False, True])
@pytest.mark.parametrize("release", Release)
def test_first_arming_succeeds_from_every_angle_of_both_wheels(release: Release, *, is_absolute: bool) -> None:
    armed = 0
    for angle in ANGLES:
        loop, stage = start(release, angle, is_absolute=is_absolute)
        loop.run(ASKED + 50)
        assert [str(answer) for answer in stage.answers if not answer.accepted] == [], f"{angle:g} rad"
        assert [step.mode for step in loop.modes.history] == [Mode.ARMED], f"{angle:g} rad: {loop.modes.reason}"
        armed += 1
    assert armed == 20


def test_checklist_names_what_cannot_be_seen_before_the_motors_are_on() -> None:
    loop, _ = start(Release.V0_5_6, 6.0)
    loop.run(20)
    checks = {check.name: check for check in loop._cycle.arming.checklist()}
    assert str(checks["unseen"]) == (
        "warning: not measured before the motors are on: left.angle, left.velocity, right.angle, right.velocity; "
        "see that the wheels are at rest"
    )
    assert checks["sensors"].passed
    assert checks["telemetry"].passed
    assert "wheels_still" not in checks
