# SPDX-License-Identifier: MIT
"""What an edge asks of a robot that drives against it, whatever its controller does.

In the symbols of `segway_ecc.hil.plants.segway_body`: body mass m at l above the axle with the inertia I about its
centre, wheels of mass mw and radius r. The wheel touches an edge of height h < r at an angle c from straight below,
cos c = 1 - h / r.

At rest, with the floor relieved, all the edge gives is the weight W = (m + 2 mw) g, straight up. Its part along the
tyre is W sin c and its part into the tyre W cos c, and about the edge the torque T of both wheels holds the weight:

    friction >= tan c,        T = W r sin c

What is faster brings momentum along, and climbs with less.

An axle that the edge stops leaves the body its angular momentum about the axle, m l v = J q with J = I + m l^2. It then
falls about the axle that stands, J q' = m g l p - T, and with all of T it is still caught from upright where
q <= T / (m g l) * sqrt(m g l / J). So the largest speed at which a robot may be stopped, and still be caught in its
place, is

    v = T / (m l) * sqrt(J / (m g l))

A faster one falls, or must have climbed before.
"""

import math
from typing import NamedTuple

from segway_ecc.node.models.segway_parameters import SegwayParameters


class EdgeLimit(NamedTuple):
    """What climbing an edge from rest asks of the hardware.

    Attributes:
        friction: Least friction of the tyres on the edge, 1.
        torque: Least torque of one wheel, N m.
    """

    friction: float
    torque: float


def edge_limit(p: SegwayParameters, height: float) -> EdgeLimit:
    """The limit for an edge of this height, m, more than zero and less than the wheels' radius."""
    angle = math.acos(1.0 - height / p.wheel_radius)
    weight = (p.body_mass + 2.0 * p.wheel_mass) * p.gravity
    return EdgeLimit(math.tan(angle), 0.5 * weight * p.wheel_radius * math.sin(angle))


def caught_speed(p: SegwayParameters, torque: float) -> float:
    """The largest speed, m/s, from which a robot is caught that an edge stops, with this torque of each wheel, N m."""
    moment = p.body_mass * p.body_height_of_centre
    inertia = p.body_pitch_inertia + moment * p.body_height_of_centre
    return 2.0 * torque / moment * math.sqrt(inertia / (moment * p.gravity))
