"""The segway's mechanics, against what can be worked out by hand; see test_segway_lagrangian.py for the equations."""

import dataclasses
import math

import pytest

from hil.plants.segway_body import SegwayBody
from node.models.segway_parameters import PUBLISHED

H = 0.0025
FREE = dataclasses.replace(PUBLISHED, viscous_friction=0.0, coulomb_friction=0.0, stop_angle=1e3)
P = FREE
STOPPED = dataclasses.replace(FREE, stop_angle=0.5)
PAYLOAD, PAYLOAD_HEIGHT = 1.5, 0.6


def _body(*, v: float = 0.0, q: float = 0.0, w: float = 0.0, pitch: float = 0.0, stops: bool = False) -> SegwayBody:
    body = SegwayBody(STOPPED if stops else FREE)
    body.v, body.q, body.w, body.pitch = v, q, w, pitch
    return body


def _run(body: SegwayBody, seconds: float, left: float = 0.0, right: float = 0.0) -> None:
    for _ in range(round(seconds / H)):
        body.step(H, left, right)


def test_keeps_its_energy_without_friction_and_input() -> None:
    body = _body(v=0.4, q=1.0, w=3.0, pitch=0.5)
    body.load(PAYLOAD, PAYLOAD_HEIGHT)
    body.tilt(0.1)
    start, spent = body.energy(), []
    for _ in range(2000):
        body.step(H, 0.0, 0.0)
        spent.append(abs(body.energy() - start))
    assert max(spent) < 1e-4 * abs(start)
    assert abs(body.pitch) > 2.0  # it went right round: not a body that stands still


def test_torques_and_push_do_the_work_they_do() -> None:
    body = _body(w=1.0, pitch=0.1)
    body.push(3.0)
    start, way = body.energy(), 0.0
    angles, centre = body.wheel_angles(), P.body_height_of_centre * math.sin(body.pitch)
    for _ in range(200):
        way += body.step(H, 0.3, 0.2)[0]
    left, right = (b - a for a, b in zip(angles, body.wheel_angles(), strict=True))
    pushed = way + P.body_height_of_centre * math.sin(body.pitch) - centre
    assert body.energy() - start == pytest.approx(0.3 * left + 0.2 * right + 3.0 * pushed, rel=1e-5)


def test_friction_only_takes_energy() -> None:
    body = SegwayBody(dataclasses.replace(PUBLISHED, stop_angle=1e3))
    body.v, body.pitch = 0.5, 0.2
    energies = []
    for _ in range(1000):
        body.step(H, 0.0, 0.0)
        energies.append(body.energy())
    assert energies == sorted(energies, reverse=True)
    assert energies[0] - energies[-1] > 0.1


@pytest.mark.parametrize(("left", "right"), [(20.0, 20.0), (20.0, -20.0), (-5.0, 30.0)])
def test_friction_is_viscous_and_coulomb(left: float, right: float) -> None:
    """At wheel speeds far above `coulomb_speed`, each wheel: -(viscous w + coulomb sign w), on wheel and body."""
    p = dataclasses.replace(FREE, viscous_friction=1e-3, coulomb_friction=0.02)
    v, w = 0.5 * (left + right) * p.wheel_radius, (right - left) * p.wheel_radius / p.track
    torques = (-(1e-3 * speed + math.copysign(0.02, speed)) for speed in (left, right))
    rubbing = SegwayBody(p).accelerations(v, 0.0, w, 0.1, 0.0, 0.0)
    assert rubbing == pytest.approx(_body().accelerations(v, 0.0, w, 0.1, *torques))


def test_falls_at_the_analytical_rate() -> None:
    """Linearized, pitch'' = k^2 pitch with k^2 = m g l M / (M J - (m l)^2): pitch0 cosh(k t)."""
    ml = P.body_mass * P.body_height_of_centre
    mass = P.body_mass + 2 * P.wheel_mass + 2 * P.wheel_inertia / P.wheel_radius**2
    inertia = ml * P.body_height_of_centre + P.body_pitch_inertia
    k = math.sqrt(ml * P.gravity * mass / (mass * inertia - ml**2))
    body = _body(pitch=1e-6)
    _run(body, 0.5)
    assert body.pitch == pytest.approx(1e-6 * math.cosh(k * 0.5), rel=1e-5)
    assert 9.0 < k < 10.5


def test_stands_upright_for_ever() -> None:
    body = _body()
    _run(body, 5.0)
    assert (body.v, body.q, body.w, body.pitch, body.way) == (0.0,) * 5


def test_stands_on_a_slope_when_it_leans_into_it() -> None:
    """At rest the wheels hold the whole weight, (m + 2 mw) g sin a r, and the lean holds the wheels' torque."""
    slope = 0.1
    torque = (P.body_mass + 2 * P.wheel_mass) * P.gravity * math.sin(slope) * P.wheel_radius
    pitch = math.asin(torque / (P.body_mass * P.gravity * P.body_height_of_centre))
    body = _body()
    body.tilt(slope)
    assert body.accelerations(0.0, 0.0, 0.0, pitch, torque / 2, torque / 2) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


def test_mirrored_left_and_right() -> None:
    one, other = _body(v=0.3, w=1.0, pitch=0.1), _body(v=0.3, w=-1.0, pitch=0.1)
    _run(one, 0.5, 0.3, 0.1)
    _run(other, 0.5, 0.1, 0.3)
    assert (one.v, one.q, one.pitch, one.way) == pytest.approx((other.v, other.q, other.pitch, other.way))
    assert (one.w, one.heading) == pytest.approx((-other.w, -other.heading))
    assert one.wheel_speeds() == pytest.approx(other.wheel_speeds()[::-1])


def test_mirrored_ahead_and_back() -> None:
    one, other = _body(v=0.3, w=1.0, pitch=0.1), _body(v=-0.3, w=1.0, pitch=-0.1)
    _run(one, 0.5, 0.3, 0.1)
    _run(other, 0.5, -0.1, -0.3)
    assert (one.v, one.q, one.pitch) == pytest.approx((-other.v, -other.q, -other.pitch))
    assert one.heading == pytest.approx(other.heading)


def test_turning_lifts_a_lean() -> None:
    """Centrifugal: turning makes a leaning body lean further, by D w^2 sin cos / J at first order."""
    still, turning = (_body().accelerations(0.0, 0.0, w, 0.1, 0.0, 0.0) for w in (0.0, 4.0))
    assert turning[1] > still[1]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_falls_onto_the_stop_and_rests_there(sign: int, slope: float) -> None:
    # Wheels that roll freely down a slope carry it upright against the ground, not against gravity.
    body = _body(pitch=0.05 * sign - slope, stops=True)
    body.tilt(slope)
    _run(body, 2.0)
    assert body.pitch + slope == pytest.approx(0.5 * sign, abs=1e-12)
    assert (body.q, body.dq) == (0.0, 0.0)


def test_the_impact_keeps_the_momentum_along_the_ground_and_loses_energy() -> None:
    body = SegwayBody(dataclasses.replace(STOPPED, gravity=0.0))
    body.v, body.q, body.pitch = 0.2, 0.4, 0.49999
    ml = P.body_mass * P.body_height_of_centre
    mass = P.body_mass + 2 * P.wheel_mass + 2 * P.wheel_inertia / P.wheel_radius**2
    energy, ahead = body.energy(), mass * 0.2 + ml * math.cos(0.5) * 0.4
    body.step(H, 0.0, 0.0)
    assert body.q == 0.0
    assert mass * body.v == pytest.approx(ahead, rel=1e-3)
    assert body.energy() < energy - 0.01


def test_what_has_hit_the_stop_no_longer_accelerates_into_it() -> None:
    body = _body(q=1.0, pitch=0.4999, stops=True)
    body.step(H, 0.0, 0.0)
    assert (body.pitch, body.q, body.dq) == (0.5, 0.0, 0.0)


def test_lying_it_rolls_as_a_cart() -> None:
    mass = P.body_mass + 2 * P.wheel_mass + 2 * P.wheel_inertia / P.wheel_radius**2
    body = _body(pitch=0.5, stops=True)
    _run(body, 1.0, 0.1, 0.1)
    assert body.v == pytest.approx(0.2 / P.wheel_radius / mass)
    assert body.pitch == 0.5


@pytest.mark.parametrize(("share", "is_lifted"), [(0.99, False), (1.01, True)])
def test_gets_up_when_the_torque_outweighs_gravity(share: float, *, is_lifted: bool) -> None:
    """At the stop the second equation's q' is zero when m l cos b TT / (r M) = m g l sin b - TT, TT both torques."""
    ml = P.body_mass * P.body_height_of_centre
    mass = P.body_mass + 2 * P.wheel_mass + 2 * P.wheel_inertia / P.wheel_radius**2
    both = ml * P.gravity * math.sin(0.5) / (1 + ml * math.cos(0.5) / (P.wheel_radius * mass))
    body = _body(pitch=0.5, stops=True)
    _run(body, 0.2, 0.5 * share * both, 0.5 * share * both)
    assert (body.pitch < 0.5) is is_lifted


def test_a_slope_that_comes_up_lifts_what_lies_on_it() -> None:
    body = _body(pitch=0.5, stops=True)
    body.step(H, 0.0, 0.0)
    body.tilt(0.1)
    body.step(H, 0.0, 0.0)
    assert body.pitch == pytest.approx(0.4)


def test_wheels_are_measured_against_the_body() -> None:
    body = _body(v=1.0, q=2.0, w=0.5, pitch=0.3)
    body.way, body.heading = 0.4, 0.2
    assert body.wheel_speeds() == pytest.approx((20.0 - 1.524 - 2.0, 20.0 + 1.524 - 2.0))
    assert body.wheel_angles() == pytest.approx((8.0 - 0.6096 - 0.3, 8.0 + 0.6096 - 0.3))
