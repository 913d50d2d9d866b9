# SPDX-License-Identifier: MIT
from typing import Any

import pytest
import yaml

from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.node.config import load_robot
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError

GOOD: dict[str, Any] = {
    "type": "vesc",
    "timeout_set_s": 0.05,
    "axes": {
        "left": {"controller_id": 1, "pole_pairs": 7, "torque_constant": 0.1, "max_torque": 3.0},
        "right": {"controller_id": 2, "pole_pairs": 7, "torque_constant": 0.1, "max_torque": 3.0},
    },
}


def decoded(left: dict[str, Any] | None = None, right: dict[str, Any] | None = None, **changes: Any) -> VescSettings:
    axes = GOOD["axes"]
    axes = {"left": {**axes["left"], **(left or {})}, "right": {**axes["right"], **(right or {})}}
    document = {**GOOD, "axes": axes, **changes}
    return decode_yaml(yaml.safe_dump({k: v for k, v in document.items() if v is not None}), VescSettings, "robot")


def refusal(**changes: Any) -> str:
    with pytest.raises(ConfigurationError) as refused:
        decoded(**changes)
    return str(refused.value)


def test_the_packaged_robot_is_on_two_controllers() -> None:
    hardware = load_robot("cart-vesc").hardware
    assert isinstance(hardware, VescSettings)
    assert [wheel.controller_id for wheel in hardware.axes.values()] == [1, 2]
    assert (hardware.timeout_set_s, hardware.status_rate_hz, hardware.serial) == (0.03, 200.0, None)
    assert hardware.axes["right"].direction == -1


def test_the_time_out_has_to_be_affirmed() -> None:
    assert "missing required field `timeout_set_s`" in refusal(timeout_set_s=None)


@pytest.mark.parametrize(("lowest", "highest"), [(0.02, 0.1)])
def test_the_time_out_has_a_range(lowest: float, highest: float) -> None:
    assert decoded(timeout_set_s=lowest).timeout_set_s == lowest
    assert decoded(timeout_set_s=highest).timeout_set_s == highest
    for beyond in (0.0, 0.0199, 0.1001, 1.0):
        assert "timeout_set_s" in refusal(timeout_set_s=beyond)


@pytest.mark.parametrize(
    ("key", "beyond"),
    [
        ("controller_id", (-1, 253, 254, 255)),
        ("pole_pairs", (0, 101, 7.5)),
        ("torque_constant", (0.0, -0.1, 101.0)),
        ("max_torque", (0.0, -1.0)),
        ("direction", (0, 2)),
        ("gear_ratio", (0.0, -1.0)),
    ],
)
def test_each_value_of_a_wheel_has_a_range(key: str, beyond: tuple[float, ...]) -> None:
    for value in beyond:
        assert f"left.{key}" in refusal(left={key: value})


@pytest.mark.parametrize("rate_hz", [49.0, 1001.0])
def test_the_rate_of_status_has_a_range(rate_hz: float) -> None:
    assert "status_rate_hz" in refusal(status_rate_hz=rate_hz)


def test_two_controllers_have_two_identifiers() -> None:
    assert "left and right have the same controller_id, 1" in refusal(right={"controller_id": 1})


def test_this_computer_has_an_identifier_of_its_own_for_each_controller() -> None:
    axes = {f"joint{i}": {**GOOD["axes"]["left"], "controller_id": i} for i in range(16)}
    host_ids = decoded(axes=axes).host_ids
    assert list(host_ids.values()) == list(range(254, 238, -1))
    axes["joint3"] = {**axes["joint3"], "controller_id": 239}
    assert "joint3.controller_id must be below 239: from there on they are this computer's" in refusal(axes=axes)


def test_a_torque_that_no_controller_gives_is_refused() -> None:
    assert decoded(left={"max_torque": 100.0}).axes["left"].max_current == pytest.approx(1_000.0)
    assert decoded(left={"max_torque": 500.0, "gear_ratio": 5.0, "direction": -1}).axes[
        "left"
    ].max_current == pytest.approx(1e3)
    text = refusal(left={"max_torque": 101.0})
    assert "max_torque 101 N m takes 1010 A of motor current; are torque_constant and gear_ratio right?" in text


def test_a_watchdog_that_the_controller_does_not_have_is_refused() -> None:
    assert "a VESC takes no watchdog_s: set its time-out in VESC Tool" in refusal(watchdog_s=0.02)


def test_the_serial_line_is_that_of_one_of_them() -> None:
    settings = decoded(serial={"port": "/dev/ttyUSB0", "baudrate": 115_200}, serial_controller="right")
    assert settings.serial is not None
    assert settings.serial_controller == "right"
    assert "serial_controller" in refusal(serial_controller="middle")
