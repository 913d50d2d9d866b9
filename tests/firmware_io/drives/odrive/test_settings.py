# SPDX-License-Identifier: MIT
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.node.documents import decode_yaml

Configure = Callable[..., OdriveSettings]
MINIMAL = b"""
type: odrive
axes:
  left: {node_id: 3, max_torque: 2.5}
  right: {node_id: 4, max_torque: 2.5, direction: -1}
"""
ENDPOINTS = {"firmware": "0.6.10", "hardware": "4.4.58", "ids": {"config.dc_max_negative_current": 145}}
WHEEL = {"node_id": 5, "max_torque": 1.0}


def test_optional_settings_have_defaults() -> None:
    settings = msgspec.yaml.decode(MINIMAL, type=OdriveSettings)

    assert (settings.firmware, settings.watchdog_s, settings.serial) == ("auto", 0.05, None)
    assert (settings.heartbeat_period_s, settings.encoder_period_s) == (0.02, 0.005)
    assert {name: wheel.node_id for name, wheel in settings.axes.items()} == {"left": 3, "right": 4}
    assert settings.axes["right"].wheel(2.0) == -2.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axes": {"left": WHEEL, "right": WHEEL}}, "left and right have the same node_id, 5"),
        ({"axes": {"left": {**WHEEL, "node_id": 63}}}, "<= 62"),
        ({"axes": {"left": {**WHEEL, "node_id": -1}}}, ">= 0"),
        ({"axes": {"left": {**WHEEL, "axis": 2}}}, "axis"),
        ({"axes": {"left": {**WHEEL, "torque_constant": 0.0}}}, "> 0.0"),
        ({"axes": {}}, "length >= 1"),
        ({"axes": {f"axis{i}": {**WHEEL, "node_id": i} for i in range(17)}}, "length <= 16"),
        ({"axes": {"Left": WHEEL}}, "matching regex"),
        ({"axes": {"imu": WHEEL}}, "no axis can be called 'imu'"),
        ({"firmware": "0.4"}, "firmware"),
        ({"watchdog_s": 0.02}, "heartbeat_period_s must be shorter than watchdog_s"),
        ({"watchdog_s": 0.06}, "<= 0.05"),
        ({"encoder_period_s": 0.0005}, ">= 0.001"),
        ({"firmware": "0.6", "serial": {"port": "/dev/x"}}, "0.6 is reached over CAN only"),
        ({"serial": {"port": "/dev/x", "baudrate": 115_200}}, "serial.baudrate must be 460800 or more"),
        ({"axes": {"pan": WHEEL}, "serial": {"port": "/dev/x"}}, "serial reaches both axes of one board"),
        ({"wheels": 2}, "unknown field `wheels`"),
        ({"endpoints": ENDPOINTS}, "endpoints are of firmware 0.6: set firmware to '0.6'"),
        ({"firmware": "0.6", "endpoints": {**ENDPOINTS, "ids": {}}}, "length >= 1"),
        ({"firmware": "0.6", "endpoints": {**ENDPOINTS, "ids": {"ibus": 2}}}, "ids has 'ibus'; what is compared are"),
        ({"firmware": "0.6", "endpoints": {**ENDPOINTS, "firmware": "0.6"}}, "matching regex"),
    ],
)
def test_what_cannot_be_is_refused(configure: Configure, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=message):
        configure(**changes)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_serial_line_needs_both_axes_of_one_board(configure: Configure, axis: int) -> None:
    axes = {name: {**WHEEL, "node_id": node_id, "axis": axis} for node_id, name in enumerate(("left", "right"))}
    with pytest.raises(msgspec.ValidationError, match="serial reaches both axes of one board"):
        configure(axes=axes, serial={"port": "/dev/x"})


def test_a_robot_has_up_to_sixteen_axes_of_any_name(configure: Configure) -> None:
    axes = {f"joint_{i}": {**WHEEL, "node_id": i} for i in range(16)}
    assert list(configure(axes=axes).axes) == list(axes)


def test_a_serial_line_with_both_axes_is_taken(configure: Configure) -> None:
    serial = configure(serial={"port": "/dev/ttyS0"}).serial
    assert serial is not None
    assert serial.port == "/dev/ttyS0"


def test_the_robot_files_reader_takes_it() -> None:
    assert decode_yaml(MINIMAL.decode(), OdriveSettings, "robot").axes["left"].max_torque == 2.5
