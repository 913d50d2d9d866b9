# SPDX-License-Identifier: MIT
"""The cart on ODrives whose wheels stand anywhere at power-on, armed for the first time, in lock step."""

from collections.abc import Callable, Mapping
from typing import Final

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.hil.devices import odrive as device
from segway_ecc.hil.devices._odrive_axis import SimulatedAxis
from segway_ecc.hil.rig.simulation import LockstepRig, hardware_of, simulated_robot
from segway_ecc.node.config import load_robot
from segway_ecc.node.cycle.interfaces import NoRecorder
from segway_ecc.node.cycle.loop import Loop
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.settings import ChecklistSettings
from segway_ecc.testing import ScriptedClock, ScriptedStage

ANGLES: Final = [(index - 9.5) * 0.37 for index in range(20)]
"""Turns of the motor from the encoder's zero, at power-on."""
Telemetry = Callable[[SimulatedAxis], m.EncoderEstimates]


def zeros_until_closed_loop(turns: float) -> Telemetry:
    """As 0.5.6 sends them, with wheels that stand this many turns from zero."""
    connected: set[int] = set()

    def estimates(axis: SimulatedAxis) -> m.EncoderEstimates:
        if axis.state is m.AxisState.CLOSED_LOOP_CONTROL:
            connected.add(axis.node_id)
        if axis.node_id not in connected:
            return m.EncoderEstimates(0.0, 0.0)
        return m.EncoderEstimates(axis.position_rev + turns, axis.velocity_rev_s)

    return estimates


def encoder_always(turns: float) -> Telemetry:
    """As older firmware of 0.5, and 0.6, send them."""
    return lambda axis: m.EncoderEstimates(axis.position_rev + turns, axis.velocity_rev_s)


SENDS: Final[Mapping[str, tuple[str, Callable[[float], Telemetry]]]] = {
    "0.5, encoder at all times": ("0.5", encoder_always),
    "0.5, zeros until closed loop": ("0.5", zeros_until_closed_loop),
    "0.6": ("0.6", encoder_always),
}


ASKED: Final = 120
"""The cycle in which somebody asks the robot to arm."""


def start(firmware: str, turns: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Loop, ScriptedStage]:
    """The loop of a cart that has a checklist and is asked to arm, once."""
    configured, sends = SENDS[firmware]
    monkeypatch.setitem(device._TELEMETRY, m.EncoderEstimates, sends(turns))
    file = load_robot("cart-odrive")
    assert isinstance(file.hardware, OdriveSettings)
    assert file.safety is not None
    hardware = replace(file.hardware, firmware=configured)
    safety = replace(file.safety, checklist=ChecklistSettings())
    file = replace(file, arming="on_request", hardware=hardware, safety=safety)
    rig = LockstepRig(hardware_of(file).can.bitrate)
    plant = simulated_robot(file, rig.bus.attach("plant"))
    robot = build_robot(file, rig, rig.bus.attach("node"))
    rig.attach(plant)
    stage = ScriptedStage(ScriptedClock())
    stage.send_request(ASKED, Action.ARM)
    return robot.loop(stage, NoRecorder()), stage


@pytest.mark.parametrize("firmware", SENDS)
def test_first_arming_succeeds_from_every_angle_of_both_wheels(firmware: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for turns in ANGLES:
        loop, stage = start(firmware, turns, monkeypatch)
        loop.run(ASKED + 50)
        assert [str(answer) for answer in stage.answers if not answer.accepted] == [], f"{turns:g} turns"
        assert [step.mode for step in loop.modes.history] == [Mode.ARMED], f"{turns:g} turns: {loop.modes.reason}"


def test_checklist_names_what_cannot_be_seen_before_the_motors_are_on(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, _ = start("0.5, zeros until closed loop", 1.0, monkeypatch)
    loop.run(20)
    checks = {check.name: check for check in loop._cycle.arming.checklist()}
    assert str(checks["unseen"]) == (
        "warning: not measured before the motors are on: left.angle, left.velocity, right.angle, right.velocity; "
        "see that the wheels are at rest"
    )
    assert checks["sensors"].passed
    assert checks["telemetry"].passed
    assert "wheels_still" not in checks
