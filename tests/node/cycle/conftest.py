# SPDX-License-Identifier: MIT
"""A bench with a model that does as a script says, for the tests of cycle and loop."""

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.testing import Bench, RecordingHardware


class Probe(SectionedModel):
    """Voltage = 10 linear + angular; X = model time; or what the script says."""

    name = "probe"
    step_size = 0.01
    method = Method.DISCRETE
    inputs = (Variable("Speed", "rad/s"),)
    states = (Variable("Linear", "m/s", 0.0, Write.NOW), Variable("Angular", "rad/s", 0.0, Write.NOW))
    outputs = (Variable("Voltage", "V"), Variable("X", "m"))

    def __init__(self, journal: list[str], script: SimpleNamespace) -> None:
        super().__init__()
        self.journal = journal
        self.script = script
        self.cycle = -1

    def initial(self) -> None:
        self.say("initial")

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        self.cycle += 1
        self.say("equations")
        return s

    def output(self) -> Sequence[float]:
        linear, angular = self.s
        self.stopped = self.cycle == self.script.stops_at
        outputs: Sequence[float] = self.script.outputs.get(self.cycle, (10.0 * linear + angular, self.time))
        return outputs

    def final(self) -> None:
        self.say("final")

    def say(self, section: str) -> None:
        self.journal.append(section)
        if section in self.script.raises:
            raise self.script.raises[section]


@pytest.fixture
def script() -> SimpleNamespace:
    """What the model does: `outputs` by cycle, the exception that a section `raises`, the cycle it `stops_at`."""
    return SimpleNamespace(outputs={}, raises={}, stops_at=None)


@pytest.fixture
def make_bench(script: SimpleNamespace) -> Callable[..., Bench]:
    """A bench with the probe behind one motor of at most 30 V."""

    def make(*, rewired: Mapping[str, str] | None = None, **options: Any) -> Bench:
        hardware = RecordingHardware({"left.velocity": "rad/s"}, {"left.voltage": "V"}, (30.0,))
        wiring = {
            "Speed": "left.velocity",
            "Linear": "setpoint.linear_velocity",
            "Angular": "setpoint.angular_velocity",
            "Voltage": "left.voltage",
            "X": "odometry.x",
            **(rewired or {}),
        }
        return Bench(Probe(hardware.journal, script), hardware, wiring, **options)

    return make


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    """A bench that arms itself and sends in the next cycle."""
    return make_bench()
