# SPDX-License-Identifier: MIT
"""Names and numbers against the DBC files that ship beside the code; test_frames.py does so for the bytes."""

from importlib.resources import as_file, files
from typing import Any

import cantools
import pytest

from segway_ecc.firmware_io.drives.odrive.frames import AXIS_ERRORS, LAYOUTS, WATCHDOG, Firmware, error_names
from segway_ecc.firmware_io.drives.odrive.listener import AxisListener
from segway_ecc.firmware_io.drives.odrive.messages import PASSTHROUGH, TORQUE_CONTROL, AxisState

FILES = {Firmware.V0_5: "odrive-cansimple-0.5.6", Firmware.V0_6: "odrive-cansimple-0.6.10"}


def load(firmware: Firmware) -> Any:
    with as_file(files("segway_ecc.firmware_io.drives.odrive") / f"{FILES[firmware]}.dbc") as path:
        return cantools.database.load_file(path)


DBC = {firmware: load(firmware) for firmware in Firmware}
MISSING = {
    Firmware.V0_5: {0x02},  # Estop: the list of the master's messages was never added to the 0.5.6 DBC
    Firmware.V0_6: set[int](),
}


@pytest.mark.parametrize("firmware", Firmware)
def test_every_layout_is_of_a_message_in_the_dbc(firmware: Firmware) -> None:
    theirs = {message.frame_id % 32 for message in DBC[firmware].messages}
    assert LAYOUTS[firmware].keys() - theirs == MISSING[firmware]
    assert {message.frame_id // 32 for message in DBC[firmware].messages} == set(range(8))


@pytest.mark.parametrize("firmware", Firmware)
def test_errors_have_the_dbc_names(firmware: Firmware) -> None:
    choices = DBC[firmware].get_message_by_name("Axis0_Heartbeat").get_signal_by_name("Axis_Error").choices
    assert {bit: name for bit, name in choices.items() if bit} == AXIS_ERRORS[firmware]
    assert AXIS_ERRORS[firmware][WATCHDOG[firmware]] == "WATCHDOG_TIMER_EXPIRED"


def test_states_and_modes_have_the_dbc_numbers() -> None:
    dbc = DBC[Firmware.V0_6]
    states = dbc.get_message_by_name("Axis0_Set_Axis_State").get_signal_by_name("Axis_Requested_State").choices
    assert {state.value: state.name for state in AxisState} == {value: str(name) for value, name in states.items()}
    mode = dbc.get_message_by_name("Axis0_Set_Controller_Mode")
    assert mode.get_signal_by_name("Control_Mode").choices[TORQUE_CONTROL] == "TORQUE_CONTROL"
    assert mode.get_signal_by_name("Input_Mode").choices[PASSTHROUGH] == "PASSTHROUGH"


def test_several_errors_are_named_lowest_first_and_one_without_a_name_by_its_number() -> None:
    assert error_names(Firmware.V0_5, 0x4940) == (
        "MOTOR_FAILED",
        "ENCODER_FAILED",
        "WATCHDOG_TIMER_EXPIRED",
        "ESTOP_REQUESTED",
    )
    assert error_names(Firmware.V0_5, 0x80000002) == ("0x2", "0x80000000")
    assert error_names(Firmware.V0_6, 0x800) == ("DC_BUS_OVER_REGEN_CURRENT",)
    assert error_names(Firmware.V0_6, 0) == ()


@pytest.mark.parametrize("firmware", Firmware)
def test_the_licence_ships_with_the_dbc(firmware: Firmware) -> None:
    licence = (files("segway_ecc.firmware_io.drives.odrive") / f"{FILES[firmware]}.LICENSE").read_text("utf-8")
    assert "MIT License" in licence


def test_what_is_listened_to_is_sent_by_the_axis_in_one_firmware_or_the_other(configure: Any) -> None:
    keys = AxisListener("left", configure(), 0.01, lambda: 0).listens_to
    told = {
        message.frame_id
        for firmware in Firmware
        for message in DBC[firmware].messages
        if message.senders == ["ODrive_Axis0"]
    }
    assert {key.arbitration_id for key in keys} <= told
    assert not any(key.is_extended for key in keys)
