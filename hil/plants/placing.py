# SPDX-License-Identifier: MIT
"""The motion that a plant can be started in, other than at rest: where a log begins, or a piece of it."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.node.models.segway_parameters import SegwayParameters


class WheelMotion(NamedTuple):
    """How a two-wheeled robot moves.

    Attributes:
        left_angle, right_angle: Of the wheels against the body, rad.
        left_velocity, right_velocity: The same, rad/s.
        pitch, pitch_rate: Of the body against the vertical, positive forward, rad and rad/s; of a cart zero.
    """

    left_angle: float
    left_velocity: float
    right_angle: float
    right_velocity: float
    pitch: float = 0.0
    pitch_rate: float = 0.0


@runtime_checkable
class Placeable(Protocol):
    """A plant that can be started in a motion."""

    def begin_at(self, motion: WheelMotion, u: Sequence[float]) -> Sequence[float]:
        """Go on from a motion, with motors that have settled under the inputs `u`; returns the outputs there.

        Call it after `initialize`. Position and heading on the ground are counted from there.
        """


def place_body(body: SegwayBody, motion: WheelMotion, p: SegwayParameters) -> None:
    """Have a body move so; its way and its heading are those that its wheels have rolled."""
    body.pitch, body.q = motion.pitch, motion.pitch_rate
    body.v = p.wheel_radius * (0.5 * (motion.left_velocity + motion.right_velocity) + body.q)
    body.w = (motion.right_velocity - motion.left_velocity) * p.wheel_radius / p.track
    body.way = p.wheel_radius * (0.5 * (motion.left_angle + motion.right_angle) + body.pitch)
    body.heading = (motion.right_angle - motion.left_angle) * p.wheel_radius / p.track
