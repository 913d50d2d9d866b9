# SPDX-License-Identifier: MIT
"""How a joint is to go to its set-point: critically damped, no faster than it may, and never far from where it is."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, Self

from segway_ecc.node.model.model import Variable, Write

LEASH: Final = 0.3
"""How far ahead of its joint a reference may be, rad: it waits for one that does not follow, with its motor off or held
back, so that nothing jumps when that ends."""
PARAMETERS: Final = (
    Variable("ReferenceBandwidth", "rad/s", 6.0, Write.STATIC, minimum=0.5, maximum=20.0),
    Variable("MaxVelocity", "rad/s", 3.0, Write.STATIC, minimum=0.05, maximum=20.0, tunable=True),
    Variable("MaxAcceleration", "rad/s2", 20.0, Write.STATIC, minimum=0.5, maximum=200.0, tunable=True),
)
"""Of every model whose joints have references."""


class Reference(NamedTuple):
    """Where a joint is to be: rad, rad/s, rad/s2."""

    angle: float
    velocity: float
    acceleration: float


class ReferenceLimits(NamedTuple):
    """The bandwidth of references, rad/s, and the largest velocity, rad/s, and acceleration, rad/s2."""

    bandwidth: float
    velocity: float
    acceleration: float

    @classmethod
    def from_model(cls, p: Mapping[str, float]) -> Self:
        """Those of a model whose parameters have these values."""
        return cls(p["ReferenceBandwidth"], p["MaxVelocity"], p["MaxAcceleration"])

    def advance(self, reference: Reference, setpoint: float, step: float) -> Reference:
        """The reference one step, s, later."""
        wanted = self.bandwidth**2 * (setpoint - reference.angle) - 2.0 * self.bandwidth * reference.velocity
        acceleration = min(max(wanted, -self.acceleration), self.acceleration)
        velocity = min(max(reference.velocity + step * acceleration, -self.velocity), self.velocity)
        return Reference(reference.angle + step * velocity, velocity, (velocity - reference.velocity) / step)


def reference_states(names: Sequence[str]) -> tuple[Variable, ...]:
    """The states that keep the reference of each joint."""
    return tuple(
        Variable(f"{name}Reference{what}", unit)
        for name in names
        for what, unit in (("", "rad"), ("Velocity", "rad/s"), ("Acceleration", "rad/s2"))
    )


def references_in(states: Sequence[float]) -> list[Reference]:
    """The references that the states of `reference_states` keep."""
    return [Reference(*states[place : place + 3]) for place in range(0, len(states), 3)]


def near(reference: Reference, angle: float, velocity: float) -> Reference:
    """The reference of a joint that is measured there, rad and rad/s: from there where it is too far away."""
    return reference if abs(reference.angle - angle) <= LEASH else Reference(angle, velocity, 0.0)
