# SPDX-License-Identifier: MIT
"""The lengths of a robot, which stand in its file once: in its checks, its mixing, its model and its plant."""

import msgspec
import pytest

from segway_ecc.node.config import RobotFile, convert_robot, decode_robot, load_robot, packaged_robots
from segway_ecc.node.cycle.mixing import WiredSignal
from segway_ecc.node.errors import ConfigurationError

GEOMETRY = "geometry: {wheel_radius: 0.05, track: 0.3}\n"
BASE = "name: cart\nmodel: {source: 'segway_ecc.node.models.cart:CartTorqueController'}\n"
FOLLOWING = "safety: {following_error: {linear_window: 0.3}}\n"


def decoded(text: str, wiring: str = "{}") -> RobotFile:
    return decode_robot(f"{BASE}wiring: {wiring}\n{text}", "robot.yaml")


def test_a_check_has_the_lengths_of_the_geometry() -> None:
    safety = decoded(GEOMETRY + FOLLOWING).safety
    assert safety is not None
    assert safety.following_error is not None
    assert (safety.following_error.track, safety.following_error.wheel_radius) == (0.3, 0.05)


def test_a_length_of_a_check_is_its_own() -> None:
    safety = decoded(GEOMETRY + "safety: {runaway: {wheel_radius: 0.06, distance_m: 1.0}}").safety
    assert safety is not None
    assert safety.runaway is not None
    assert safety.runaway.wheel_radius == 0.06


def test_a_check_without_any_length_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"missing required field `track` at safety\.following_error"):
        decoded("geometry: {wheel_radius: 0.05}\n" + FOLLOWING)


def test_parameters_of_model_and_plant_that_are_wired_to_a_length_have_it() -> None:
    plant = "segway_ecc.hil.plants.cart:CartTorquePlant"
    file = decoded(
        f"{GEOMETRY}simulation: {{plant: '{plant}', wiring: {{WheelRadius: geometry.wheel_radius}}}}",
        "{Track: geometry.track, AssumedTrack: {signal: geometry.track, gain: 1000.0, offset: 5.0}, X: odometry.x}",
    )
    assert file.model.parameters == {"Track": 0.3, "AssumedTrack": 305.0}
    assert file.wiring == {"X": "odometry.x"}
    assert file.simulation is not None
    assert (file.simulation.parameters, file.simulation.wiring) == ({"WheelRadius": 0.05}, {})


def test_a_parameter_that_is_set_has_what_it_is_set_to() -> None:
    text = BASE.replace("Controller'}", "Controller', parameters: {Track: 0.31}}")
    file = decode_robot(f"{text}{GEOMETRY}wiring: {{Track: geometry.track}}", "robot.yaml")
    assert file.model.parameters == {"Track": 0.31}


@pytest.mark.parametrize("name", ["imu_height", "length"])
def test_a_length_that_is_not_there_is_named(name: str) -> None:
    message = rf"^robot\.yaml: wiring\.Track: there is no geometry\.{name} in this robot file$"
    with pytest.raises(ConfigurationError, match=message):
        decoded(GEOMETRY, f"{{Track: geometry.{name}}}")


def test_a_mixing_without_its_lengths_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"^robot\.yaml: mixing\.base needs geometry\.wheel_radius and"):
        decoded("mixing: {base: {type: differential}}")


@pytest.mark.parametrize("name", ["odometry", "imu"])
def test_a_mixing_is_called_as_nothing_else(name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"no axis can be called '{name}'"):
        decoded(f"{GEOMETRY}mixing: {{{name}: {{type: differential}}}}")


def test_a_port_is_wired_by_a_name_or_with_gain_and_offset() -> None:
    file = decoded("", "{X: odometry.x, Y: {signal: odometry.y, gain: 0.001}}")
    assert file.wiring == {"X": "odometry.x", "Y": WiredSignal(signal="odometry.y", gain=0.001)}


@pytest.mark.parametrize("name", packaged_robots())
def test_a_robot_is_the_same_after_it_was_written_into_a_log(name: str) -> None:
    file = load_robot(name)
    assert convert_robot(msgspec.to_builtins(file), "log") == file
