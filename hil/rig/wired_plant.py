# SPDX-License-Identifier: MIT
"""A plant whose ports have names of their own, wired to what drives give and measure as a controller is to a robot."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from segway_ecc.hil.rig.fronts import PlantFront
from segway_ecc.node.cycle.mixing import Mixer, WiredSignal, spread, taken, wired_signal
from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.model.model import Model, Variable

_WHERE = "simulation.wiring"


class _Value(NamedTuple):
    """A value that is made of others: their places, each with its factor, and an offset."""

    terms: tuple[tuple[int, float], ...]
    offset: float

    @property
    def is_plain(self) -> bool:
        """Whether it is another one as it is."""
        return len(self.terms) == 1 and self.terms[0][1] == 1.0 and self.offset == 0.0

    def of(self, values: Sequence[float]) -> float:
        """The value."""
        if self.is_plain:
            return values[self.terms[0][0]]
        total = self.offset
        for place, factor in self.terms:
            total += factor * values[place]
        return total


class WiredPlant(PlantFront):
    """A plant that the drives find under their own names, whatever its ports are called; see `Model`.

    A port that the wiring does not name keeps its own. What the plant itself calls its variables is what `read` and
    `write` take.
    """

    def __init__(self, plant: Model, wiring: Mapping[str, str | WiredSignal], mixers: Sequence[Mixer] = ()) -> None:
        """Wire a plant.

        Args:
            plant: The plant.
            wiring: For each port that has another name, the signal of the drives, or of a mixing.
            mixers: What the ports can be wired to beside that; see `plant_mixers`.

        Raises:
            UnknownNameError: The plant has no such port.
            ConfigurationError: Two of its outputs give the same.
        """
        super().__init__(plant)
        ports = [v.name for v in (*plant.inputs, *plant.outputs)]
        for port in wiring:
            if port not in ports:
                raise UnknownNameError(f"port of plant '{plant.name}' in {_WHERE}", port, ports)
        wired = {port: wired_signal(wiring.get(port, port)) for port in ports}
        mixes, driven = taken(mixers), dict[str, Variable]()
        self._takes: list[_Value] = []
        for variable in plant.inputs:
            entry = wired[variable.name]
            mixed = mixes.get(entry.signal)
            factors = {entry.signal: 1.0} if mixed is None else mixed.factors
            for signal in factors:
                driven.setdefault(signal, Variable(signal, variable.unit if mixed is None else "1"))
            places = list(driven)
            terms = tuple((places.index(signal), entry.gain * factor) for signal, factor in factors.items())
            self._takes.append(_Value(terms, entry.offset))
        self.inputs: Sequence[Variable] = tuple(driven.values())
        outputs = [v.name for v in plant.outputs]
        shares = spread({name: wired[name] for name in outputs}, mixers, _WHERE)
        units = {v.name: v.unit for v in plant.outputs}
        self._gives = [
            _Value(
                tuple((outputs.index(share.port), share.factor) for share in each),
                sum(share.offset for share in each),
            )
            for each in shares.values()
        ]
        self.outputs: Sequence[Variable] = tuple(
            Variable(signal, units[each[0].port] if len(each) == 1 and each[0].is_plain else "1")
            for signal, each in shares.items()
        )

    def initialize(self, u: Sequence[float]) -> list[float]:
        """Start at time zero; see `Model.initialize`."""
        return self._given(super().initialize(self._taken(u)))

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Make some steps at once; see `Advancing`."""
        return self._given(super().advance(self._taken(u), steps))

    def _taken(self, u: Sequence[float]) -> list[float]:
        return [each.of(u) for each in self._takes]

    def _given(self, y: Sequence[float]) -> list[float]:
        return [each.of(y) for each in self._gives]
