# SPDX-License-Identifier: MIT
import pytest
from msgspec import structs

from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.settings import CanSettings, SerialSettings
from segway_ecc.node.config import decode_robot
from segway_ecc.node.errors import ConfigurationError

BASE = "name: bench\nmodel: {source: segway_ecc.node.models.cart:Cart}\nwiring: {}\n"


def _decoded(hardware: str) -> WheelBoardSettings:
    settings = decode_robot(BASE + f"hardware: {{type: wheel_board{hardware}}}", "robot.yaml").hardware
    assert isinstance(settings, WheelBoardSettings)
    return settings


def test_a_board_alone_has_a_bus_the_longest_watchdog_no_imu_and_no_serial_line() -> None:
    expected = {"can": CanSettings(), "watchdog_s": 0.05, "external_imu": None, "serial": None, "imu": False}
    expected |= {"guard": "optional", "ride_through_s": 0.0, "protocol": 2}
    assert structs.asdict(_decoded("")) == expected


def test_every_key_is_taken() -> None:
    settings = _decoded(", watchdog_s: 0.03, imu: true, serial: {port: /dev/ttyACM0, baudrate: 460800}")
    assert settings.imu
    assert settings.watchdog_s == 0.03
    assert settings.serial == SerialSettings(port="/dev/ttyACM0", baudrate=460_800)


def test_two_imus_are_refused() -> None:
    assert _decoded(", external_imu: {}").external_imu is not None
    with pytest.raises(ConfigurationError, match=r"imu: true and external_imu both measure imu\.\*"):
        _decoded(", imu: true, external_imu: {}")


@pytest.mark.parametrize(
    ("wrong", "place"),
    [(", imu: 1", "hardware.imu"), (", serial: {baudrate: 9600}", "hardware.serial"), (", gear: 2", "hardware")],
)
def test_what_it_does_not_know_is_refused_with_its_place(wrong: str, place: str) -> None:
    with pytest.raises(ConfigurationError, match=place.replace(".", r"\.")):
        _decoded(wrong)
