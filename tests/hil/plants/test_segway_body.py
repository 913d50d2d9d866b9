# SPDX-License-Identifier: MIT
"""The segway's mechanics, against what can be worked out by hand; see test_segway_lagrangian.py for the equations."""

import dataclasses
import math

import pytest

from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.node.models.segway_parameters import PUBLISHED

H = 0.0025
FREE = dataclasses.replace(PUBLISHED, viscous_friction=0.0, coulomb_friction=0.0, stop_angle=1e3)
P = FREE
STOPPED = dataclasses.replace(FREE, stop_angle=0.5)
PAYLOAD, PAYLOAD_HEIGHT = 1.5, 0.6


def energy(body: SegwayBody) -> float:
    """Kinetic and potential energy, J, the axle's height at the start being zero."""
    sin, cos = math.sin(body.pitch + body.slope), math.cos(body.pitch + body.slope)
    yaw = body._yaw_inertia + body._yaw_excess * sin * sin
    kinetic = 0.5 * (body._mass * body.v**2 + body._pitch_inertia * body.q**2 + yaw * body.w**2)
    kinetic += body._moment * body.v * body.q * cos
    height = body._moment * math.cos(body.pitch) + body._weight_share * body.way * body._sin_slope
    return kinetic + PUBLISHED.gravity * height


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
    start, spent = energy(body), []
    for _ in range(2000):
        body.step(H, 0.0, 0.0)
        spent.append(abs(energy(body) - start))
    assert max(spent) < 1e-4 * abs(start)
    assert abs(body.pitch) > 2.0  # it went right round: not a body that stands still


def test_torques_and_push_do_the_work_they_do() -> None:
    body = _body(w=1.0, pitch=0.1)
    body.push(3.0)
    start, way = energy(body), 0.0
    angles, centre = body.wheel_angles(), P.body_height_of_centre * math.sin(body.pitch)
    for _ in range(200):
        way += body.step(H, 0.3, 0.2)[0]
    left, right = (b - a for a, b in zip(angles, body.wheel_angles(), strict=True))
    pushed = way + P.body_height_of_centre * math.sin(body.pitch) - centre
    assert energy(body) - start == pytest.approx(0.3 * left + 0.2 * right + 3.0 * pushed, rel=1e-5)


def test_friction_only_takes_energy() -> None:
    body = SegwayBody(dataclasses.replace(PUBLISHED, stop_angle=1e3))
    body.v, body.pitch = 0.5, 0.2
    energies = []
    for _ in range(1000):
        body.step(H, 0.0, 0.0)
        energies.append(energy(body))
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
    before, ahead = energy(body), mass * 0.2 + ml * math.cos(0.5) * 0.4
    body.step(H, 0.0, 0.0)
    assert body.q == 0.0
    assert mass * body.v == pytest.approx(ahead, rel=1e-3)
    assert energy(body) < before - 0.01


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


STATES = [
    (0.0, 0.0, 0.0, 0.0, 0.1, -0.2),
    (0.02, -0.01, 0.03, 0.01, 0.0, 0.0),
    (1.5, 2.0, 3.0, -0.7, 0.5, 1.2),
    (-0.8, -1.5, 5.0, 1.1, -1.0, 0.3),
]
"""v, q, w, pitch and both torques: at rest, in the reach of friction at rest, and fast."""


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("payload", [0.0, PAYLOAD])
def test_the_equations_written_out_are_the_equations(state: tuple[float, ...], payload: float) -> None:
    body = SegwayBody(dataclasses.replace(PUBLISHED, viscous_friction=0.01))
    body.load(payload, PAYLOAD_HEIGHT)
    body.v, body.q, body.w, body.pitch, left, right = state
    by_equations = body._integrate(H, left, right)
    last = body.dv, body.dq, body.dw
    assert body._integrate_plain(H, left, right) == pytest.approx(by_equations, rel=1e-12, abs=1e-15)
    assert (body.dv, body.dq, body.dw) == pytest.approx(last, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(("push", "slope"), [(10.0, 0.0), (0.0, 0.1), (0.0, -0.1)])
def test_pushed_or_on_a_slope_it_is_not_on_its_own(push: float, slope: float) -> None:
    """The way that the equations of motion say, worked out in steps so small that any method does."""
    body, fine = _body(v=0.5, w=1.0, pitch=0.1), _body(v=0.5, w=1.0, pitch=0.1)
    for each in (body, fine):
        each.push(push)
        each.tilt(slope)
    body.step(H, 0.1, 0.2)
    for _ in range(1000):
        dv, dq, dw = fine.accelerations(fine.v, fine.q, fine.w, fine.pitch, 0.1, 0.2)
        fine.pitch += 1e-3 * H * (fine.q + 0.5e-3 * H * dq)
        fine.v, fine.q, fine.w = fine.v + 1e-3 * H * dv, fine.q + 1e-3 * H * dq, fine.w + 1e-3 * H * dw
    assert (body.v, body.q, body.w, body.pitch) == pytest.approx((fine.v, fine.q, fine.w, fine.pitch), abs=2e-6)


def test_accelerations_are_exact_when_asked_for_and_close_before() -> None:
    body = SegwayBody(PUBLISHED)
    body.v, body.w, body.pitch = 0.4, 1.0, 0.1
    body.step(H, 0.2, 0.1)
    close = body.dv, body.dq, body.dw
    body.accelerate(0.2, 0.1)
    exact = body.accelerations(body.v, body.q, body.w, body.pitch, 0.2, 0.1)
    assert (body.dv, body.dq, body.dw) == exact
    assert close == pytest.approx(exact, rel=1e-3)
    speeds = [body.wheel_speeds()]
    body.step(1e-7, 0.2, 0.1)
    speeds.append(body.wheel_speeds())
    rates = [(b - a) / 1e-7 for a, b in zip(*speeds, strict=True)]
    assert body.wheel_accelerations() == pytest.approx(rates, rel=1e-4)


@pytest.mark.parametrize("sign", [1, -1])
def test_however_long_the_step_it_reaches_the_stop_when_it_does(sign: int) -> None:
    """A long step over the impact against short ones: as far apart as these find the moment, 1 ms of 1 rad/s."""
    bodies = [_body(v=0.3, q=sign * 1.0, pitch=sign * 0.4993, stops=True) for _ in range(2)]
    ways = [bodies[0].step(3e-3, 0.0, 0.0)[0], sum(bodies[1].step(1e-5, 0.0, 0.0)[0] for _ in range(300))]
    for body in bodies:
        assert (body.pitch, body.q, body.dq) == (sign * 0.5, 0.0, 0.0)
    assert bodies[0].v == pytest.approx(bodies[1].v, abs=2e-3)
    assert ways[0] == pytest.approx(ways[1], abs=5e-4 * abs(bodies[1].v - 0.3))
    assert bodies[0].way == pytest.approx(ways[0])


def test_a_step_over_the_impact_is_made_of_short_ones() -> None:
    bodies = [_body(v=0.3, q=1.0, w=0.5, pitch=0.4993, stops=True) for _ in range(2)]
    gained = [bodies[0].step(3e-3, 0.1, 0.2), *(bodies[1].step(1e-3, 0.1, 0.2) for _ in range(3))]
    for name in ("v", "q", "w", "way", "pitch", "heading", "dv", "dq", "dw"):
        assert getattr(bodies[0], name) == getattr(bodies[1], name)
    assert gained[0] == pytest.approx([sum(column) for column in zip(*gained[1:], strict=True)])


def test_a_short_step_onto_the_stop_leaves_nothing_that_turns_it_further() -> None:
    body = _body(q=1.0, pitch=0.4999, stops=True)
    body.step(1e-3, 0.1, 0.2)
    assert (body.pitch, body.q) == (0.5, 0.0)
    assert (body.dv, body.dq, body.dw) == body.accelerations(body.v, 0.0, body.w, 0.5, 0.1, 0.2)
    assert body.dq == 0.0


def test_friction_at_rest_stops_a_wheel_at_the_stated_rate() -> None:
    """How the wheels' acceleration changes with their speed about rest, by differences; rolling, then turning."""
    for lever, payload in ((0.0, 0.0), (0.0, PAYLOAD), (1.0, 0.0)):
        p = dataclasses.replace(PUBLISHED, viscous_friction=0.01, body_yaw_inertia=0.0981 if not lever else 1e-4)
        p = dataclasses.replace(p, wheel_diameter_inertia=0.0) if lever else p
        body = SegwayBody(p)
        body.load(payload, PAYLOAD_HEIGHT)
        rates = []
        for tiny in (1e-7, -1e-7):
            body.v, body.w = (1.0 - lever) * tiny, lever * tiny
            body.dv, body.dq, body.dw = body.accelerations(body.v, 0.0, body.w, 0.0, 0.0, 0.0)
            rates.append((body.wheel_accelerations()[1], body.wheel_speeds()[1]))
        slope = (rates[0][0] - rates[1][0]) / (rates[0][1] - rates[1][1])
        assert body.friction_rate == pytest.approx(-slope, rel=1e-4)
