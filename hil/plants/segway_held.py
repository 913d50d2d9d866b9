# SPDX-License-Identifier: MIT
"""The segway in a person's hands: tilted, turned and pushed as its states say, wheels in the air or on the floor.

The body is where the hands hold it, whatever the motors do. In the air a wheel turns freely against the body, by
I dw/dt = torque - friction, or with the hand that turns it; on the floor it rolls without slip. Motors, battery,
encoders and IMU are those of `segway_ecc.hil.plants.segway`, and so are inputs, outputs and parameters. The IMU feels
gravity, the turning of the body and the acceleration ahead; what its height above the axle adds is left out, since
hands move slowly. Rates of the body follow from those of its Euler angles, yaw, pitch and roll in this order (REP-103).
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import ClassVar, Final

from segway_ecc.hil.plants import segway
from segway_ecc.hil.plants.segway_hardware import Battery, Encoder, Imu, TorqueMotor, VoltageMotor
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.segway_parameters import SegwayParameters

_SUBSTEPS: Final = 8
"""Of a step, for the friction of a wheel that is nearly at rest."""
_HAND_GAIN: Final = 8.0
"""How briskly a hand ends a movement, 1/s."""
_HAND_TIME: Final = 0.05
"""How soon a hand has its speed, s."""


class _Hand:
    """Moves a value to where it is wanted, no faster than `fastest` per second."""

    def __init__(self, at: float, fastest: float) -> None:
        self.at = self.target = at
        self.speed = self.acceleration = 0.0
        self._fastest = fastest

    def move(self, h: float) -> None:
        """Go on for `h` s."""
        wanted = min(max(_HAND_GAIN * (self.target - self.at), -self._fastest), self._fastest)
        self.acceleration = (wanted - self.speed) / _HAND_TIME
        self.speed += h * self.acceleration
        self.at += h * self.speed


_STATES: Final = (
    Variable("HandPitch", "rad", 0.0, Write.NOW, "how the hands hold the body, nose down positive"),
    Variable("HandRoll", "rad", 0.0, Write.NOW, "the same, right side down positive"),
    Variable("HandYaw", "rad", 0.0, Write.NOW, "the same, to the left positive"),
    Variable("HandTravel", "m", 0.0, Write.NOW, "how far ahead the robot is pushed"),
    Variable("LeftTurn", "rad", 0.0, Write.NOW, "how far a hand turns the left wheel, in the air"),
    Variable("RightTurn", "rad", 0.0, Write.NOW, "the same for the right wheel"),
    Variable("OnFloor", "1", 0.0, Write.NOW, "1 with its wheels on the floor, 0 in the air"),
)
_FASTEST: Final = (1.0, 1.0, 1.5, 0.5, 4.0, 4.0)
"""Of the hands, in the order of the states: rad/s, and m/s."""
_NEAR: Final = 0.01
"""Where a hand that turns a wheel has arrived, rad, and lets go."""


class _HeldSegway(SectionedModel):
    """What both plants have."""

    step_size = segway.STEP_SIZE
    method = Method.DISCRETE
    parameters = segway.PARAMETERS
    outputs = segway.OUTPUTS
    states = _STATES
    motor: ClassVar[type[TorqueMotor | VoltageMotor]]
    pitch = heading = v = w = q = 0.0

    def static(self) -> None:
        """Put the robot together, in the air."""
        p = self._parameters = SegwayParameters.from_model(self.p)
        self.battery = Battery(p)
        self._motors = [self.motor(p, self.step_size) for _ in range(2)]
        self._hands = [_Hand(0.0, fastest) for fastest in _FASTEST]
        self._angles, self._speeds = [0.0, 0.0], [0.0, 0.0]
        self._motion = self._felt()
        share = self.p["SensorErrors"]
        if not share:
            p = dataclasses.replace(p, encoder_counts_per_turn=0.0)
        self._encoders = [Encoder(p, self.step_size, 0.0) for _ in range(2)]
        seed = int(self.p["Seed"])
        self._imu = Imu(segway.imu_errors(self.p), self.step_size, seed, self._motion) if share else None

    def input(self, u: Sequence[float]) -> None:
        """Take the commands of the drives, N m or V."""
        self._commands = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - nothing depends on the time
        """Move on by one step; what was written to the states stays."""
        h, angles, speeds = self.step_size, list(self._angles), list(self._speeds)
        for hand, target in zip(self._hands, s, strict=False):
            hand.target = target
            hand.move(h)
        yaw, pitch, ahead = self._hands[2], self._hands[0], self._hands[3]
        self.pitch, self.q, self.heading, self.w, self.v = pitch.at, pitch.speed, yaw.at, yaw.speed, ahead.speed
        for place, motor in enumerate(self._motors):
            torque = motor.torque(self._commands[place], speeds[place], self.battery.voltage)
            self._turn(place, torque, is_on_floor=s[6] != 0.0)
            self._encoders[place].follow(angles[place], speeds[place], self._angles[place], self._speeds[place], 1)
        self.battery.deliver(sum(motor.power for motor in self._motors))
        self._motion = self._felt()
        if self._imu is not None:
            self._imu.add_sample(self._steps + 1, self._motion)
            self._motion = self._imu.show(self._steps + 1)
        return s

    def _turn(self, place: int, torque: float, *, is_on_floor: bool) -> None:
        """Turn a wheel against the body, left 0 and right 1."""
        p, h, hand = self._parameters, self.step_size, self._hands[4 + place]
        if is_on_floor:
            side = 0.5 * p.track * (1.0 if place else -1.0)
            self._speeds[place] = (self.v + side * self.w) / p.wheel_radius - self.q
            self._angles[place] += h * self._speeds[place]
        elif abs(hand.target - hand.at) > _NEAR:
            self._speeds[place] = hand.speed
            self._angles[place] += h * hand.speed
        else:
            h /= _SUBSTEPS
            speed = self._speeds[place]
            for _ in range(_SUBSTEPS):
                friction = p.viscous_friction * speed + p.coulomb_friction * math.tanh(speed / p.coulomb_speed)
                speed += h * (torque - friction) / p.wheel_inertia
                self._angles[place] += h * speed
            self._speeds[place] = speed

    def _felt(self) -> Sequence[float]:
        """What a perfect IMU shows: rates, rad/s, then specific forces, m/s2."""
        pitch, roll, yaw, ahead = self._hands[0], self._hands[1], self._hands[2], self._hands[3]
        sin_pitch, cos_pitch, sin_roll, cos_roll = (f(hand.at) for hand in (pitch, roll) for f in (math.sin, math.cos))
        g, a = self._parameters.gravity, ahead.acceleration
        return (
            roll.speed - yaw.speed * sin_pitch,
            pitch.speed * cos_roll + yaw.speed * sin_roll * cos_pitch,
            yaw.speed * cos_roll * cos_pitch - pitch.speed * sin_roll,
            a * cos_pitch - g * sin_pitch,
            a * sin_pitch * sin_roll + g * cos_pitch * sin_roll,
            a * sin_pitch * cos_roll + g * cos_pitch * cos_roll,
        )

    def output(self) -> Sequence[float]:
        """Encoders, IMU, and how it really is; x and y are those of a robot that was only pushed straight."""
        left, right = self._encoders
        return segway.shown(left, right, self._motion, (self._hands[3].at, 0.0), self, self.battery)


class HeldSegwayTorquePlant(_HeldSegway):
    """Two wheel torques in; encoders, IMU and how it really is, out."""

    name = "held-segway-torque-plant"
    inputs = segway.SegwayTorquePlant.inputs
    motor = TorqueMotor


class HeldSegwayPlant(_HeldSegway):
    """Two motor voltages in; encoders, IMU and how it really is, out."""

    name = "held-segway-plant"
    inputs = segway.SegwayPlant.inputs
    motor = VoltageMotor
