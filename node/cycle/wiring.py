"""Model ports and states joined to the robot's signals, by name, once, before the first cycle."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from firmware_io.hardware import Hardware, Sensors
from node.cycle.setpoints import Setpoint
from node.errors import ConfigurationError, UnknownNameError
from node.model.model import Model
from node.model.variables import Variable, Write

SETPOINT_SIGNALS: Final = ("setpoint.linear_velocity", "setpoint.angular_velocity")
"""In the order of `Setpoint`: m/s, rad/s."""

PUBLISHED_SIGNALS: Final = (
    "odometry.x",
    "odometry.y",
    "odometry.heading",
    "odometry.linear_velocity",
    "odometry.angular_velocity",
    "left.angle",
    "right.angle",
    "left.velocity",
    "right.velocity",
)
"""What the robot can tell the world: m, m, rad, m/s, rad/s, rad, rad, rad/s, rad/s."""


@dataclass(frozen=True, slots=True)
class Wiring:
    """Indices into the sequences that pass through a cycle.

    Attributes:
        inputs: For each model input, where its value comes from.
        states: Artificial states, each with the set-point that is written to it.
        outputs: For each hardware command, the model output that drives it.
        published: For each published signal that is wired, where its value comes from.
        sensors: The sensor values that the model depends on.
    """

    inputs: tuple["Source", ...]
    states: tuple[tuple[str, int], ...]
    outputs: tuple[int, ...]
    published: Mapping[str, "Source"]
    sensors: tuple[int, ...]

    def model_inputs(self, sensors: Sensors, setpoint: Setpoint) -> list[float]:
        """The model's inputs in port order."""
        return [(sensors.values if s.of_sensor else setpoint)[s.index] for s in self.inputs]

    def commands(self, y: Sequence[float]) -> list[float]:
        """The hardware's commands in its order."""
        return [y[index] for index in self.outputs]

    def publish(self, sensors: Sensors, y: Sequence[float]) -> list[float]:
        """The published signals that are wired, in the order of `published`."""
        return [(sensors.values if s.of_sensor else y)[s.index] for s in self.published.values()]


@dataclass(frozen=True, slots=True)
class Source:
    """A place in the sensors' values or, where not `of_sensor`, in set-point (for inputs) or model outputs."""

    of_sensor: bool
    index: int


def wire(model: Model, hardware: Hardware, wiring: Mapping[str, str]) -> Wiring:
    """Join a model to hardware and set-points.

    Args:
        model: The model.
        hardware: The hardware.
        wiring: The robot's signal for each model port or state.

    Raises:
        UnknownNameError: A name that does not exist; the text lists those that do.
        ConfigurationError: A port or command left open, or wired twice, or to a signal of the wrong direction.
    """
    ports = {v.name: v for v in (*model.inputs, *model.outputs, *model.states)}
    for port in wiring:
        if port not in ports:
            raise UnknownNameError(f"port or state of model '{model.name}'", port, ports)
    outputs = _names(model.outputs)
    driven = {port: signal for port, signal in wiring.items() if port in outputs}
    inputs = tuple(_input(v.name, wiring, hardware) for v in model.inputs)
    _check_outputs(driven, hardware)
    return Wiring(
        inputs=inputs,
        states=tuple(_state(v, wiring[v.name]) for v in model.states if v.name in wiring),
        outputs=tuple(_driver(command, driven, outputs) for command in hardware.commands),
        published=_published(driven, outputs, hardware),
        sensors=tuple(sorted({source.index for source in inputs if source.of_sensor})),
    )


def _names(variables: Iterable[Variable]) -> list[str]:
    return [v.name for v in variables]


def _input(port: str, wiring: Mapping[str, str], hardware: Hardware) -> Source:
    known = [*hardware.signals, *SETPOINT_SIGNALS]
    if port not in wiring:
        raise ConfigurationError(f"wiring: model input '{port}' is wired to nothing; it can take {', '.join(known)}")
    signal = wiring[port]
    if signal in SETPOINT_SIGNALS:
        return Source(of_sensor=False, index=SETPOINT_SIGNALS.index(signal))
    if signal not in hardware.signals:
        raise UnknownNameError(f"signal for model input '{port}'", signal, known)
    return Source(of_sensor=True, index=list(hardware.signals).index(signal))


def _state(state: Variable, signal: str) -> tuple[str, int]:
    if state.write is not Write.NOW:
        raise ConfigurationError(f"wiring: state '{state.name}' cannot be written while the model runs")
    if signal not in SETPOINT_SIGNALS:
        raise UnknownNameError(f"set-point for model state '{state.name}'", signal, SETPOINT_SIGNALS)
    return state.name, SETPOINT_SIGNALS.index(signal)


def _check_outputs(driven: Mapping[str, str], hardware: Hardware) -> None:
    # Measured signals are published as measured; a model may stand in for those that no hardware measures.
    known = [*hardware.commands, *(s for s in PUBLISHED_SIGNALS if s not in hardware.signals)]
    owners: dict[str, str] = {}
    for port, signal in driven.items():
        if signal not in known:
            raise UnknownNameError(f"signal for model output '{port}'", signal, known)
        if signal in owners:
            raise ConfigurationError(f"wiring: '{owners[signal]}' and '{port}' both drive '{signal}'; keep one")
        owners[signal] = port


def _driver(command: str, driven: Mapping[str, str], outputs: Sequence[str]) -> int:
    for port, signal in driven.items():
        if signal == command:
            return outputs.index(port)
    raise ConfigurationError(f"wiring: nothing drives '{command}'; the model's outputs are {', '.join(outputs)}")


def _published(driven: Mapping[str, str], outputs: Sequence[str], hardware: Hardware) -> dict[str, Source]:
    port_of = {signal: port for port, signal in driven.items()}
    sensors = list(hardware.signals)
    published: dict[str, Source] = {}
    for signal in PUBLISHED_SIGNALS:
        if signal in port_of:
            published[signal] = Source(of_sensor=False, index=outputs.index(port_of[signal]))
        elif signal in sensors:
            published[signal] = Source(of_sensor=True, index=sensors.index(signal))
    return published
