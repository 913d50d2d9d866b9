# SPDX-License-Identifier: MIT
"""The segway as a plant whose wheels touch the ground: they slip, lift off and climb; see `contact_body`, `terrain`.

Motors, battery, encoders and IMU are those of `segway_ecc.hil.plants.segway`, and so are inputs, outputs and
parameters; x and y are those of the axle's middle. What is added:

- `LeftFriction`, `RightFriction`: of each tyre on the floor, may be written at any time;
- `Lift`: how far a hand lifts the robot at its top, m; at 0 it lets go;
- the terrain's parameters, such as `KerbAt` and `KerbHeight`;
- imperfections: `Cogging`, `Backlash`, `CableDrag`, `ImuVibration`, zero by default.

It needs MuJoCo: `pip install 'segway-ecc[contact]'`.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import ClassVar, Final

from segway_ecc.hil.plants import segway
from segway_ecc.hil.plants.contact_body import ContactBody
from segway_ecc.hil.plants.segway_hardware import Battery, Encoder, Imu, TorqueMotor, VoltageMotor
from segway_ecc.hil.plants.terrain import TERRAIN_VARIABLES, Terrain
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.segway_parameters import SegwayParameters

_COGS: Final = 84
"""Of cogging a turn of the motor: that many teeth has a motor of 21 pole pairs with 36 slots, divided by three."""
_DRAG_SPEED: Final = 0.02
"""Speed at which a cable's drag reaches 76 %, m/s."""
_SHAKES_PER_TURN: Final = 7.0
"""Vibrations of the IMU for each turn of a wheel."""


def _imperfection(name: str, unit: str, most: float, text: str) -> Variable:
    return Variable(name, unit, 0.0, Write.RESET, text, minimum=0.0, maximum=most)


_PARAMETERS: Final = (
    *segway.PARAMETERS,
    *TERRAIN_VARIABLES,
    _imperfection("Cogging", "N m", 1.0, "amplitude at the wheel"),
    _imperfection("Backlash", "rad", 0.1, "between rotor and wheel"),
    _imperfection("CableDrag", "N", 20.0, "of a cable that is pulled along"),
    _imperfection("ImuVibration", "m/s2", 50.0, "amplitude at 1 m/s, in proportion to the speed"),
)
_FRICTION: Final = 0.8
"""Of rubber on an ordinary floor."""
_STATES: Final = (
    *(variable for variable in segway.DISTURBANCES if variable.name != "Payload"),
    Variable(
        "Payload", "kg", 0.0, Write.NOW, "none below zero: MuJoCo has no such mass; make BodyMass less", minimum=0.0
    ),
    Variable("LeftFriction", "1", _FRICTION, Write.NOW, minimum=0.01, maximum=5.0),
    Variable("RightFriction", "1", _FRICTION, Write.NOW, minimum=0.01, maximum=5.0),
    Variable("Lift", "m", 0.0, Write.NOW, minimum=0.0, maximum=2.0),
)


class _SegwayOnGround(SectionedModel):
    """What both plants have."""

    step_size = segway.STEP_SIZE
    method = Method.DISCRETE
    parameters = _PARAMETERS
    outputs = segway.OUTPUTS
    states = _STATES
    motor: ClassVar[type[TorqueMotor | VoltageMotor]]

    def static(self) -> None:
        """Put the robot together and stand it on the ground."""
        values = self.p
        p = SegwayParameters.from_model(values)
        seed = int(values["Seed"])
        pitch = values["InitialPitch"]
        self.body = ContactBody(p, Terrain.from_model(values), pitch, backlash=values["Backlash"], seed=seed)
        self.battery = Battery(p)
        self._motors = [self.motor(p, self.step_size), self.motor(p, self.step_size)]
        self._disturbance: tuple[float, ...] = ()
        self._disturb()
        share = values["SensorErrors"]
        if not share:
            p = dataclasses.replace(p, encoder_counts_per_turn=0.0)
        self._encoders = [Encoder(p, self.step_size, angle) for angle in self.body.wheel_angles()]
        self._shaken = self.body.measured_motion()
        self._imu = Imu(segway.imu_errors(values), self.step_size, seed, self._shaken) if share else None

    def input(self, u: Sequence[float]) -> None:
        """Take the commands of the drives, N m or V."""
        self._commands = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - nothing depends on the time
        """Move on by one step; what was written to the states stays."""
        self._disturb()
        body, before, speeds = self.body, self.body.wheel_angles(), self.body.wheel_speeds()
        torques = [
            motor.torque(command, speed, self.battery.voltage) - self.p["Cogging"] * math.sin(_COGS * angle)
            for motor, command, speed, angle in zip(self._motors, self._commands, speeds, before, strict=True)
        ]
        drag = self.p["CableDrag"] * math.tanh(body.v / _DRAG_SPEED)
        body.push(self.s[0] - drag)
        body.step(self.step_size, *torques)
        self.battery.deliver(sum(motor.power for motor in self._motors))
        after, rates = body.wheel_angles(), body.wheel_speeds()
        for place, encoder in enumerate(self._encoders):
            encoder.follow(before[place], speeds[place], after[place], rates[place], 1)
        self._shake()
        return s

    def _shake(self) -> None:
        """Have the IMU measure, with the vibration of what rolls."""
        *rates, ahead, left, up = self.body.measured_motion()
        shake = self.p["ImuVibration"] * self.body.v * math.sin(_SHAKES_PER_TURN * self.body.wheel_angles()[0])
        self._shaken = (*rates, ahead + shake, left, up + shake)
        if self._imu is not None:
            self._imu.add_sample(self._steps + 1, self._shaken)
            self._shaken = self._imu.show(self._steps + 1)

    def _disturb(self) -> None:
        disturbance = tuple(self.s)
        if disturbance == self._disturbance:
            return
        before, self._disturbance = self._disturbance, disturbance
        _force, slope, payload, left, right, lift = disturbance
        if slope != self.body.slope:
            self.body.tilt(slope)
        if not before or before[2] != payload:
            self.body.load(payload, self.p["PayloadHeight"])
        self.body.set_friction(left, right)
        self.body.lift(lift)

    def output(self) -> Sequence[float]:
        """Encoders, IMU, and how it really is."""
        left, right = self._encoders
        return segway.shown(left, right, self._shaken, (self.body.x, self.body.y), self.body, self.battery)


class SegwayContactTorquePlant(_SegwayOnGround):
    """Two wheel torques in (the wheel's, against the body); encoders, IMU and how it really is, out."""

    name = "segway-contact-torque-plant"
    inputs = segway.SegwayTorquePlant.inputs
    motor = TorqueMotor


class SegwayContactPlant(_SegwayOnGround):
    """Two motor voltages in; encoders, IMU and how it really is, out."""

    name = "segway-contact-plant"
    inputs = segway.SegwayPlant.inputs
    motor = VoltageMotor
