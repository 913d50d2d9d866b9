# SPDX-License-Identifier: MIT
"""The segway's equations of motion against its Lagrangian, differentiated by numbers.

The Lagrangian of six coordinates (x, y, heading, lean, and each wheel's turn against the ground) knows positions and
masses only; wheels that roll are three constraints on it, held by multipliers. Nothing here is taken from the plant.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

import pytest

from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.node.models.segway_parameters import PUBLISHED

P = PUBLISHED
PAYLOAD, PAYLOAD_HEIGHT = 1.5, 0.6

Vector = Sequence[float]


def _rotation(heading: float, lean: float) -> list[list[float]]:
    ch, sh, cl, sl = math.cos(heading), math.sin(heading), math.cos(lean), math.sin(lean)
    return [[ch * cl, -sh, ch * sl], [sh * cl, ch, sh * sl], [-sl, 0.0, cl]]


def _on_axis(z: Vector, height: float) -> list[float]:
    return [at + height * row[2] for at, row in zip((z[0], z[1], P.wheel_radius), _rotation(z[2], z[3]), strict=True)]


def _rate(f: Callable[[Vector], Vector], z: Vector, dz: Vector) -> list[float]:
    e = 1e-5
    ahead, behind = (f([a + s * e * b for a, b in zip(z, dz, strict=True)]) for s in (1, -1))
    return [(a - b) / (2 * e) for a, b in zip(ahead, behind, strict=True)]


def _spin(z: Vector, dz: Vector) -> tuple[float, float, float]:
    """Angular velocity in the body's axes: R^T dR/dt is its cross-product matrix."""
    r = _rotation(z[2], z[3])
    rates = _rate(lambda at: [x for row in _rotation(at[2], at[3]) for x in row], z, dz)
    s = [[sum(r[k][i] * rates[3 * k + j] for k in range(3)) for j in range(3)] for i in range(3)]
    return s[2][1], s[0][2], s[1][0]


def _square(v: Vector) -> float:
    return sum(x * x for x in v)


def _kinetic(z: Vector, dz: Vector, payload: float) -> float:
    x, y, up = _spin(z, dz)
    energy = P.body_roll_inertia * x**2 + P.body_pitch_inertia * y**2 + P.body_yaw_inertia * up**2
    energy += P.body_mass * _square(_rate(lambda at: _on_axis(at, P.body_height_of_centre), z, dz))
    energy += payload * _square(_rate(lambda at: _on_axis(at, PAYLOAD_HEIGHT), z, dz))
    for side, turn in ((1, dz[4]), (-1, dz[5])):
        energy += P.wheel_mass * _square(_rate(lambda at, side=side: _hub(at, side), z, dz))  # type: ignore[misc]
        energy += P.wheel_inertia * turn**2 + P.wheel_diameter_inertia * dz[2] ** 2
    return 0.5 * energy


def _hub(z: Vector, side: int) -> list[float]:
    return [z[0] - side * 0.5 * P.track * math.sin(z[2]), z[1] + side * 0.5 * P.track * math.cos(z[2])]


def _potential(z: Vector, slope: float, payload: float) -> float:
    """The ground is the plane z = 0; on a slope, "up" leans forward in it."""

    def height(point: Vector) -> float:
        return point[0] * math.sin(slope) + point[2] * math.cos(slope)

    energy = P.body_mass * height(_on_axis(z, P.body_height_of_centre)) + payload * height(_on_axis(z, PAYLOAD_HEIGHT))
    return P.gravity * (energy + 2 * P.wheel_mass * height((z[0], 0.0, P.wheel_radius)))


def _push(z: Vector, slope: float, payload: float, force: float) -> list[float]:
    """What a level force at the common centre of body and payload does along each coordinate."""
    centre = (P.body_mass * P.body_height_of_centre + payload * PAYLOAD_HEIGHT) / (P.body_mass + payload)
    level = (math.cos(slope) * force, 0.0, -math.sin(slope) * force)
    ways = (_rate(lambda at: _on_axis(at, centre), z, _unit(i)) for i in range(6))
    return [sum(a * b for a, b in zip(level, way, strict=True)) for way in ways]


def _unit(i: int) -> list[float]:
    return [float(i == j) for j in range(6)]


def _lagrange(z: list[float], dz: list[float], load: tuple[float, float, float], torques: Vector) -> list[float]:
    """Accelerations of the six coordinates."""
    slope, payload, force = load
    e = 1e-3
    shifted = [[[a + s * e * b for a, b in zip(z, _unit(i), strict=True)] for s in (1, -1)] for i in range(6)]

    def momentum(at: Vector, i: int) -> float:
        up, down = ([a + s * b for a, b in zip(dz, _unit(i), strict=True)] for s in (1, -1))
        return (_kinetic(at, up, payload) - _kinetic(at, down, payload)) / 2

    rows = []
    for i in range(6):
        mass = [_mixed(z, i, j, payload) for j in range(6)]
        drift = _rate(lambda at, i=i: [momentum(at, i)], z, dz)[0]  # type: ignore[misc]
        slopes = [_kinetic(at, dz, payload) - _potential(at, slope, payload) for at in shifted[i]]
        rows.append((mass, (slopes[0] - slopes[1]) / (2 * e) - drift))
    left, right = torques
    forces = [0.0, 0.0, 0.0, -left - right, left, right]
    pushes = _push(z, slope, payload, force)
    right_side = [bias + f + p for (_, bias), f, p in zip(rows, forces, pushes, strict=True)]
    return _constrained([mass for mass, _ in rows], right_side, z, dz)


def _mixed(z: Vector, i: int, j: int, payload: float) -> float:
    """The mass matrix: kinetic energy is quadratic in the rates, so differences are exact."""
    both = [a + b for a, b in zip(_unit(i), _unit(j), strict=True)]
    return _kinetic(z, both, payload) - _kinetic(z, _unit(i), payload) - _kinetic(z, _unit(j), payload)


def _constraints(z: Vector) -> list[list[float]]:
    c, s = math.cos(z[2]), math.sin(z[2])
    half, r = 0.5 * P.track, P.wheel_radius
    return [[-s, c, 0, 0, 0, 0], [c, s, -half, 0, -r, 0], [c, s, half, 0, 0, -r]]


def _constrained(mass: list[list[float]], forces: list[float], z: Vector, dz: Vector) -> list[float]:
    a = _constraints(z)
    moving = _rate(lambda at: [x for row in _constraints(at) for x in row], z, dz)
    drift = [-sum(moving[6 * k + i] * dz[i] for i in range(6)) for k in range(3)]
    matrix = [[*mass[i], *(-a[k][i] for k in range(3))] for i in range(6)] + [[*row, 0.0, 0.0, 0.0] for row in a]
    return _solve(matrix, [*forces, *drift])[:6]


def _solve(matrix: list[list[float]], right: list[float]) -> list[float]:
    rows = [[*row, b] for row, b in zip(matrix, right, strict=True)]
    for i in range(len(rows)):
        best = max(range(i, len(rows)), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        rows = [r if k == i else [x - r[i] * y for x, y in zip(r, rows[i], strict=True)] for k, r in enumerate(rows)]
    return [row[-1] for row in rows]


@pytest.mark.parametrize(
    ("v", "q", "w", "lean", "slope", "payload", "push", "left", "right"),
    [
        (0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0, -0.4),
        (1.5, 0.0, 3.0, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0),
        (1.5, 2.0, 3.0, -0.7, 0.0, 0.0, 0.0, 0.5, 1.2),
        (-0.8, -1.5, 5.0, 1.1, 0.15, 0.0, 0.0, 0.2, 0.3),
        (0.7, 1.5, -4.0, 0.6, -0.2, PAYLOAD, 0.0, 0.2, 0.3),
        (0.7, 1.5, -4.0, 0.6, -0.2, PAYLOAD, 25.0, -0.2, 0.3),
    ],
)
def test_accelerates_as_in_the_lagrangian(  # noqa: PLR0913, PLR0917 - one case in full
    v: float, q: float, w: float, lean: float, slope: float, payload: float, push: float, left: float, right: float
) -> None:
    half, r = 0.5 * P.track, P.wheel_radius
    z = [0.3, -0.2, 0.0, lean, 0.0, 0.0]
    dz = [v, 0.0, w, q, (v - half * w) / r, (v + half * w) / r]
    ddx, _, ddheading, ddlean, *_ = _lagrange(z, dz, (slope, payload, push), (left, right))
    body = SegwayBody(dataclasses.replace(P, viscous_friction=0.0, coulomb_friction=0.0))
    body.load(payload, PAYLOAD_HEIGHT)
    body.tilt(slope)
    body.push(push)
    # At heading zero, x ahead: what of ddx is not turning is the speed's rate.
    assert body.accelerations(v, q, w, lean - slope, left, right) == pytest.approx(
        (ddx, ddlean, ddheading), rel=1e-5, abs=1e-4
    )
