# SPDX-License-Identifier: MIT
"""Model ports and states joined to the robot's signals, by name, once, before the first cycle."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.mixing import Mixer, WiredSignal, wired_signal
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.signals import SET, SETPOINT_SIGNALS, TOPIC, published_signals
from segway_ecc.node.cycle.sources import Inputs, Origin, Outputs, Outside, SignalSource, Sum
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import LARGEST, Model, Variable
from segway_ecc.node.safety.monitor import TWO_WHEELS
from segway_ecc.node.safety.outputs import Given


@dataclass(frozen=True, slots=True)
class Wiring:
    """Indices into the sequences that pass through a cycle.

    Attributes:
        inputs: For each model input, where its value comes from.
        states: Artificial states, each with where the value comes from that is written to it.
        outputs: For each hardware command, the model output that drives it; behind the outputs are their sums.
        published: For each published signal that is wired, where its value comes from.
        sensors: The sensor values that the model depends on.
        set_names: Names of the values that anybody may set.
        set_values: What they are before anybody did.
        set_ranges: The least and the largest value of each, which all that is wired to it allows.
        largest: The largest magnitude of each set-point that all that is wired to it allows: m/s, rad/s.
        topics: Topics that variables are published on, each with the variable.
        needs_validity: Whether an input of the model is the validity of a signal.
        given: Each signal and topic that an output of the model gives, with its place among the outputs, behind which
            are their sums, and its unit.
        input_sums: What inputs take that is more than a signal as it is.
        state_sums: The same of states.
        output_sums: What signals are given that is more than an output as it is.
        wheels: The axes of the left and the right wheel of each pair that the robot drives on.
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
    input_sums: tuple[Sum, ...] = ()
    state_sums: tuple[Sum, ...] = ()
    output_sums: tuple[Sum, ...] = ()
    wheels: Sequence[tuple[str, str]] = TWO_WHEELS

    def model_inputs(self, sensors: Sensors, setpoint: Setpoint, set_values: Sequence[float]) -> list[float]:
        """The model's inputs in port order."""
        validity = tuple(map(float, sensors.valid)) if self.needs_validity else ()
        pools: tuple[Sequence[float], ...] = (sensors.values, setpoint, set_values, (), validity)
        if self.input_sums:
            pools = (*pools, [each.of(pools) for each in self.input_sums])
        return [pools[s.origin][s.index] for s in self.inputs]

    def state_writes(self, setpoint: Setpoint, set_values: Sequence[float]) -> list[tuple[str, float]]:
        """What is written to which state."""
        pools: tuple[Sequence[float], ...] = ((), setpoint, set_values)
        if self.state_sums:
            pools = (*pools, (), (), [each.of(pools) for each in self.state_sums])
        return [(state, pools[s.origin][s.index]) for state, s in self.states]

    def writes_of(self, place: int, value: float) -> list[tuple[str, float]]:
        """What is written to which states for a value that anybody may set, by its place among `set_names`."""
        own, writes = SignalSource(Origin.SET, place), []
        for state, source in self.states:
            if source == own:
                writes.append((state, value))
            elif source.origin is Origin.SUM:
                found = self.state_sums[source.index]
                writes += [(state, found.offset + term.factor * value) for term in found.terms if term.source == own]
        return writes

    def with_sums(self, y: Sequence[float]) -> Sequence[float]:
        """The model's outputs, and behind them their sums."""
        if not self.output_sums:
            return y
        pools = ((), (), (), y)
        return [*y, *(each.of(pools) for each in self.output_sums)]

    def commands(self, y: Sequence[float]) -> list[float]:
        """The hardware's commands in its order."""
        y = self.with_sums(y)
        return [y[index] for index in self.outputs]

    def publish(self, sensors: Sensors, y: Sequence[float]) -> list[float]:
        """The published signals that are wired, in the order of `published`; what was measured too long ago is NaN."""
        sensor, values, valid = Origin.SENSOR, sensors.values, sensors.valid
        y = self.with_sums(y)
        return [
            y[s.index] if s.origin is not sensor else values[s.index] if valid[s.index] else math.nan
            for s in self.published.values()
        ]


def wire(
    model: Model,
    hardware: Hardware,
    wiring: Mapping[str, str | WiredSignal],
    declared: Mapping[str, Variable] | None = None,
    mixers: Sequence[Mixer] = (),
) -> Wiring:
    """Join a model to hardware and set-points.

    Args:
        model: The model.
        hardware: The hardware.
        wiring: The robot's signal for each port, state or other variable.
        declared: Those of them whose range is another one than the model's; see `declared_variables`.
        mixers: What ports can be wired to beside signals; see `controller_mixers`.

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
    wired = {port: wired_signal(entry) for port, entry in wiring.items()}
    topics, joined = _topics(wired), {port: entry for port, entry in wired.items() if not _is_topic(entry)}
    set_from = {
        entry.signal: (variables[port].value - entry.offset) / entry.gain
        for port, entry in joined.items()
        if entry.signal.startswith(SET)
    }
    outside, inputs = Outside(list(set_from), mixers), Inputs(hardware, list(set_from), mixers)
    input_sources = tuple(inputs.input(v.name, joined) for v in model.inputs)
    states = tuple(outside.state(v, joined[v.name]) for v in model.states if v.name in joined)
    outputs = Outputs(model, joined, hardware, mixers)
    for variable in model.parameters:
        if variable.name in joined:
            raise ConfigurationError(
                f"wiring: parameter '{variable.name}' can only be published, as {TOPIC}<name>; set it under "
                "model.parameters, or while the robot runs as a ROS parameter"
            )
    for command in hardware.commands:
        if command not in outputs.places:
            names = ", ".join(v.name for v in model.outputs)
            raise ConfigurationError(f"wiring: nothing drives '{command}'; the model's outputs are {names}")
    sources = {signal: SignalSource(Origin.SENSOR, place) for place, signal in enumerate(hardware.signals)}
    sources |= {signal: SignalSource(Origin.OUTPUT, place) for signal, place in outputs.places.items()}
    places = {variable.name: place for place, variable in enumerate(model.outputs)}
    of_topics = {f"{TOPIC}{topic}": places[name] for topic, name in topics.items() if name in places}
    used = [*input_sources, *(term.source for each in inputs.sums for term in each.terms)]
    return Wiring(
        inputs=input_sources,
        states=states,
        outputs=tuple(outputs.places[command] for command in hardware.commands),
        published={signal: sources[signal] for signal in published_signals(hardware.signals) if signal in sources},
        sensors=tuple(sorted({source.index for source in used if source.origin is Origin.SENSOR})),
        set_names=tuple(signal.removeprefix(SET) for signal in set_from),
        set_values=tuple(set_from.values()),
        set_ranges=[_range(signal, joined, variables) for signal in set_from],
        largest=Setpoint(*(_largest(signal, joined, variables) for signal in SETPOINT_SIGNALS)),
        topics=topics,
        needs_validity=any(source.origin is Origin.VALIDITY for source in used),
        given={
            signal: Given(place, outputs.unit(signal, place)) for signal, place in (outputs.places | of_topics).items()
        },
        input_sums=tuple(inputs.sums),
        state_sums=tuple(outside.sums),
        output_sums=tuple(outputs.sums),
        wheels=[pair for mixer in mixers for pair in mixer.wheels] or TWO_WHEELS,
    )


def _is_topic(entry: WiredSignal) -> bool:
    return entry.signal.startswith(TOPIC)


def _topics(wired: Mapping[str, WiredSignal]) -> dict[str, str]:
    """The variable of each topic."""
    for port, entry in wired.items():
        if _is_topic(entry) and not entry.is_plain:
            raise ConfigurationError(
                f"wiring: '{port}' is published on {entry.signal} as it is: leave gain and offset out"
            )
    return {entry.signal.removeprefix(TOPIC): port for port, entry in wired.items() if _is_topic(entry)}


def _range(signal: str, joined: Mapping[str, WiredSignal], variables: Mapping[str, Variable]) -> tuple[float, float]:
    """The range of a signal that inputs and states of the model are wired to: what all of them allow."""
    ranges = [_allowed(entry, variables[port]) for port, entry in joined.items() if entry.signal == signal]
    low, high = max((low for low, _ in ranges), default=-LARGEST), min((high for _, high in ranges), default=LARGEST)
    if low > high:
        raise ConfigurationError(f"wiring: no value of '{signal}' is in the range of all that is wired to it")
    return low, high


def _allowed(entry: WiredSignal, variable: Variable) -> tuple[float, float]:
    """What of its signal a variable allows."""
    if entry.is_plain:
        return variable.minimum, variable.maximum
    ends = [
        math.copysign(LARGEST, bound * entry.gain) if abs(bound) == LARGEST else (bound - entry.offset) / entry.gain
        for bound in (variable.minimum, variable.maximum)
    ]
    return min(ends), max(ends)


def _largest(signal: str, joined: Mapping[str, WiredSignal], variables: Mapping[str, Variable]) -> float:
    low, high = _range(signal, joined, variables)
    if low > 0.0 or high < 0.0:
        raise ConfigurationError(f"wiring: '{signal}' is zero at rest, which the range of what is wired to it forbids")
    largest = min(-low, high)
    return math.inf if largest == LARGEST else largest
