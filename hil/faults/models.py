# SPDX-License-Identifier: MIT
"""The packaged controllers as faults make them: what they give is wrong, or their steps take too long.

What goes wrong is set while they run, as values that anybody may set: a log has it, and a replay does the same.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final

import msgspec

from segway_ecc.hil.faults.fault import Fault, Injection, Injections, active
from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.interfaces import SetValue
from segway_ecc.node.cycle.state import capture
from segway_ecc.node.errors import ConfigurationError, ModelError
from segway_ecc.node.model.model import Model, Variable, Write
from segway_ecc.node.models.cart import POSE_OUTPUTS, CartController, CartTorqueController
from segway_ecc.node.models.segway import SegwayController, SegwayVoltageController

_SET: Final = "set."
_AMISS: Final = (
    Variable("Oscillating", "1", 0.0, Write.NOW),
    Variable("Excess", "1", 0.0, Write.NOW),
    Variable("OdometryExcess", "1", 0.0, Write.NOW),
    Variable("NotNumbers", "1", 0.0, Write.NOW),
    Variable("Raises", "1", 0.0, Write.NOW),
)
"""What is wrong: how far the commands swing either way, in every step to the other side; how much too large they are;
how much too large what is published is; each in the outputs' units. And whether, at 1, the commands are not numbers,
and a step raises an error."""
_STATE_OF: Final = {
    ("model", "oscillating"): "Oscillating",
    ("model", "wrong"): "Excess",
    ("odometry", "wrong"): "OdometryExcess",
    ("model", "garbage"): "NotNumbers",
    ("model", "off"): "Raises",
}


class _MisbehavingModel:
    """A controller whose outputs are as its own further states have them; see `Model`."""

    controller: ClassVar[type[CartController | SegwayController]]

    def __init__(self, parameters: Mapping[str, float] | None = None) -> None:
        """Make the controller."""
        self._behind = model = self.controller(parameters)
        self.name, self.step_size = model.name, model.step_size
        self.inputs, self.outputs, self.parameters = model.inputs, model.outputs, model.parameters
        self.states = (*model.states, *_AMISS)
        self._amiss = {variable.name: variable.value for variable in _AMISS}
        self._published = len(self.outputs) - 2
        self._side = 1.0

    @property
    def stopped(self) -> bool:
        """See `Model.stopped`."""
        return self._behind.stopped

    def initialize(self, u: Sequence[float]) -> list[float]:
        """See `Model.initialize`."""
        return self._wrong(self._behind.initialize(u))

    def step(self, u: Sequence[float]) -> list[float]:
        """See `Model.step`."""
        self._side = -self._side
        if self._amiss["Raises"]:
            raise ModelError("it fails, as the scenario declares")
        return self._wrong(self._behind.step(u))

    def terminate(self) -> None:
        """See `Model.terminate`."""
        self._behind.terminate()

    def read(self, name: str) -> float:
        """See `Model.read`."""
        return self._amiss[name] if name in self._amiss else self._behind.read(name)

    def write(self, name: str, value: float) -> None:
        """See `Model.write`."""
        if name in self._amiss:
            self._amiss[name] = value
        else:
            self._behind.write(name, value)

    def _wrong(self, y: Sequence[float]) -> list[float]:
        """The outputs, of which the last two drive the motors; the pose stands first."""
        swing, excess, pose, not_numbers, _ = self._amiss.values()
        excess = math.nan if not_numbers else excess
        count, poses = self._published, len(POSE_OUTPUTS)
        commands = [self._side * swing if swing else value + excess for value in y[count:]]
        return [*(value + pose for value in y[:poses]), *y[poses:count], *commands]


class MisbehavingCart(_MisbehavingModel):
    """Of `CartController`."""

    controller = CartController


class MisbehavingTorqueCart(_MisbehavingModel):
    """Of `CartTorqueController`."""

    controller = CartTorqueController


class MisbehavingSegway(_MisbehavingModel):
    """Of `SegwayController`."""

    controller = SegwayController


class MisbehavingVoltageSegway(_MisbehavingModel):
    """Of `SegwayVoltageController`."""

    controller = SegwayVoltageController


_MISBEHAVING: Final = {
    f"{kind.controller.__module__}:{kind.controller.__name__}": f"{kind.__module__}:{kind.__name__}"
    for kind in (MisbehavingCart, MisbehavingTorqueCart, MisbehavingSegway, MisbehavingVoltageSegway)
}


def misbehaves(fault: Fault) -> bool:
    """Whether a fault is one of what a model gives."""
    return (fault.target, fault.type) in _STATE_OF


def misbehaving(file: RobotFile) -> RobotFile:
    """The robot with a controller that can misbehave in place of its own.

    Raises:
        ConfigurationError: Its controller is none of the packaged ones.
    """
    source = _MISBEHAVING.get(file.model.source)
    if source is None:
        raise ConfigurationError(
            f"the model of robot '{file.name}' cannot be made to misbehave: only those of the packaged robots can"
        )
    model = msgspec.structs.replace(file.model, source=source)
    wiring = {variable.name: f"{_SET}{variable.name}" for variable in _AMISS}
    return msgspec.structs.replace(file, model=model, wiring={**file.wiring, **wiring})


class AmissValues:
    """Sets what goes wrong in a model, when it does."""

    def __init__(self, injections: Injections, set_names: Sequence[str]) -> None:
        """Set values by their names among those of the robot."""
        self._places = [
            (injection, set_names.index(_STATE_OF[injection.fault.target, injection.fault.type]))
            for injection in injections.of("model", "odometry")
            if misbehaves(injection.fault)
        ]

    def take(self) -> list[SetValue]:
        """What is to be set now."""
        return [SetValue(place, _size(injection)) for injection, place in self._places]


def _size(injection: Injection) -> float:
    size = 1.0 if injection.fault.size is None else injection.size
    return size if injection.is_active else 0.0


class SlowModel:
    """A model each of whose steps takes as long as faults have it; see `Model`."""

    def __init__(self, model: Model, injections: Injections, spend: Callable[[float], None]) -> None:
        """Stand in front of `model`; `spend` lets time pass, s."""
        self._behind = model
        self._slow = [injection for injection in injections.of("model") if injection.fault.type == "slow"]
        self._spend = spend

    def __getattr__(self, name: str) -> object:
        """Everything but the steps is the model's own."""
        return getattr(self._behind, name)

    def step(self, u: Sequence[float]) -> list[float]:
        """See `Model.step`."""
        for injection in active(self._slow):
            self._spend(injection.size)
        return self._behind.step(u)

    def save_state(self) -> bytes:
        """The model's own: what takes time has no state."""
        return capture(self._behind)
