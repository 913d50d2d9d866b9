# SPDX-License-Identifier: MIT
"""The constants in the code against the DBC that ships with it; test_frames.py does so for the bytes and ranges."""

from importlib.resources import as_file, files
from typing import Any

import cantools
import pytest

from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard
from segway_ecc.firmware_io.drives.wheel_board.frames import CYCLE_TIME_S, BoardState, FrameId
from segway_ecc.firmware_io.drives.wheel_board.session import CommandId
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Link

with as_file(files("segway_ecc.firmware_io.drives.wheel_board") / "wheel_board.dbc") as _path:
    DBC: Any = cantools.database.load_file(_path)


def test_the_dbc_has_exactly_our_frames() -> None:
    ours = {(frame_id.name, int(frame_id), 8, False) for frame_id in (*FrameId, *CommandId)}
    assert {(m.name, m.frame_id, m.length, m.is_extended_frame) for m in DBC.messages} == ours


def test_cycle_times_are_the_dbcs() -> None:
    cyclic = {m.name: m.cycle_time for m in DBC.messages if m.cycle_time}
    ours = {frame_id.name: round(period * 1000) for frame_id, period in CYCLE_TIME_S.items()}
    halves = dict.fromkeys(("LEFT_COMMAND", "RIGHT_COMMAND"), ours["WHEEL_COMMAND"])
    assert {**ours, **halves} == cyclic


def test_states_are_the_dbcs() -> None:
    choices = DBC.get_message_by_name("BOARD_STATUS").get_signal_by_name("State").choices
    assert {state.value: state.name for state in BoardState} == {value: str(name) for value, name in choices.items()}


@pytest.fixture
def driver(link: Link) -> WheelBoard:
    return WheelBoard(link, WheelBoardSettings(imu=True, protocol=1), 0.01)


def test_units_are_si_and_the_drivers(driver: WheelBoard) -> None:
    units = {f"{m.name}.{s.name}": s.unit for m in DBC.messages for s in m.signals if s.unit}
    assert units == {
        "WHEEL_COMMAND.LeftVoltage": driver.commands["left.voltage"],
        "WHEEL_COMMAND.RightVoltage": driver.commands["right.voltage"],
        "BOARD_SETUP.Watchdog": "s",
        "SESSION_SETUP.Watchdog": "s",
        "LEFT_COMMAND.Voltage": driver.commands["left.voltage"],
        "RIGHT_COMMAND.Voltage": driver.commands["right.voltage"],
        "LEFT_WHEEL.Angle": driver.signals["left.angle"],
        "LEFT_WHEEL.Velocity": driver.signals["left.velocity"],
        "RIGHT_WHEEL.Angle": driver.signals["right.angle"],
        "RIGHT_WHEEL.Velocity": driver.signals["right.velocity"],
        **{f"IMU_GYRO.{axis}": driver.signals[f"imu.angular_velocity_{axis.lower()}"] for axis in "XYZ"},
        **{f"IMU_ACCELERATION.{axis}": driver.signals[f"imu.linear_acceleration_{axis.lower()}"] for axis in "XYZ"},
        "BOARD_STATUS.BusVoltage": "V",
        "BOARD_STATUS.Watchdog": "s",
    }
    assert set(units.values()) == {"V", "rad", "rad/s", "m/s2", "s"}


def test_the_drivers_limits_are_the_dbcs(driver: WheelBoard) -> None:
    command = DBC.get_message_by_name("WHEEL_COMMAND")
    names = {"left.voltage": "LeftVoltage", "right.voltage": "RightVoltage"}
    assert [command.get_signal_by_name(names[name]).maximum for name in driver.commands] == list(driver.limits)
