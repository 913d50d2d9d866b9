# SPDX-License-Identifier: MIT
"""Model ports and states joined to the robot's signals, by name, once, before the first cycle."""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import LARGEST, Model, Variable, Write
from segway_ecc.node.safety.outputs import Given

SETPOINT_SIGNALS: Final = ("setpoint.linear_velocity", "setpoint.angular_velocity")
"""In the order of `Setpoint`: m/s, rad/s."""

ODOMETRY_SIGNALS: Final = (
    "odometry.x",
    "odometry.y",
    "odometry.heading",
    "odometry.linear_velocity",
    "odometry.angular_velocity",
)
"""Where the robot is and how it moves: m, m, rad, m/s, rad/s."""

JOINT_SIGNALS: Final = ("left.angle", "right.angle", "left.velocity", "right.velocity")
"""The wheels: rad, rad, rad/s, rad/s."""

IMU_SIGNALS: Final = (
    *(f"imu.angular_velocity_{axis}" for axis in "xyz"),
    *(f"imu.linear_acceleration_{axis}" for axis in "xyz"),
)
"""Angular velocity, rad/s, and specific force, m/s2, in the robot's axes."""

SUPPLY_SIGNAL: Final = "supply.voltage"
"""What feeds the motors: V."""

PUBLISHED_SIGNALS: Final = (*ODOMETRY_SIGNALS, *JOINT_SIGNALS, *IMU_SIGNALS, SUPPLY_SIGNAL)
"""What the robot can publish."""

SET: Final = "set."
"""Begins the name of a value that anybody may set: `set.force` is the topic `set/force`."""

VALID: Final = "valid."
"""Begins the name of whether a measured signal is fresh: `valid.left.angle` is 1.0 where it is, else 0.0."""

TOPIC: Final = "topic."
"""Begins the name of a topic that a variable is published on: `topic.energy` is the topic `energy`."""


@enum.unique
class Origin(enum.IntEnum):
    """Where a value comes from."""

    SENSOR = 0
    SETPOINT = 1
    SET = 2
    OUTPUT = 3
    VALIDITY = 4
    """Whether a sensor's value is fresh enough to be used."""


@dataclass(frozen=True, slots=True)
class SignalSource:
    """A place in the values of an origin."""

    origin: Origin
    index: int


@dataclass(frozen=True, slots=True)
class Wiring:
    """Indices into the sequences that pass through a cycle.

    Attributes:
        inputs: For each model input, where its value comes from.
        states: Artificial states, each with where the value comes from that is written to it.
        outputs: For each hardware command, the model output that drives it.
        published: For each published signal that is wired, where its value comes from.
        sensors: The sensor values that the model depends on.
        set_names: Names of the values that anybody may set.
        set_values: What they are before anybody did.
        set_ranges: The least and the largest value of each, which all that is wired to it allows.
        largest: The largest magnitude of each set-point that all that is wired to it allows: m/s, rad/s.
        topics: Topics that variables are published on, each with the variable.
        needs_validity: Whether an input of the model is the validity of a signal.
        given: Each signal and topic that an output of the model gives, with its place among the outputs and its unit.
    """

    inputs: tuple[SignalSource, ...]
    states: tuple[tuple[str, SignalSource], ...]
    outputs: tuple[int, ...]
    published: Mapping[str, SignalSource]
    sensors: tuple[int, ...]
    set_names: tuple[str, ...]
    set_values: tuple[float, ...]
    set_ranges: Sequence[tuple[float, float]]
    largest: Setpoint
    topics: Mapping[str, str]
    needs_validity: bool
    given: Mapping[str, Given]

    def model_inputs(self, sensors: Sensors, setpoint: Setpoint, set_values: Sequence[float]) -> list[float]:
        """The model's inputs in port order."""
        validity = tuple(map(float, sensors.valid)) if self.needs_validity else ()
        pools = (sensors.values, setpoint, set_values, (), validity)
        return [pools[s.origin][s.index] for s in self.inputs]

    def state_writes(self, setpoint: Setpoint, set_values: Sequence[float]) -> list[tuple[str, float]]:
        """What is written to which state."""
        pools = ((), setpoint, set_values)
        return [(state, pools[s.origin][s.index]) for state, s in self.states]

    def states_of(self, place: int) -> list[str]:
        """The states that a value is written to which anybody may set, by its place among `set_names`."""
        return [state for state, s in self.states if s.origin is Origin.SET and s.index == place]

    def commands(self, y: Sequence[float]) -> list[float]:
        """The hardware's commands in its order."""
        return [y[index] for index in self.outputs]

    def publish(self, sensors: Sensors, y: Sequence[float]) -> list[float]:
        """The published signals that are wired, in the order of `published`; what was measured too long ago is NaN."""
        sensor, values, valid = Origin.SENSOR, sensors.values, sensors.valid
        return [
            y[s.index] if s.origin is not sensor else values[s.index] if valid[s.index] else math.nan
            for s in self.published.values()
        ]


def wire(
    model: Model, hardware: Hardware, wiring: Mapping[str, str], declared: Mapping[str, Variable] | None = None
) -> Wiring:
    """Join a model to hardware and set-points; `wiring` is the robot's signal for each port, state or other variable.

    `declared` are those of them whose range is another one than the model's; see `declared_variables`.

    Raises:
        UnknownNameError: A name that does not exist; the text lists those that do.
        ConfigurationError: A port or command left open, or wired twice, or to a signal of the wrong direction; or the
            ranges of what is wired to a signal leave nothing of it.
    """
    variables = {v.name: v for v in (*model.inputs, *model.outputs, *model.states, *model.parameters)}
    for port in wiring:
        if port not in variables:
            raise UnknownNameError(f"port, state or parameter of model '{model.name}'", port, variables)
    variables |= declared or {}
    topics = {signal.removeprefix(TOPIC): port for port, signal in wiring.items() if signal.startswith(TOPIC)}
    joined = {port: signal for port, signal in wiring.items() if not signal.startswith(TOPIC)}
    set_from = {signal: variables[port].value for port, signal in joined.items() if signal.startswith(SET)}
    inputs = tuple(_input(v.name, joined, hardware, list(set_from)) for v in model.inputs)
    output_of = _outputs(model, joined, hardware)
    for variable in model.parameters:
        if variable.name in joined:
            raise ConfigurationError(
                f"wiring: parameter '{variable.name}' can only be published, as {TOPIC}<name>; set it under "
                "model.parameters, or while the robot runs as a ROS parameter"
            )
    for command in hardware.commands:
        if command not in output_of:
            names = ", ".join(v.name for v in model.outputs)
            raise ConfigurationError(f"wiring: nothing drives '{command}'; the model's outputs are {names}")
    sources = {signal: SignalSource(Origin.SENSOR, place) for place, signal in enumerate(hardware.signals)}
    sources |= {signal: SignalSource(Origin.OUTPUT, place) for signal, place in output_of.items()}
    places = {variable.name: place for place, variable in enumerate(model.outputs)}
    given = output_of | {f"{TOPIC}{topic}": places[name] for topic, name in topics.items() if name in places}
    return Wiring(
        inputs=inputs,
        states=tuple(_state(v, joined[v.name], list(set_from)) for v in model.states if v.name in joined),
        outputs=tuple(output_of[command] for command in hardware.commands),
        published={signal: sources[signal] for signal in PUBLISHED_SIGNALS if signal in sources},
        sensors=tuple(sorted({source.index for source in inputs if source.origin is Origin.SENSOR})),
        set_names=tuple(signal.removeprefix(SET) for signal in set_from),
        set_values=tuple(set_from.values()),
        set_ranges=[_range(signal, joined, variables) for signal in set_from],
        largest=Setpoint(*(_largest(signal, joined, variables) for signal in SETPOINT_SIGNALS)),
        topics=topics,
        needs_validity=any(source.origin is Origin.VALIDITY for source in inputs),
        given={signal: Given(place, model.outputs[place].unit) for signal, place in given.items()},
    )


def _range(signal: str, joined: Mapping[str, str], variables: Mapping[str, Variable]) -> tuple[float, float]:
    """The range of a signal that inputs and states of the model are wired to: what all of them allow."""
    wired = [variables[port] for port, other in joined.items() if other == signal]
    low, high = max((v.minimum for v in wired), default=-LARGEST), min((v.maximum for v in wired), default=LARGEST)
    if low > high:
        raise ConfigurationError(f"wiring: no value of '{signal}' is in the range of all that is wired to it")
    return low, high


def _largest(signal: str, joined: Mapping[str, str], variables: Mapping[str, Variable]) -> float:
    low, high = _range(signal, joined, variables)
    if low > 0.0 or high < 0.0:
        raise ConfigurationError(f"wiring: '{signal}' is zero at rest, which the range of what is wired to it forbids")
    largest = min(-low, high)
    return math.inf if largest == LARGEST else largest


def _from_outside(signal: str, set_signals: Sequence[str]) -> SignalSource | None:
    """The source of a set-point or a value that anybody may set; None for any other signal."""
    if signal in SETPOINT_SIGNALS:
        return SignalSource(Origin.SETPOINT, SETPOINT_SIGNALS.index(signal))
    return SignalSource(Origin.SET, set_signals.index(signal)) if signal in set_signals else None


def _input(port: str, wiring: Mapping[str, str], hardware: Hardware, set_signals: Sequence[str]) -> SignalSource:
    known = [*hardware.signals, *SETPOINT_SIGNALS, f"{SET}<name>", f"{VALID}<signal>"]
    if port not in wiring:
        raise ConfigurationError(f"wiring: model input '{port}' is wired to nothing; it can take {', '.join(known)}")
    signal = wiring[port]
    source = _from_outside(signal, set_signals)
    if source is not None:
        return source
    measured = signal.removeprefix(VALID)
    if measured not in hardware.signals:
        raise UnknownNameError(f"signal for model input '{port}'", signal, known)
    origin = Origin.SENSOR if signal == measured else Origin.VALIDITY
    return SignalSource(origin, list(hardware.signals).index(measured))


def _state(state: Variable, signal: str, set_signals: Sequence[str]) -> tuple[str, SignalSource]:
    if state.write is not Write.NOW:
        raise ConfigurationError(f"wiring: state '{state.name}' cannot be written while the model runs")
    source = _from_outside(signal, set_signals)
    if source is None:
        known = [*SETPOINT_SIGNALS, f"{SET}<name>", f"{TOPIC}<name>"]
        raise UnknownNameError(f"set-point for model state '{state.name}'", signal, known)
    return state.name, source


def _outputs(model: Model, wiring: Mapping[str, str], hardware: Hardware) -> dict[str, int]:
    """The place of the model output that drives each signal."""
    # Measured signals are published as measured; a model may stand in for those that no hardware measures.
    known = [*hardware.commands, *(s for s in PUBLISHED_SIGNALS if s not in hardware.signals), f"{TOPIC}<name>"]
    names = [v.name for v in model.outputs]
    found: dict[str, int] = {}
    for port, signal in wiring.items():
        if port not in names:
            continue
        if signal not in known:
            raise UnknownNameError(f"signal for model output '{port}'", signal, known)
        if signal in found:
            raise ConfigurationError(f"wiring: '{names[found[signal]]}' and '{port}' both drive '{signal}'; keep one")
        found[signal] = names.index(port)
    return found
