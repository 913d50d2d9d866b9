# SPDX-License-Identifier: MIT
"""The segway as a plant: a body that balances on two wheels, behind drives of torque or of voltage.

The equations of motion, and what they leave out, are in `segway_ecc.hil.plants.segway_body`; motors,
battery, encoders and IMU in `segway_ecc.hil.plants.segway_hardware`; the numbers in
`segway_ecc.node.models.segway_parameters`. It starts at rest at the pitch `InitialPitch`; exactly upright and without
torque it stays there, at anything else it falls, until it lies on a bumper.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar, Final, Protocol

from segway_ecc.hil.plants.cart import IMU_OUTPUTS, POSE_OUTPUTS, WHEEL_OUTPUTS
from segway_ecc.hil.plants.placing import WheelMotion, place_body
from segway_ecc.hil.plants.segway_body import SegwayBody
from segway_ecc.hil.plants.segway_hardware import (
    MOST_STEPS,
    Battery,
    Encoder,
    Imu,
    ImuErrors,
    TorqueMotor,
    VoltageMotor,
)
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.models.segway_parameters import VARIABLES, SegwayParameters

STEP_SIZE: Final = 0.001
_MOST_STIFF: Final = 1.0
"""How much of its way to rest friction may go in one substep: the method is stable up to 2.8, and exact far below."""
_SETTLING_STEPS: Final = 5  # of `MOST_STEPS` each: 15 time constants of a motor's current or torque
_TYPICAL: Final = ImuErrors()
# In the order of the fields of ImuErrors.
_IMU_ERRORS: Final = (
    Variable("GyroNoise", "rad/s/sqrt(Hz)", _TYPICAL.gyro_noise),
    Variable("GyroBias", "rad/s", _TYPICAL.gyro_bias),
    Variable("GyroScale", "1", _TYPICAL.gyro_scale),
    Variable("AccelerometerNoise", "m/s2/sqrt(Hz)", _TYPICAL.accelerometer_noise),
    Variable("AccelerometerBias", "m/s2", _TYPICAL.accelerometer_bias),
    Variable("AccelerometerScale", "1", _TYPICAL.accelerometer_scale),
)
PARAMETERS: Final = tuple(
    dataclasses.replace(variable, write=Write.RESET)
    for variable in (
        *VARIABLES,
        Variable("InitialPitch", "rad"),
        Variable("PayloadHeight", "m", 0.5),
        Variable("SensorErrors", "1", 1.0),
        Variable("Seed", "1", 1.0),
        *_IMU_ERRORS,
        Variable("ImuLatency", "s", _TYPICAL.latency),
    )
)
OUTPUTS: Final = (
    *WHEEL_OUTPUTS,
    *IMU_OUTPUTS,
    *POSE_OUTPUTS,
    Variable("truth.pitch", "rad"),
    Variable("truth.pitch_rate", "rad/s"),
    Variable("truth.supply_voltage", "V"),
)
DISTURBANCES: Final = (
    Variable("PushForce", "N", 0.0, Write.NOW),
    Variable("Slope", "rad", 0.0, Write.NOW),
    Variable("Payload", "kg", 0.0, Write.NOW),
)


def imu_errors(values: Mapping[str, float]) -> ImuErrors:
    """Those of a plant's parameters."""
    share = values["SensorErrors"]
    errors = ImuErrors(*(share * values[variable.name] for variable in _IMU_ERRORS))
    return dataclasses.replace(errors, latency=values["ImuLatency"])


class Moving(Protocol):
    """What is shown of a body: m/s, rad/s, rad, rad, rad/s, as its attributes are called in `SegwayBody`."""

    heading: float
    v: float
    w: float
    pitch: float
    q: float


def shown(  # noqa: PLR0913, PLR0917 - all parts of a robot
    left: Encoder, right: Encoder, imu: Sequence[float], place: tuple[float, float], body: Moving, battery: Battery
) -> Sequence[float]:
    """The values of `OUTPUTS`: encoders, IMU, and how it really is."""
    wheels = left.angle, left.velocity, right.angle, right.velocity
    return (*wheels, *imu, *place, body.heading, body.v, body.w, body.pitch, body.q, battery.voltage)


class _Segway(SectionedModel):
    """What both plants have.

    Parameters are taken when it is initialized: those of `SegwayParameters`, `InitialPitch`, `PayloadHeight` above the
    axle, and those of its sensors, which `SensorErrors` multiplies: at 0 the sensors are perfect, without noise, bias,
    wrong scale, latency or counts. `Seed` is a whole number; the same one gives the same run.

    x and y are counted along the ground, which on a slope is not level.
    """

    step_size = STEP_SIZE
    method = Method.DISCRETE
    parameters = PARAMETERS
    outputs = OUTPUTS
    states = DISTURBANCES
    motor: ClassVar[type[TorqueMotor | VoltageMotor]]

    def static(self) -> None:
        """Put the robot together and stand it up."""
        p = SegwayParameters.from_model(self.p)
        self.body, self.battery = SegwayBody(p), Battery(p)
        self.body.pitch = self.p["InitialPitch"]
        self._left_motor, self._right_motor = self.motor(p, STEP_SIZE), self.motor(p, STEP_SIZE)
        self._place_x = self._place_y = 0.0
        self._moved = 0
        self._disturbance: tuple[float, ...] = ()
        self._disturb()
        self._imu_height = p.imu_height
        self._make_sensors(p)

    def begin_at(self, motion: WheelMotion, u: Sequence[float]) -> Sequence[float]:
        """See `Placeable.begin_at`."""
        p, body, motors = SegwayParameters.from_model(self.p), self.body, (self._left_motor, self._right_motor)
        place_body(body, motion, p)
        speeds = body.wheel_speeds()
        for motor, command, speed in zip(motors, u, speeds, strict=True):
            for _ in range(_SETTLING_STEPS):
                motor.torque(command, speed, self.battery.voltage, MOST_STEPS)
        body.accelerate(*(motor.present_torque for motor in motors))
        self._make_sensors(p)
        encoders = self._left_encoder, self._right_encoder
        for encoder, speed, rate in zip(encoders, speeds, body.wheel_accelerations(), strict=True):
            encoder.velocity = speed - p.encoder_filter_time * rate  # the filter follows a ramp by as much late
        return self.output()

    def _make_sensors(self, p: SegwayParameters) -> None:
        """Switch encoders and IMU on, in the body's present motion."""
        share = self.p["SensorErrors"]
        if not share:
            p = dataclasses.replace(p, encoder_counts_per_turn=0.0)
        left, right = self.body.wheel_angles()
        self._left_encoder, self._right_encoder = Encoder(p, STEP_SIZE, left), Encoder(p, STEP_SIZE, right)
        body, height = self.body, self._imu_height
        self._imu_sample = body.measured_motion(height)
        self._imu = None
        if share:
            seed, motion_of = int(self.p["Seed"]), partial(body.measured_motion, height)
            self._imu = Imu(imu_errors(self.p), STEP_SIZE, seed, body.state, motion_of)

    def input(self, u: Sequence[float]) -> None:
        """Take the commands of the drives, N m or V."""
        self._left_command, self._right_command = u

    def step(self, u: Sequence[float]) -> list[float]:
        """Make one step; what was written to the states stays; see `Model.step`."""
        return self.advance(u, 1)

    def advance(self, u: Sequence[float], steps: int) -> list[float]:
        """Make some steps at once with the same inputs; returns the outputs after the last one; see `Advancing`.

        What moves is integrated in substeps of up to `MOST_STEPS` steps where friction is not too stiff for it, and the
        IMU measures only what will be shown. Encoders count at every step.
        """
        return self._advance_all(u, steps, is_seen=True)

    def advance_unseen(self, u: Sequence[float], steps: int) -> list[float]:
        """The same, where the IMU shows what it showed before; see `Unseen`."""
        return self._advance_all(u, steps, is_seen=False)

    def _advance_all(self, u: Sequence[float], steps: int, *, is_seen: bool) -> list[float]:
        self._take_inputs(u)
        self._move(steps, is_seen=is_seen)
        self._steps += steps
        self.time = self._steps * self.step_size
        self._y = list(self.output())
        return self._y

    def _move(self, steps: int, *, is_seen: bool) -> None:
        """Make some steps, in substeps.

        Asked for as many each time, the IMU is to have a sample just as old as its latency at each end.
        """
        self._disturb()
        imu, moved = self._imu, self._moved
        end = moved + steps
        sampled = end - (0 if imu is None else imu.delay % steps)
        while moved < end:
            substep = min((sampled if moved < sampled else end) - moved, self._longest)
            self._advance_substep(substep)
            moved += substep
            if moved == sampled:
                self.body.accelerate(self._left_motor.present_torque, self._right_motor.present_torque)
                if imu is not None:
                    imu.add_sample(moved, self.body.state)
        self._moved = end
        if imu is None:
            self._imu_sample = self.body.measured_motion(self._imu_height)
        elif is_seen:
            self._imu_sample = imu.show(end)
        else:
            imu.pass_over(end)

    def _advance_substep(self, steps: int) -> None:
        """Move motors, body, battery and encoders on, 1 to `MOST_STEPS` steps at a time."""
        body, battery, left_motor, right_motor = self.body, self.battery, self._left_motor, self._right_motor
        h, heading, supply = steps * STEP_SIZE, body.heading, battery.voltage
        old_left, old_right = body.wheel_angles()
        old_left_speed, old_right_speed = body.wheel_speeds()
        left_rate, right_rate = body.wheel_accelerations()
        half = 0.5 * h
        way, turn = body.step(
            h,
            left_motor.torque(self._left_command, old_left_speed + half * left_rate, supply, steps),
            right_motor.torque(self._right_command, old_right_speed + half * right_rate, supply, steps),
        )
        battery.deliver(left_motor.power + right_motor.power)
        ahead = heading + 0.5 * turn
        self._place_x += way * math.cos(ahead)
        self._place_y += way * math.sin(ahead)
        left, right = body.wheel_angles()
        left_speed, right_speed = body.wheel_speeds()
        self._left_encoder.follow(old_left, old_left_speed, left, left_speed, steps)
        self._right_encoder.follow(old_right, old_right_speed, right, right_speed, steps)

    def _disturb(self) -> None:
        disturbance = tuple(self.s)
        if disturbance == self._disturbance:
            return
        self._disturbance = disturbance
        force, slope, payload = disturbance
        self.body.push(force)
        self.body.tilt(slope)
        self.body.load(payload, self.p["PayloadHeight"])
        stiffness = self.body.friction_rate * STEP_SIZE
        self._longest = next((steps for steps in range(MOST_STEPS, 1, -1) if steps * stiffness <= _MOST_STIFF), 1)

    def output(self) -> Sequence[float]:
        """Encoders, IMU, and how it really is."""
        place = self._place_x, self._place_y
        return shown(self._left_encoder, self._right_encoder, self._imu_sample, place, self.body, self.battery)


class SegwayTorquePlant(_Segway):
    """Two wheel torques in (the wheel's, against the body); encoders, IMU and how it really is, out."""

    name = "segway-torque-plant"
    inputs = (Variable("left.torque", "N m"), Variable("right.torque", "N m"))
    motor = TorqueMotor


class SegwayPlant(_Segway):
    """Two motor voltages in; encoders, IMU and how it really is, out."""

    name = "segway-plant"
    inputs = (Variable("left.voltage", "V"), Variable("right.voltage", "V"))
    motor = VoltageMotor
