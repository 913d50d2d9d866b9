# SPDX-License-Identifier: MIT
"""The least friction on which a robot can get up from its bumper, whatever its controller does.

From the equations of `segway_ecc.hil.plants.segway_body`, in its symbols: body mass m at l above the axle, wheels of
mass mw and spin inertia Iw, radius r, M = m + 2 mw + 2 Iw / r^2. At the stop the lean is b = stop angle, on level
ground, and all is at rest. With the torque T of both wheels and q the pitch rate,

    M v' + m l cos b q' = T / r                       (1: q = w = 0)
    m l cos b v' + J q' = m g l sin b - T             (2: the bumper carries nothing any more)

The body begins to rise where q' < 0; at the limit q' = 0:

    T = r M v',     v' (m l cos b + M r) = m g l sin b,     v' = g m l sin b / (m l cos b + M r)

What the ground gives ahead is the momentum's change, Ff = (m + 2 mw) v' + m l cos b q'. The normal force is the weight
and what lifts the body's centre, whose height is l cos b: N = (m + 2 mw) g - m l sin b q'. At the limit q' = 0, so
Ff / N = v' / g, and no wheel slips where

    friction >= m l sin b / (m l cos b + M r)

As soon as it rises, q' < 0 adds to N and takes from Ff, and b gets smaller: what is asked of the floor falls. A wheel
that slips takes T = r Ff + 2 Iw w' with Ff = friction N: all that more torque does is to spin the wheels up, and it
acts on the body only while they do. Up to 60 rad/s that is 2 Iw 60 rad/s = 0.02 N m s for the published robot, which
turns its body by 0.1 rad/s: a robot whose wheels are light cannot throw itself up. On a slope the apparent gravity
turns with the ground, and the result stays the same but for Iw: it differs by less than 0.001 at 5 degrees for the
published robot.

Just above the limit the body rises slowly, and the run-up is long: what a controller needs is more.

The same limit from the torque: T = r M v', half of it from each wheel.

It assumes a bumper that touches the ground ahead of the body's centre, so that it is relieved as the body rises, and
that slides: one that holds to the floor pulls the body up a little.
"""

import math
from typing import NamedTuple

from segway_ecc.node.models.segway_parameters import SegwayParameters


class RisingLimit(NamedTuple):
    """What getting up from a bumper asks of the hardware.

    Attributes:
        friction: Least friction of the tyres, 1.
        torque: Least torque of one wheel, N m.
        acceleration: At which it drives under its body then, m/s2.
    """

    friction: float
    torque: float
    acceleration: float


def rising_limit(p: SegwayParameters) -> RisingLimit:
    """The limit for a robot that lies on its bumper on level ground; see above."""
    moment = p.body_mass * p.body_height_of_centre
    mass = p.body_mass + 2.0 * (p.wheel_mass + p.wheel_inertia / p.wheel_radius**2)
    rolling = moment * math.cos(p.stop_angle) + mass * p.wheel_radius
    share = moment * math.sin(p.stop_angle) / rolling
    acceleration = share * p.gravity
    return RisingLimit(share, 0.5 * p.wheel_radius * mass * acceleration, acceleration)
