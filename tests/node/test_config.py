# SPDX-License-Identifier: MIT
from pathlib import Path

import msgspec
import pytest

from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.node.config import (
    ModelSection,
    NoHardwareSection,
    SetpointSection,
    decode_robot,
    load_robot,
    packaged_robots,
    read_text,
)
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.robot import build_robot
from segway_ecc.node.safety.settings import StationSettings
from segway_ecc.testing import ScriptedClock

PACKAGED = (
    "the packaged robots are arm, cart, cart-can, cart-cia402, cart-hoverboard, cart-moteus, cart-odrive, cart-vesc, "
    "pan-tilt, segway, segway-hoverboard, segway-moteus, segway-odrive, skid-steer"
)
BASE = "name: cart\nmodel: {source: 'segway_ecc.node.models.cart:Cart'}\nwiring: {}\n"


def refusal(text: str) -> str:
    with pytest.raises(ConfigurationError) as caught:
        decode_robot(text, "robot.yaml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("robot.yaml")
    return message.removeprefix("robot.yaml: ")


def test_the_packaged_robots_are_the_cart_and_the_segway_on_the_drive_families_and_one_of_each_kind() -> None:
    carts = ["cart", "cart-can", "cart-cia402", "cart-hoverboard", "cart-moteus", "cart-odrive", "cart-vesc"]
    segways = ["segway", "segway-hoverboard", "segway-moteus", "segway-odrive"]
    assert packaged_robots() == ["arm", *carts, "pan-tilt", *segways, "skid-steer"]


@pytest.mark.parametrize("name", packaged_robots())
def test_every_packaged_robot_loads_under_its_name_and_can_be_built(name: str) -> None:
    file = load_robot(name)
    assert file.name == name
    robot = build_robot(file, ScriptedClock())
    assert robot.period_ns == (5_000_000 if name.startswith("segway") else 10_000_000)
    assert robot.model.name.startswith(("cart", "segway", "arm", "pan-tilt", "skid-steer"))


@pytest.mark.parametrize("name", ["segway", "segway-hoverboard", "segway-odrive", "segway-moteus"])
def test_the_packaged_segways_sit_down_without_their_base_station_and_no_cart_does(name: str) -> None:
    sits = StationSettings(timeout_s=1.0, sit_down_after_s=10.0, sit_down={"stand": 0.0}, disarm_after_s=16.0)
    assert load_robot(name).station == sits
    assert {load_robot(cart).station for cart in packaged_robots() if cart.startswith("cart")} == {None}


def test_a_robot_that_would_sit_down_by_what_it_does_not_have_is_not_built() -> None:
    station = StationSettings(sit_down_after_s=2.0, sit_down={"kneel": 0.0})
    file = msgspec.structs.replace(load_robot("segway"), station=station)
    with pytest.raises(UnknownNameError, match=r"station\.sit_down .* called 'kneel'; there is stand$"):
        build_robot(file, ScriptedClock())


def test_what_a_file_leaves_out_has_its_default() -> None:
    file = decode_robot(BASE, "robot.yaml")
    assert file.model == ModelSection(source="segway_ecc.node.models.cart:Cart", parameters={})
    assert (file.hardware, file.arming, file.actuate) == (NoHardwareSection(), "on_request", "next_cycle")
    assert file.setpoint == SetpointSection(timeout_s=0.5, stamp_tolerance_s=0.1, horizon_s=30.0)
    assert file.simulation is None
    board = decode_robot(BASE + "hardware: {type: wheel_board}", "robot.yaml").hardware
    assert isinstance(board, WheelBoardSettings)
    assert (board.can.interface, board.can.channel, board.can.bitrate, board.watchdog_s) == (
        "auto",
        "auto",
        500_000,
        0.05,
    )


def test_a_file_is_read_from_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(BASE.replace("cart\n", "Karre ü\n"), encoding="utf-8")
    assert load_robot(str(path)).name == "Karre ü"
    assert read_text(str(path)) == path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(
            BASE + "arm: true",
            "Object contains unknown field `arm`; the keys there are actuate, arming, commissioned, geometry, "
            "hardware, mixing, model, name, ros, safety, setpoint, simulation, station, wiring",
            id="unknown key at the top",
        ),
        pytest.param(
            BASE + "setpoint: {timeout: 1}",
            "Object contains unknown field `timeout` at setpoint; the keys there are beyond_limits, horizon_s, "
            "max_angular_velocity, max_linear_velocity, stamp_tolerance_s, timeout_s",
            id="unknown key in a section",
        ),
        pytest.param(
            BASE + "hardware: {type: wheel_board, can: {bitrat: 5}}",
            "Object contains unknown field `bitrat` at hardware.can; the keys there are bitrate, channel, "
            "data_bitrate, fd, interface",
            id="unknown key two levels down",
        ),
        pytest.param(
            BASE + "arming: maybe",
            "Invalid enum value 'maybe' at arming; found 'maybe'; allowed is at_start, on_request",
            id="wrong choice",
        ),
        pytest.param(
            BASE + "hardware: {type: sail}",
            "there is no drive family 'sail'; installed are cia402, hoverboard, moteus, odrive, vesc, wheel_board",
            id="wrong tag",
        ),
        pytest.param(
            BASE + "hardware: {can: {}}",
            "Object missing required field `type` at hardware; "
            "allowed is cia402, hoverboard, moteus, none, odrive, vesc, wheel_board",
            id="no tag",
        ),
        pytest.param(
            BASE + "ros: {node_name: 5}", "Expected `str`, got `int` at ros.node_name; found 5", id="wrong type"
        ),
        pytest.param(
            BASE + "setpoint: 3", "Expected `object`, got `int` at setpoint; found 3", id="value for a section"
        ),
        pytest.param("name: cart\nwiring: {}", "Object missing required field `model`", id="missing key at the top"),
        pytest.param(BASE + "simulation: {}", "Object missing required field `plant` at simulation", id="missing key"),
        pytest.param("", "Expected `object`, got `null`; found None", id="nothing at all"),
        pytest.param("- cart", "Expected `object`, got `array`; found ['cart']", id="a list"),
    ],
)
def test_error_names_the_place_and_what_is_allowed(text: str, message: str) -> None:
    assert refusal(text) == message


OUT_OF_RANGE = [
    ("hardware: {type: wheel_board, can: {bitrate: 9999}}", ">= 10000 at hardware.can.bitrate"),
    ("hardware: {type: wheel_board, can: {bitrate: 1000001}}", "<= 1000000 at hardware.can.bitrate"),
    ("hardware: {type: wheel_board, watchdog_s: 0.019}", ">= 0.02 at hardware.watchdog_s"),
    ("hardware: {type: wheel_board, watchdog_s: 0.051}", "<= 0.05 at hardware.watchdog_s"),
    ("setpoint: {timeout_s: 0.0}", "> 0.0 at setpoint.timeout_s"),
    ("setpoint: {stamp_tolerance_s: -0.1}", ">= 0.0 at setpoint.stamp_tolerance_s"),
    ("setpoint: {horizon_s: 0}", "> 0.0 at setpoint.horizon_s"),
]


@pytest.mark.parametrize(("line", "allowed"), OUT_OF_RANGE)
def test_out_of_range_error_names_the_place_and_the_bound(line: str, allowed: str) -> None:
    assert allowed in refusal(BASE + line)


def test_out_of_range_error_names_what_was_found() -> None:
    assert refusal(BASE + "hardware: {type: wheel_board, can: {bitrate: 7777}}") == (
        "Expected `int` >= 10000 at hardware.can.bitrate; found 7777"
    )


@pytest.mark.parametrize("key", ["timeout_s", "stamp_tolerance_s", "horizon_s"])
@pytest.mark.parametrize("value", [".inf", ".nan"])
def test_a_time_that_is_not_finite_is_refused(key: str, value: str) -> None:
    assert f" at setpoint.{key}; found " in refusal(BASE + f"setpoint: {{{key}: {value}}}")


def test_a_key_of_other_hardware_is_not_offered() -> None:
    assert "watchdog_s" not in refusal(BASE + "hardware: {type: none, can: {}}").partition("; the keys there are")[2]


def test_drives_as_0_1_had_them_are_refused_with_what_to_write() -> None:
    wheel = "{node_id: 1, max_torque: 1.0}"
    found = refusal(f"{BASE}hardware: {{type: odrive, left: {wheel}, right: {wheel}}}")
    assert found.endswith("write hardware.axes.left and hardware.axes.right")


@pytest.mark.parametrize("name", ["", "../x", "a/b", ".mcap", "a\\nb", "n" * 65])
def test_a_name_that_is_no_part_of_a_file_name_is_refused(name: str) -> None:
    assert " at name; found '" in refusal(BASE.replace("name: cart", f'name: "{name}"'))


def test_the_wrong_port_of_the_wiring_is_named() -> None:
    message = refusal(BASE.replace("{}", "{X: odometry.x, LeftVoltage: 5}"))
    assert message == "Expected `str | object`, got `int` at wiring.LeftVoltage; found 5"


def test_the_wrong_parameter_is_named() -> None:
    assert "Track" in refusal(BASE.replace("Cart'", "Cart', parameters: {Inertia: 1, Track: wide}"))


@pytest.mark.parametrize(
    "text",
    ["name: [", "a: b: c", "\x00", "name: !!python/object:os.system x", "name: 2024-13-45", "name: a\nname: b"],
)
def test_text_that_is_not_yaml_is_refused(text: str) -> None:
    assert refusal(text).startswith("robot.yaml is not YAML: ")


def test_missing_file_error_lists_the_packaged_robots() -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_robot("carl")
    text = f"cannot read robot file 'carl': No such file or directory; {PACKAGED}"
    assert str(caught.value) == text


def test_a_folder_is_no_robot_file(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError,
        match=rf"Is a directory; {PACKAGED}$",
    ):
        load_robot(str(tmp_path))


def test_what_is_not_text_is_no_robot_file(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"name: \xff\xfe")
    with pytest.raises(
        ConfigurationError,
        match=rf"not UTF-8 text; {PACKAGED}$",
    ):
        load_robot(str(path))
