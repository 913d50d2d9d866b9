# SPDX-License-Identifier: MIT
from typing import Any

import pytest
import yaml

from segway_ecc.firmware_io.drives.moteus.settings import MoteusSettings
from segway_ecc.node.config import load_robot
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError

AXIS: dict[str, Any] = {"servo_id": 1, "max_torque": 3.0}
GOOD: dict[str, Any] = {"type": "moteus", "can": {"fd": True}, "axes": {"left": AXIS, "right": AXIS | {"servo_id": 2}}}


def decoded(**changes: Any) -> MoteusSettings:
    return decode_yaml(yaml.safe_dump(GOOD | changes), MoteusSettings, "robot")


def refusal(**changes: Any) -> str:
    with pytest.raises(ConfigurationError) as refused:
        decoded(**changes)
    return str(refused.value)


@pytest.mark.parametrize("name", ["cart-moteus", "segway-moteus"])
def test_the_packaged_robots_are_on_can_fd_with_an_id_for_each_axis(name: str) -> None:
    hardware = load_robot(name).hardware
    assert isinstance(hardware, MoteusSettings)
    assert (hardware.can.bitrate, hardware.can.fd_bitrate) == (1_000_000, 5_000_000)
    assert {name: axis.servo_id for name, axis in hardware.axes.items()} == {"left": 1, "right": 2}
    assert hardware.axes["right"].direction == -1


def test_any_number_of_axes_have_names_of_their_own() -> None:
    assert list(decoded(axes={"pan": AXIS}).axes) == ["pan"]
    many = {f"wheel_{number}": AXIS | {"servo_id": number} for number in range(1, 5)}
    assert list(decoded(axes=many).axes) == list(many)
    assert "axes" in refusal(axes={})


def test_a_bus_of_classic_can_is_refused_with_what_to_write() -> None:
    for bus in ({}, {"fd": False}):
        assert "can: {fd: true, bitrate: 1000000, data_bitrate: 5000000}" in refusal(can=bus)


def test_two_controllers_of_one_id_are_refused() -> None:
    assert "left" in (text := refusal(axes={"left": AXIS, "right": dict(AXIS)}))
    assert "servo_id" in text


@pytest.mark.parametrize("servo_id", [-1, 0, 126, 127, 1.5])
def test_ids_of_this_computer_and_of_everybody_are_refused(servo_id: float) -> None:
    assert "servo_id" in refusal(axes={"left": AXIS | {"servo_id": servo_id}})
