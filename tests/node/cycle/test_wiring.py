# SPDX-License-Identifier: MIT
import math
from collections.abc import Mapping

import pytest

from segway_ecc.firmware_io.hardware import NoHardware, Sensors
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.signals import published_signals
from segway_ecc.node.cycle.sources import Origin, SignalSource
from segway_ecc.node.cycle.wiring import wire
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import SectionedModel
from segway_ecc.testing import RecordingHardware


class Driver(SectionedModel):
    name = "driver"
    step_size = 0.01
    inputs = (Variable("Speed", "rad/s"), Variable("Wanted", "m/s"))
    outputs = (Variable("Spare"), Variable("Right", "V"), Variable("X", "m"), Variable("Left", "V"))
    parameters = (Variable("Gain"),)
    states = (Variable("Turn", "rad/s", 0.0, Write.NOW), Variable("Fixed"))


WIRING = {
    "Speed": "right.velocity",
    "Wanted": "setpoint.linear_velocity",
    "Turn": "setpoint.angular_velocity",
    "Left": "left.voltage",
    "Right": "right.voltage",
    "X": "odometry.x",
}
INPUTS = (
    "left.velocity, right.velocity, setpoint.linear_velocity, setpoint.angular_velocity, set.<name>, valid.<signal>"
)
OUTPUTS = (
    "left.voltage, right.voltage, odometry.x, odometry.y, odometry.heading, odometry.linear_velocity, "
    "odometry.angular_velocity, left.angle, right.angle, imu.angular_velocity_x, imu.angular_velocity_y, "
    "imu.angular_velocity_z, imu.linear_acceleration_x, imu.linear_acceleration_y, imu.linear_acceleration_z, "
    "supply.voltage, topic.<name>"
)


@pytest.fixture
def hardware() -> RecordingHardware:
    signals = {"left.velocity": "rad/s", "right.velocity": "rad/s"}
    return RecordingHardware(signals, {"left.voltage": "V", "right.voltage": "V"}, (30.0, 30.0))


def without(*ports: str) -> dict[str, str]:
    return {port: signal for port, signal in WIRING.items() if port not in ports}


def test_every_port_is_joined_to_its_signal(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, WIRING)
    assert wiring.inputs == (SignalSource(Origin.SENSOR, 1), SignalSource(Origin.SETPOINT, 0))
    assert wiring.states == (("Turn", SignalSource(Origin.SETPOINT, 1)),)
    assert wiring.outputs == (3, 1)
    assert wiring.sensors == (1,)


def test_values_take_the_way_of_the_wiring(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, WIRING)
    sensors, y = Sensors((7.0, 8.0), (0.0, 0.0), (True, True)), [0.0, 1.0, 2.0, 3.0]
    assert wiring.model_inputs(sensors, Setpoint(0.5, 0.25), ()) == [8.0, 0.5]
    assert wiring.state_writes(Setpoint(0.5, 0.25), ()) == [("Turn", 0.25)]
    assert wiring.commands(y) == [3.0, 1.0]
    assert dict(zip(wiring.published, wiring.publish(sensors, y), strict=True)) == {
        "odometry.x": 2.0,
        "left.velocity": 7.0,
        "right.velocity": 8.0,
    }


def test_stale_signals_are_published_as_nan(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, WIRING)
    sensors = Sensors((7.0, 8.0), (0.0312, 0.0), (False, True))
    odometry, left, right = wiring.publish(sensors, [0.0, 1.0, 2.0, 3.0])
    assert (odometry, right) == (2.0, 8.0)
    assert math.isnan(left)


def test_what_is_published_keeps_its_order_whatever_that_of_the_file(hardware: RecordingHardware) -> None:
    backwards = dict(reversed((WIRING | {"Spare": "odometry.heading"}).items()))
    published = list(wire(Driver(), hardware, backwards).published)
    assert published == ["odometry.x", "odometry.heading", "left.velocity", "right.velocity"]
    assert published == [signal for signal in published_signals(hardware.signals) if signal in published]


def test_torques_are_published_where_the_drive_of_every_axis_measures_them() -> None:
    axes = ("pan", "tilt")
    signals = [f"{axis}.{value}" for axis in axes for value in ("angle", "velocity", "torque")]
    joints = ("pan.angle", "tilt.angle", "pan.velocity", "tilt.velocity")
    assert published_signals(signals)[5:] == (*joints, *published_signals(())[9:], "pan.torque", "tilt.torque")
    assert published_signals(signals[:-1])[5:] == (*joints, *published_signals(())[9:])


def test_an_imu_is_published_whether_or_not_the_model_takes_it() -> None:
    names = [f"imu.{quantity}_{axis}" for quantity in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    signals = dict.fromkeys([*reversed(names), "left.velocity", "right.velocity"], "")
    imu = RecordingHardware(signals, {"left.voltage": "V", "right.voltage": "V"}, (30.0, 30.0))
    wiring = wire(Driver(), imu, WIRING)
    assert list(wiring.published) == ["odometry.x", "left.velocity", "right.velocity", *names]
    sensors = Sensors((6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 7.0, 8.0), (0.0,) * 8, (True,) * 8)
    assert wiring.publish(sensors, [0.0, 1.0, 9.0, 3.0]) == [9.0, 7.0, 8.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert wiring.sensors == (7,)


def test_an_output_and_a_state_may_be_left_open(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, without("X", "Turn"))
    assert wiring.states == ()
    assert "odometry.x" not in wiring.published


def test_inputs_and_states_can_take_values_that_anybody_may_set(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, WIRING | {"Wanted": "set.speed", "Turn": "set.turn.rate"})
    assert (wiring.set_names, wiring.set_values) == (("speed", "turn.rate"), (0.0, 0.0))
    sensors = Sensors((7.0, 8.0), (0.0, 0.0), (True, True))
    assert wiring.model_inputs(sensors, Setpoint(0.5, 0.25), (1.5, -2.0)) == [8.0, 1.5]
    assert wiring.state_writes(Setpoint(0.5, 0.25), (1.5, -2.0)) == [("Turn", -2.0)]


def test_any_variable_can_be_published_on_a_topic_of_its_own(hardware: RecordingHardware) -> None:
    named = WIRING | {"Spare": "topic.spare", "Gain": "topic.gain", "Fixed": "topic.inner.fixed"}
    wiring = wire(Driver(), hardware, named)
    assert wiring.topics == {"spare": "Spare", "gain": "Gain", "inner.fixed": "Fixed"}
    assert wiring.outputs == (3, 1)


def test_without_hardware_a_model_may_stand_in_for_what_would_be_measured() -> None:
    wiring = {"Speed": "setpoint.linear_velocity", "Wanted": "setpoint.linear_velocity", "X": "left.velocity"}
    wired = wire(Driver(), NoHardware(), wiring)
    assert wired.published == {"left.velocity": SignalSource(Origin.OUTPUT, 2)}
    assert (wired.outputs, wired.sensors) == ((), ())


def test_a_sensor_that_two_inputs_take_is_watched_once(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, WIRING | {"Wanted": "right.velocity"})
    assert wiring.sensors == (1,)


@pytest.mark.parametrize(
    ("wiring", "text"),
    [
        pytest.param(
            WIRING | {"Z": "odometry.y"},
            "no port, state or parameter of model 'driver' is called 'Z'; there is Speed, Wanted, Spare, "
            "Right, X, Left, Turn, Fixed, Gain",
            id="unknown port",
        ),
        pytest.param(
            WIRING | {"Speed": "middle.velocity"},
            f"no signal for model input 'Speed' is called 'middle.velocity'; there is {INPUTS}",
            id="unknown sensor",
        ),
        pytest.param(
            WIRING | {"Speed": "left.voltage"},
            f"no signal for model input 'Speed' is called 'left.voltage'; there is {INPUTS}",
            id="input from a command",
        ),
        pytest.param(
            WIRING | {"Turn": "left.velocity"},
            "no set-point for model state 'Turn' is called 'left.velocity'; there is setpoint.linear_velocity, "
            "setpoint.angular_velocity, set.<name>, topic.<name>",
            id="state from a sensor",
        ),
        pytest.param(
            WIRING | {"X": "odometry.z"},
            f"no signal for model output 'X' is called 'odometry.z'; there is {OUTPUTS}",
            id="unknown published signal",
        ),
        pytest.param(
            WIRING | {"X": "left.velocity"},
            f"no signal for model output 'X' is called 'left.velocity'; there is {OUTPUTS}",
            id="output to what is measured",
        ),
        pytest.param(
            WIRING | {"X": "setpoint.linear_velocity"},
            f"no signal for model output 'X' is called 'setpoint.linear_velocity'; there is {OUTPUTS}",
            id="output to a set-point",
        ),
    ],
)
def test_a_name_that_does_not_exist_is_refused_with_those_that_do(
    hardware: RecordingHardware, wiring: Mapping[str, str], text: str
) -> None:
    with pytest.raises(UnknownNameError) as caught:
        wire(Driver(), hardware, wiring)
    assert str(caught.value) == text


@pytest.mark.parametrize(
    ("wiring", "text"),
    [
        pytest.param(
            without("Speed"), f"wiring: model input 'Speed' is wired to nothing; it can take {INPUTS}", id="open input"
        ),
        pytest.param(
            without("Left"),
            "wiring: nothing drives 'left.voltage'; the model's outputs are Spare, Right, X, Left",
            id="open command",
        ),
        pytest.param(
            WIRING | {"Spare": "left.voltage"},
            "wiring: 'Left' and 'Spare' both drive 'left.voltage'; keep one",
            id="command driven twice",
        ),
        pytest.param(
            WIRING | {"Spare": "odometry.x"},
            "wiring: 'X' and 'Spare' both drive 'odometry.x'; keep one",
            id="published twice",
        ),
        pytest.param(
            WIRING | {"Gain": "setpoint.linear_velocity"},
            "wiring: parameter 'Gain' can only be published, as topic.<name>; set it under model.parameters, or while "
            "the robot runs as a ROS parameter",
            id="parameter",
        ),
        pytest.param(
            WIRING | {"Fixed": "setpoint.linear_velocity"},
            "wiring: state 'Fixed' cannot be written while the model runs",
            id="state that is not artificial",
        ),
    ],
)
def test_wiring_that_cannot_work_is_refused(hardware: RecordingHardware, wiring: Mapping[str, str], text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        wire(Driver(), hardware, wiring)
    assert str(caught.value) == text


def test_a_model_may_take_the_validity_of_a_signal_as_an_input(hardware: RecordingHardware) -> None:
    wiring = wire(Driver(), hardware, WIRING | {"Wanted": "valid.left.velocity"})
    taken = [
        wiring.model_inputs(Sensors((7.0, 8.0), (0.0, 0.0), (is_valid, True)), Setpoint(0.0, 0.0), ())
        for is_valid in (True, False)
    ]
    assert taken == [[8.0, 1.0], [8.0, 0.0]]
    assert wiring.sensors == (1,)


def test_the_validity_of_what_is_not_measured_is_refused(hardware: RecordingHardware) -> None:
    with pytest.raises(UnknownNameError, match=r"valid\.tilt"):
        wire(Driver(), hardware, WIRING | {"Wanted": "valid.tilt"})
