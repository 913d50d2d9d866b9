# SPDX-License-Identifier: MIT
"""What a segway does, and how it is kept up and moved: phases, set-points that its body can follow, and torques.

It rests on a stop, stands up, balances, sits down, or rests because it gave up. The balance is state feedback with the
gains that `segway-ecc design gains` finds, around a moving reference:

    u = u_ref - k1 (travel - travel_ref) - k2 (velocity - velocity_ref) - k3 (pitch - pitch_ref) - k4 pitch_rate
              - k5 (u[-1] - u_ref) - k6 (u[-2] - u_ref) - k7 integral of (travel - travel_ref)

with u the sum of both wheels' torques and u[-1], u[-2] those on their way to the motors. To speed up by a, the body
leans pitch_ref = PitchPerAcceleration a and the wheels push u_ref = TorquePerAcceleration a (in the linear model, with
the pitch at rest). The heading is held by feedback of its error and of the yaw rate on the difference of the torques.

To stand up takes nearly all that a tyre carries on an ordinary floor, and a wheel that weighs little spins within two
periods. So each wheel begins with part of its torque and is given more while it rolls. One that slips has more than its
tyre carries, and loses grip by it: it is given less, the longer and the faster it slips.

A robot that drives against an edge stops, and its body falls on over it. To be caught it must climb at once, with all
torque: that holds the body back, and what is taken from the body presses the wheels over the edge. The law above would
do the opposite: it lets the body fall, to catch up with the reference on wheels that roll. So from where a wheel is
stopped or loses the floor, the reference waits for the robot, at nearly its speed, and the pitch rate counts for more.
Wheels bounce on an edge, in turns. One that is held back whenever it spins has no grip where it lands: so each may spin
by 1 m/s, and is sent less the faster it spins beyond that, and is braked at last. Both are braked where the body falls
freely.

A robot that is lifted has nothing to balance on. Its wheels are braked until they rest against the body, and then the
motors give nothing. A wheel with the inertia J that is sent u = -k v for the speed v = r w of its tread stops by

    J dw/dt = u        dv/dt = -(r k / J) v        J / (r k) = 29 ms for k = 0.12 N s and the published wheel

which is twice what it takes a torque to act, so that it does not swing.
"""

import enum
from collections.abc import Mapping
from math import copysign
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.value import Value
from segway_ecc.node.models.segway_estimate import Estimate, within

_UP_PITCH: Final = 0.1
_UP_RATE: Final = 0.5
_UP_TIME_S: Final = 0.1
_STILL_SPEED: Final = 0.05
_STILL_RATE: Final = 0.1
_STILL_TIME_S: Final = 0.2
_SETTLED_WITHIN: Final = 0.05
"""How near the accelerometer's "up" must be to the pitch before it stands up, rad: the first sample may be wrong."""
_AT_STOP: Final = 0.75
"""Part of the stop's pitch from which on the body counts as down; less than one, since a slope may be under it."""
_BRAKE_GAIN: Final = 2.0
"""Sum of torques per forward speed once it is down, N s."""
_RATE_FACTOR: Final = 0.7
"""How hard the pitch rate is held while it sits down, against balancing: alone, without the pitch, it needs less."""
_LANDED_RATE: Final = 0.3
"""Pitch rate below which a body that is down lies on its stop, rad/s; above, braking would throw it there."""
_RUNAWAY_TIME_S: Final = 0.05
_YIELD_RATE: Final = 20.0
"""Part of its torque that a slipping wheel loses, 1/s: half of it, which it lacks on friction 0.5, within 35 ms."""
_FIRST_GRIP: Final = 0.5
"""Part of the torque limit with which a wheel begins to stand up: less would only make it drive along on its stop."""
_REGAIN_RATE: Final = 4.0
"""Part of the torque limit by which a wheel may have more while it rolls, 1/s. So slowly that it spins by no more than
0.5 m/s before it is given less; slower, the robot comes as far and faster before it is up."""
_LEAST_GRIP: Final = 0.23
"""Part of the torque limit that a wheel may always have while it hardly slips: what a tyre carries on ice."""
_SLIP_GAIN: Final = 0.5
"""Torque that it loses at once for its slip, N s: with more, and two periods of delay, it slips in bursts."""
_SLIP_LEAD: Final = 2.0
"""Periods by which the slip is foreseen: a torque acts so much later."""
_KEPT_SPEED: Final = 0.8
_KEPT_PITCH: Final = 0.25
"""A robot that stands up with less than all its torque keeps this part of its speed, down to this pitch, rad, and less
and less below: to brake takes the grip that getting up needs, and to arrive faster takes a longer way."""
_HELD_S: Final = 0.2
"""How long the reference waits on for a robot that had a wheel without the floor, s."""
_HELD_SPEED: Final = 0.8
"""Part of the robot's speed that the reference has meanwhile."""
_SPINS: Final = 1.0
"""A wheel may slip as fast while it balances, m/s: one that is sent all its torque as it lands has its grip at once."""
_SPIN_LEAD: Final = 1.0
"""Periods by which such a slip is foreseen; by more, wheels that bounce on an edge are sent next to nothing."""
_CATCH: Final = 1.5
"""Times its gain the pitch rate counts while the reference waits: a body that an edge threw ahead is to be stopped
before the wheels have climbed. The gains were designed for wheels that get under it at once."""
_FALLS_S: Final = 0.015
"""A body that has felt no weight for so long, s, falls off an edge: one that bounces on an edge does for less."""
_BRAKE_PER_SLIP: Final = 0.25
"""Torque that brakes both wheels then, N s: with two periods of delay, one of 1.7e-4 kg m2 stops without swinging."""
_LARGEST_BRAKE: Final = 0.45
"""The most of it, N m: less than safety counts as oscillation."""
_LIFTED_S: Final = 0.02
"""So long both wheels must have been without the floor, while something carries the body, until it counts as lifted."""
_LIFTED_BRAKE: Final = 0.12
"""Torque that brakes a wheel of a lifted robot for its speed, N s."""
_BRAKE_LEAD: Final = 1.0
"""Periods by which that speed is foreseen."""
_RESTS_SPEED: Final = 0.05
_RESTS_S: Final = 0.02
"""Wheels that are slower, m/s, for so long are at rest."""
_LONGEST_BRAKE_S: Final = 0.3
"""Wheels that do not rest by then are not braked any more: they stop by their friction."""
_RAMP_RATE: Final = 2.0
_RAMP_LAG_S: Final = 0.2
"""The ramp of a set-point is (1 + lag s) s + rate: well damped, and without a step in acceleration."""


class Phase(enum.IntEnum):
    """What the robot is doing."""

    RESTING = 0
    """Down, the motors give nothing; stands up on request."""
    STANDING_UP = 1
    """On its way from the stop to balance."""
    BALANCING = 2
    """Up, and following set-points."""
    SITTING_DOWN = 3
    """Leaning down onto the stop ahead, then braking."""
    GIVEN_UP = 4
    """The motors give nothing; it fell, did not get up or was lifted; tries again after a request to sit."""
    LIFTED = 5
    """Its wheels have no floor, since something else carries it: they are braked until they rest."""


class PhaseProgress(Value, frozen=True):
    """A phase, and how far it has come.

    Attributes:
        elapsed: How long the phase has lasted, s.
        lasting: How long the robot has been where the phase leads, or ends, s.
        wrong: How long the wheels have been too fast, s.
    """

    phase: Phase = Phase.RESTING
    elapsed: float = 0.0
    lasting: float = 0.0
    wrong: float = 0.0

    @property
    def is_resting(self) -> bool:
        """Whether the motors give nothing."""
        return self.phase is Phase.RESTING or self.phase is Phase.GIVEN_UP

    @property
    def may_slip(self) -> bool:
        """Whether wheels are given as much torque as makes them slip on an ordinary floor."""
        return self.phase is Phase.STANDING_UP

    @property
    def balances(self) -> bool:
        """Whether the robot is up, and does not lie: what its wheels do as it strikes the floor is no lost floor."""
        return self.phase is Phase.BALANCING and self.lasting == 0.0


class PhaseRules:
    """When one phase becomes another."""

    def __init__(self, period: float, p: Mapping[str, float]) -> None:
        """Take the parameters `p` of `segway_ecc.node.models.segway`, and the period, s."""
        self._period = period
        self._settling_time = p["SettlingTime"]
        self._stand_up_time = p["StandUpTime"]
        self._fall_time = p["FallTime"]
        self._sit_down_time = p["SitDownTime"]
        self._sit_down_rate = p["SitDownRate"]
        self._down_pitch = _AT_STOP * p["StopPitch"]
        self._runaway_speed = p["RunawaySpeed"]
        self._torque_per_pitch = p["TorquePerAcceleration"] / p["PitchPerAcceleration"]
        self._torque_per_rate = _RATE_FACTOR * p["PitchRateGain"]

    def advance(self, progress: PhaseProgress, e: Estimate, *, stand: bool) -> PhaseProgress:
        """The phase one period later; `stand` is whether it is asked to stand."""
        phase, period = progress.phase, self._period
        goal = self._next(progress, e, stand=stand)
        if goal is not phase:
            return PhaseProgress(goal)
        return PhaseProgress(
            phase,
            progress.elapsed + period,
            progress.lasting + period if self._is_ending(phase, e) else 0.0,
            # Faster than the robot is ever asked to go, as wheels turn in the air.
            progress.wrong + period if abs(e.rolled) > self._runaway_speed else 0.0,
        )

    def torque_down(self, e: Estimate) -> float:
        """Sum of torques while it sits down, N m: lean forward at a given rate; once down, stop rolling."""
        if abs(e.pitch) > self._down_pitch and abs(e.pitch_rate) < _LANDED_RATE:
            return -_BRAKE_GAIN * e.velocity
        return self._torque_per_pitch * e.pitch - self._torque_per_rate * (e.pitch_rate - self._sit_down_rate)

    def _next(self, progress: PhaseProgress, e: Estimate, *, stand: bool) -> Phase:
        match progress.phase:
            case Phase.BALANCING:  # for nearly all of its time, and so asked for first
                return self._from_balancing(progress, e, stand=stand)
            case Phase.RESTING:
                is_settled = min(e.since, progress.elapsed) > self._settling_time and abs(e.off) < _SETTLED_WITHIN
                return Phase.STANDING_UP if stand and is_settled else Phase.RESTING
            case Phase.STANDING_UP:
                return self._from_standing_up(progress, stand=stand)
            case Phase.SITTING_DOWN:
                # Who asks for it to stand knows that it lies: the motors were off, or nothing was measured, as it fell.
                is_over = stand or progress.lasting > _STILL_TIME_S or progress.elapsed > self._sit_down_time
                return Phase.RESTING if is_over else Phase.SITTING_DOWN
            case Phase.GIVEN_UP:
                return Phase.GIVEN_UP if stand else Phase.RESTING
            case Phase.LIFTED:
                is_over = progress.lasting > _RESTS_S or progress.elapsed > _LONGEST_BRAKE_S
                return Phase.GIVEN_UP if is_over else Phase.LIFTED

    def _from_balancing(self, progress: PhaseProgress, e: Estimate, *, stand: bool) -> Phase:
        if e.lifted >= _LIFTED_S:
            return Phase.LIFTED
        if progress.lasting > self._fall_time or progress.wrong > _RUNAWAY_TIME_S:
            return Phase.GIVEN_UP
        return Phase.BALANCING if stand else Phase.SITTING_DOWN

    def _from_standing_up(self, progress: PhaseProgress, *, stand: bool) -> Phase:
        if progress.elapsed > self._stand_up_time or progress.wrong > _RUNAWAY_TIME_S:
            return Phase.GIVEN_UP
        if not stand:
            return Phase.SITTING_DOWN
        return Phase.BALANCING if progress.lasting > _UP_TIME_S else Phase.STANDING_UP

    def _is_ending(self, phase: Phase, e: Estimate) -> bool:
        """Whether the robot is where its phase leads to, or has fallen while it balanced."""
        if phase is Phase.STANDING_UP:
            return abs(e.pitch) < _UP_PITCH and abs(e.pitch_rate) < _UP_RATE
        if phase is Phase.LIFTED:
            return abs(e.left_tread) < _RESTS_SPEED and abs(e.right_tread) < _RESTS_SPEED
        is_down = abs(e.pitch) > self._down_pitch
        if phase is Phase.BALANCING:
            return is_down
        return is_down and abs(e.velocity) < _STILL_SPEED and abs(e.pitch_rate) < _STILL_RATE


class Motion(Value, frozen=True):
    """Where the robot should be, and what was sent to get it there.

    Attributes:
        travel, velocity, acceleration: Reference of the travel and its rates; m, m/s, m/s2.
        heading, yaw_rate, yaw_acceleration: Reference of the heading and its rates; rad, rad/s, rad/s2.
        integral: Integral of the travel's error, m s.
        sent, sent_before: Sum of the torques sent last, and the one before, N m.
        turning: Difference of the torques sent last, N m.
        left_slip, right_slip: What each wheel slipped then, m/s.
        left_yield, right_yield: By how much less than the torque limit each wheel may be sent as it slipped, N m.
        held: How long the reference still waits for the robot, s.
    """

    travel: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    heading: float = 0.0
    yaw_rate: float = 0.0
    yaw_acceleration: float = 0.0
    integral: float = 0.0
    sent: float = 0.0
    sent_before: float = 0.0
    turning: float = 0.0
    left_slip: float = 0.0
    right_slip: float = 0.0
    left_yield: float = 0.0
    right_yield: float = 0.0
    held: float = 0.0


class Law:
    """The controller's equations with its parameters."""

    def __init__(self, period: float, p: Mapping[str, float]) -> None:
        """Take the parameters `p` of `segway_ecc.node.models.segway`, which has their units, and the period, s."""
        self._period = period
        self._ramp_part = period / _RAMP_LAG_S
        self._torque_step = p["TorqueSlew"] * period
        self._travel_gain = p["TravelGain"]
        self._velocity_gain = p["VelocityGain"]
        self._pitch_gain = p["PitchGain"]
        self._pitch_rate_gain = p["PitchRateGain"]
        self._sent_gain = p["SentGain"]
        self._sent_before_gain = p["SentBeforeGain"]
        self._integral_gain = p["IntegralGain"]
        self._pitch_per_acceleration = p["PitchPerAcceleration"]
        self._torque_per_acceleration = p["TorquePerAcceleration"]
        self._heading_gain = p["HeadingGain"]
        self._yaw_rate_gain = p["YawRateGain"]
        self._torque_per_yaw_acceleration = p["TorquePerYawAcceleration"]
        self._max_speed = p["MaxSpeed"]
        self._max_acceleration = p["MaxAcceleration"]
        self._max_yaw_rate = p["MaxYawRate"]
        self._max_yaw_acceleration = p["MaxYawAcceleration"]
        self._max_travel_error = p["MaxTravelError"]
        self._max_heading_error = p["MaxHeadingError"]
        self._max_integral = p["MaxIntegral"]
        self._max_turning_torque = p["MaxTurningTorque"]

    def ramped(self, motion: Motion, e: Estimate, linear: float, angular: float) -> Motion:
        """Move the reference for one period towards the set-points, m/s and rad/s, not further ahead than allowed.

        It waits for a robot whose wheel was stopped or has no floor, and for a while afterwards.
        """
        linear, angular = within(linear, self._max_speed), within(angular, self._max_yaw_rate)
        velocity, acceleration = self._ramp(motion.velocity, motion.acceleration, linear, self._max_acceleration)
        yaw_rate, yaw_acceleration = self._ramp(
            motion.yaw_rate, motion.yaw_acceleration, angular, self._max_yaw_acceleration
        )
        held = _HELD_S if e.free != 0.0 else max(motion.held - self._period, 0.0)
        if held:
            motion = replace(motion, travel=e.travel)
            velocity, acceleration = _HELD_SPEED * within(e.velocity, self._max_speed), 0.0
        return replace(
            motion,
            held=held,
            travel=_near(motion.travel + self._period * velocity, e.travel, self._max_travel_error),
            velocity=velocity,
            acceleration=acceleration,
            heading=_near(motion.heading + self._period * yaw_rate, e.heading, self._max_heading_error),
            yaw_rate=yaw_rate,
            yaw_acceleration=yaw_acceleration,
        )

    def _ramp(self, rate: float, acceleration: float, wanted: float, limit: float) -> tuple[float, float]:
        asked = within(_RAMP_RATE * (wanted - rate), limit)
        acceleration += self._ramp_part * (asked - acceleration)
        return rate + self._period * acceleration, acceleration

    def here(self, motion: Motion, e: Estimate) -> Motion:
        """A reference that is where the robot is, at rest; what was sent is kept, and how its wheels slipped."""
        return Motion(
            travel=e.travel,
            heading=e.heading,
            sent=motion.sent,
            sent_before=motion.sent_before,
            turning=motion.turning,
            left_slip=motion.left_slip,
            right_slip=motion.right_slip,
            left_yield=motion.left_yield,
            right_yield=motion.right_yield,
        )

    def rising(self, motion: Motion, e: Estimate, limit: float, *, begins: bool) -> Motion:
        """The reference of a robot that stands up: where it is, and nearly at its speed if a wheel has not all torque.

        When it `begins`, each wheel has the part of `limit`, N m, that most floors carry.
        """
        here = self.here(motion, e)
        if begins:
            first = (1.0 - _FIRST_GRIP) * limit
            return replace(here, left_yield=first, right_yield=first)
        if motion.left_yield == motion.right_yield == motion.velocity == 0.0:
            return here
        return replace(here, velocity=_KEPT_SPEED * min(abs(e.pitch) / _KEPT_PITCH, 1.0) * e.velocity)

    def balanced(self, motion: Motion, e: Estimate, limit: float, *, is_up: bool = False) -> Motion:
        """Send what keeps the robot up and on its way, each wheel within `limit`, N m.

        A robot that `is_up` has its grip back as soon as a wheel rolls; one that rises gains it slowly.
        """
        acceleration, integral, last = motion.acceleration, motion.integral, motion.sent
        ahead = self._torque_per_acceleration * acceleration
        error = e.travel - motion.travel
        u = (
            ahead
            - self._travel_gain * error
            - self._velocity_gain * (e.velocity - motion.velocity)
            - self._pitch_gain * (e.pitch - self._pitch_per_acceleration * acceleration)
            - self._pitch_rate_gain * (_CATCH * e.pitch_rate if motion.held else e.pitch_rate)
            - self._sent_gain * (last - ahead)
            - self._sent_before_gain * (motion.sent_before - ahead)
            - self._integral_gain * integral
        )
        sent = self._reachable(u, last, 2.0 * limit)
        if sent == u:  # what cannot be sent is no reason to ask for more: the integral waits
            integral += self._period * error
        moved = replace(
            motion,
            integral=within(integral, self._max_integral),
            sent=sent,
            sent_before=last,
            turning=self._turning(motion, e, limit, sent),
        )
        if e.left_slip == e.right_slip == motion.left_yield == motion.right_yield == 0.0:  # nearly always
            slipped = is_up and (motion.left_slip != 0.0 or motion.right_slip != 0.0)
            return replace(moved, left_slip=0.0, right_slip=0.0) if slipped else moved
        if is_up and motion.left_yield == motion.right_yield == 0.0:
            return _spinning(replace(moved, integral=motion.integral), e, limit)
        return self._gripping(moved, e, limit)

    def _gripping(self, motion: Motion, e: Estimate, limit: float) -> Motion:
        """The same with each wheel's torque as far as its tyre carries it."""
        left, right = torques(motion)
        left_grip = self._grip(limit - motion.left_yield, e.left_slip, left, limit)
        right_grip = self._grip(limit - motion.right_yield, e.right_slip, right, limit)
        left = _carried(left, left_grip, e.left_slip + _SLIP_LEAD * (e.left_slip - motion.left_slip))
        right = _carried(right, right_grip, e.right_slip + _SLIP_LEAD * (e.right_slip - motion.right_slip))
        return replace(
            motion,
            sent=left + right,
            turning=right - left,
            left_slip=e.left_slip,
            right_slip=e.right_slip,
            left_yield=limit - left_grip,
            right_yield=limit - right_grip,
        )

    def _grip(self, grip: float, slip: float, torque: float, limit: float) -> float:
        """The most torque that a wheel may have, N m, one period later: less where the torque adds to its slip."""
        if slip * torque > 0.0:
            return max(min(grip, abs(torque)) * (1.0 - _YIELD_RATE * self._period), _LEAST_GRIP * limit)
        return min(grip + _REGAIN_RATE * limit * self._period, limit)

    def braked(self, motion: Motion, torque: float, limit: float) -> Motion:
        """Send a sum of torques, N m, and hold no heading."""
        sent = self._reachable(torque, motion.sent, 2.0 * limit)
        return replace(motion, sent=sent, sent_before=motion.sent, turning=0.0)

    def lifted(self, motion: Motion, e: Estimate, limit: float) -> Motion:
        """Brake each wheel until it rests against the body, with no more than `limit`, N m."""
        left = _stilled(e.left_tread, motion.left_slip, limit)
        right = _stilled(e.right_tread, motion.right_slip, limit)
        return replace(
            motion,
            sent=left + right,
            sent_before=motion.sent,
            turning=right - left,
            left_slip=e.left_tread,
            right_slip=e.right_tread,
        )

    def _reachable(self, torque: float, sent: float, limit: float) -> float:
        """The nearest torque that the motors can give, and that is not too far from the one before."""
        return within(_near(torque, sent, self._torque_step), limit)

    def _turning(self, motion: Motion, e: Estimate, limit: float, sent: float) -> float:
        """Difference of torques, right less left: balance comes first, and turning has what it leaves."""
        wanted = (
            self._torque_per_yaw_acceleration * motion.yaw_acceleration
            - self._heading_gain * (e.heading - motion.heading)
            - self._yaw_rate_gain * (e.yaw_rate - motion.yaw_rate)
        )
        return within(wanted, min(self._max_turning_torque, 2.0 * limit - abs(sent)))


def torques(motion: Motion) -> tuple[float, float]:
    """What was sent last to the left and to the right wheel, N m."""
    sent, turning = motion.sent, motion.turning
    return 0.5 * (sent - turning), 0.5 * (sent + turning)


def _spinning(motion: Motion, e: Estimate, limit: float) -> Motion:
    """What is sent to wheels of which one spins, of no more than `limit`, N m, to each."""
    if e.falling >= _FALLS_S:
        left, right = _braking(e.left_slip, limit), _braking(e.right_slip, limit)
    else:
        left, right = torques(motion)
        left = _held_back(left, limit, e.left_slip, motion.left_slip)
        right = _held_back(right, limit, e.right_slip, motion.right_slip)
    return replace(motion, sent=left + right, turning=right - left, left_slip=e.left_slip, right_slip=e.right_slip)


def _held_back(torque: float, limit: float, slip: float, before: float) -> float:
    """What of a torque is sent to a wheel that slips, m/s, and slipped so much in the period before."""
    if slip * torque <= 0.0:
        return within(torque, limit)
    foreseen = abs(slip) + _SPIN_LEAD * (abs(slip) - abs(before))
    left = limit - _SLIP_GAIN * max(foreseen - _SPINS, 0.0)
    return within(torque, left) if left >= 0.0 else -copysign(min(-left, _LARGEST_BRAKE, limit), torque)


def _braking(slip: float, limit: float) -> float:
    """What brakes a wheel that slips, m/s, of no more than `limit`, N m."""
    return -within(_BRAKE_PER_SLIP * slip, min(_LARGEST_BRAKE, limit))


def _stilled(speed: float, before: float, limit: float) -> float:
    """What stops a wheel that turns at a speed, m/s, and turned so fast a period before."""
    foreseen = speed + _BRAKE_LEAD * (speed - before)
    return -within(_LIFTED_BRAKE * foreseen, min(_LARGEST_BRAKE, limit))


def stopped(motion: Motion) -> Motion:
    """Send nothing."""
    return replace(
        motion, sent=0.0, sent_before=motion.sent, turning=0.0, integral=0.0, left_yield=0.0, right_yield=0.0
    )


def _carried(torque: float, grip: float, slip: float) -> float:
    """What of a torque is sent to a wheel that has some grip, N m, and slips, m/s."""
    return within(torque, max(grip - _SLIP_GAIN * abs(slip), 0.0) if slip * torque > 0.0 else grip)


def _near(value: float, centre: float, distance: float) -> float:
    low, high = centre - distance, centre + distance
    return value if low <= value <= high else min(max(value, low), high)
