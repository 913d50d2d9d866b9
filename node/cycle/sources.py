# SPDX-License-Identifier: MIT
"""Where the value of a port or a signal comes from: one place among many, or several by their factors."""

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from segway_ecc.firmware_io.hardware import Hardware
from segway_ecc.node.cycle.mixing import Mixer, WiredSignal, given, spread, taken
from segway_ecc.node.cycle.signals import SET, SETPOINT_SIGNALS, TOPIC, VALID, published_signals
from segway_ecc.node.errors import ConfigurationError, UnknownNameError
from segway_ecc.node.model.model import Model, Variable, Write


@enum.unique
class Origin(enum.IntEnum):
    """Where a value comes from."""

    SENSOR = 0
    SETPOINT = 1
    SET = 2
    OUTPUT = 3
    VALIDITY = 4
    """Whether a sensor's value is fresh enough to be used."""
    SUM = 5
    """Several values, each by its factor, or one with an offset."""


@dataclass(frozen=True, slots=True)
class SignalSource:
    """A place in the values of an origin."""

    origin: Origin
    index: int


class Term(NamedTuple):
    """A value by its factor."""

    source: SignalSource
    factor: float


@dataclass(frozen=True, slots=True)
class Sum:
    """A value that is computed of others."""

    terms: tuple[Term, ...]
    offset: float

    def of(self, pools: Sequence[Sequence[float]]) -> float:
        """The value, where each of `pools` holds the values of an origin."""
        total = self.offset
        for source, factor in self.terms:
            total += factor * pools[source.origin][source.index]
        return total


class Outside:
    """Finds the sources of set-points and of values that anybody may set; `sums` are what is computed of them."""

    def __init__(self, set_signals: Sequence[str], mixers: Sequence[Mixer]) -> None:
        self.sums: list[Sum] = []
        self._set_signals = set_signals
        self._mixes = taken(mixers)

    def state(self, state: Variable, entry: WiredSignal) -> tuple[str, SignalSource]:
        """A state, and the source of what is written to it."""
        if state.write is not Write.NOW:
            raise ConfigurationError(f"wiring: state '{state.name}' cannot be written while the model runs")
        return state.name, self.source(entry, f"set-point for model state '{state.name}'")

    def source(self, entry: WiredSignal, what: str) -> SignalSource:
        """The source of what an entry joins; `what` it is for names it in an error."""
        mixed = self._mixes.get(entry.signal)
        if mixed is None and entry.is_plain:
            return self._find(entry.signal, what)
        factors = {entry.signal: 1.0} if mixed is None else mixed.factors
        terms = [Term(self._find(signal, what), entry.gain * factor) for signal, factor in factors.items()]
        self.sums.append(Sum(tuple(terms), entry.offset))
        return SignalSource(Origin.SUM, len(self.sums) - 1)

    def known(self) -> list[str]:
        """What there is, for people."""
        return [*SETPOINT_SIGNALS, *self._mixes, f"{SET}<name>", f"{TOPIC}<name>"]

    def outside(self, signal: str) -> SignalSource | None:
        """The source of a signal; None for one that is not from outside."""
        if signal in SETPOINT_SIGNALS:
            return SignalSource(Origin.SETPOINT, SETPOINT_SIGNALS.index(signal))
        return SignalSource(Origin.SET, self._set_signals.index(signal)) if signal in self._set_signals else None

    def _find(self, signal: str, what: str) -> SignalSource:
        source = self.outside(signal)
        if source is None:
            raise UnknownNameError(what, signal, self.known())
        return source


class Inputs(Outside):
    """Finds the sources of measured signals too."""

    def __init__(self, hardware: Hardware, set_signals: Sequence[str], mixers: Sequence[Mixer]) -> None:
        super().__init__(set_signals, mixers)
        self._signals = list(hardware.signals)

    def input(self, port: str, joined: Mapping[str, WiredSignal]) -> SignalSource:
        """The source of an input."""
        if port not in joined:
            raise ConfigurationError(
                f"wiring: model input '{port}' is wired to nothing; it can take {', '.join(self.known())}"
            )
        return self.source(joined[port], f"signal for model input '{port}'")

    def known(self) -> list[str]:
        """What there is, for people."""
        return [*self._signals, *SETPOINT_SIGNALS, *self._mixes, f"{SET}<name>", f"{VALID}<signal>"]

    def _find(self, signal: str, what: str) -> SignalSource:
        source = self.outside(signal)
        if source is not None:
            return source
        measured = signal.removeprefix(VALID)
        if measured not in self._signals:
            raise UnknownNameError(what, signal, self.known())
        origin = Origin.SENSOR if signal == measured else Origin.VALIDITY
        return SignalSource(origin, self._signals.index(measured))


class Outputs:
    """Finds for each signal that the model gives its place among the outputs, and their sums behind them.

    Attributes:
        places: By signal.
        sums: What is computed of the outputs.
    """

    def __init__(
        self, model: Model, joined: Mapping[str, WiredSignal], hardware: Hardware, mixers: Sequence[Mixer]
    ) -> None:
        # Measured signals are published as measured; a model may stand in for those that no hardware measures.
        measured, mixes = hardware.signals, given(mixers)
        signals = [*hardware.commands, *(s for s in published_signals(measured) if s not in measured)]
        names, known = [v.name for v in model.outputs], [*signals, *mixes, f"{TOPIC}<name>"]
        wired = {port: entry for port, entry in joined.items() if port in names}
        for port, entry in wired.items():
            if entry.signal not in known:
                raise UnknownNameError(f"signal for model output '{port}'", entry.signal, known)
        self.places: dict[str, int] = {}
        self.sums: list[Sum] = []
        self._model, self._commands = model, hardware.commands
        for signal, shares in spread(wired, mixers).items():
            if signal not in signals:
                raise UnknownNameError(f"command that the mixing of '{shares[0].port}' drives", signal, signals)
            if len(shares) == 1 and shares[0].is_plain:
                self.places[signal] = names.index(shares[0].port)
                continue
            terms = [Term(SignalSource(Origin.OUTPUT, names.index(each.port)), each.factor) for each in shares]
            self.places[signal] = len(names) + len(self.sums)
            self.sums.append(Sum(tuple(terms), sum(each.offset for each in shares)))

    def unit(self, signal: str, place: int) -> str:
        """The unit of what is given."""
        outputs = self._model.outputs
        return outputs[place].unit if place < len(outputs) else self._commands.get(signal, "1")
