"""The segway as a plant: a body that balances on two wheels, behind drives of torque or of voltage.

The equations of motion, and what they leave out, are in `hil.plants.segway_body`; motors and battery in
`hil.plants.segway_motors`; encoders and IMU in `hil.plants.segway_sensors`; the numbers in
`node.models.segway_parameters`. It starts at rest at the pitch `InitialPitch`; exactly upright and without torque it
stays there, at anything else it falls, until it lies on a bumper.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import ClassVar, Final

from hil.plants.outputs import IMU_OUTPUTS, POSE_OUTPUTS, WHEEL_OUTPUTS
from hil.plants.segway_body import SegwayBody
from hil.plants.segway_motors import Battery, TorqueMotor, VoltageMotor
from hil.plants.segway_sensors import Encoder, Imu, ImuErrors, Motion, measured_motion
from node.model.methods import Method
from node.model.sectioned import SectionedModel
from node.model.variables import Variable, Write
from node.models.segway_parameters import VARIABLES, SegwayParameters

STEP_SIZE: Final = 0.001

_TYPICAL: Final = ImuErrors()
_SENSOR_PARAMETERS: Final = (
    Variable("SensorErrors", "1", 1.0),
    Variable("Seed", "1", 1.0),
    Variable("GyroNoise", "rad/s/sqrt(Hz)", _TYPICAL.gyro_noise),
    Variable("GyroBias", "rad/s", _TYPICAL.gyro_bias),
    Variable("GyroScale", "1", _TYPICAL.gyro_scale),
    Variable("AccelerometerNoise", "m/s2/sqrt(Hz)", _TYPICAL.accelerometer_noise),
    Variable("AccelerometerBias", "m/s2", _TYPICAL.accelerometer_bias),
    Variable("AccelerometerScale", "1", _TYPICAL.accelerometer_scale),
    Variable("ImuLatency", "s", _TYPICAL.latency),
)
_PARAMETERS: Final = tuple(
    dataclasses.replace(variable, write=Write.RESET)
    for variable in (
        *VARIABLES,
        Variable("InitialPitch", "rad"),
        Variable("PayloadHeight", "m", 0.5),
        *_SENSOR_PARAMETERS,
    )
)
_OUTPUTS: Final = (
    *WHEEL_OUTPUTS,
    *IMU_OUTPUTS,
    *POSE_OUTPUTS,
    Variable("truth.pitch", "rad"),
    Variable("truth.pitch_rate", "rad/s"),
    Variable("truth.supply_voltage", "V"),
)


class _Segway(SectionedModel):
    """What both plants have.

    Parameters are taken when it is initialized: those of `SegwayParameters`, `InitialPitch`, `PayloadHeight` above the
    axle, and those of its sensors, which `SensorErrors` multiplies: at 0 the sensors are perfect, without noise, bias,
    wrong scale, latency or counts. `Seed` is a whole number; the same one gives the same run.

    x and y are counted along the ground, which on a slope is not level.

    Attributes:
        body: The mechanics.
        battery: The supply.
    """

    step_size = STEP_SIZE
    method = Method.DISCRETE
    parameters = _PARAMETERS
    outputs = _OUTPUTS
    states = (
        Variable("PushForce", "N", 0.0, Write.NOW),
        Variable("Slope", "rad", 0.0, Write.NOW),
        Variable("Payload", "kg", 0.0, Write.NOW),
    )
    motor: ClassVar[type[TorqueMotor | VoltageMotor]]

    def static(self) -> None:
        """Put the robot together and stand it up."""
        p = SegwayParameters.from_model(self.p)
        self.body, self.battery = SegwayBody(p), Battery(p)
        self.body.pitch = self.p["InitialPitch"]
        self._left_motor, self._right_motor = self.motor(p, STEP_SIZE), self.motor(p, STEP_SIZE)
        self._place_x = self._place_y = 0.0
        self._disturbance: tuple[float, ...] = ()
        self._disturb()
        self._gravity, self._imu_height = p.gravity, p.imu_height
        self._build_sensors(p)

    def _build_sensors(self, p: SegwayParameters) -> None:
        share = self.p["SensorErrors"]
        if not share:
            p = dataclasses.replace(p, encoder_counts_per_turn=0.0)
        left, right = self.body.wheel_angles()
        self._left_encoder, self._right_encoder = Encoder(p, STEP_SIZE, left), Encoder(p, STEP_SIZE, right)
        self._imu_sample = motion = self._motion()
        self._imu = Imu(self._imu_errors(share), STEP_SIZE, int(self.p["Seed"]), motion) if share else None

    def _imu_errors(self, share: float) -> ImuErrors:
        p = self.p
        return ImuErrors(
            gyro_noise=share * p["GyroNoise"],
            gyro_bias=share * p["GyroBias"],
            gyro_scale=share * p["GyroScale"],
            accelerometer_noise=share * p["AccelerometerNoise"],
            accelerometer_bias=share * p["AccelerometerBias"],
            accelerometer_scale=share * p["AccelerometerScale"],
            latency=p["ImuLatency"],
        )

    def input(self, u: Sequence[float]) -> None:
        """Take the commands of the drives, N m or V."""
        self._left_command, self._right_command = u

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:  # noqa: ARG002 - autonomous
        """Move everything by one step; what was written to the states stays."""
        self._disturb()
        body, supply = self.body, self.battery.voltage
        left_speed, right_speed = body.wheel_speeds()
        left = self._left_motor.torque(self._left_command, left_speed, supply)
        right = self._right_motor.torque(self._right_command, right_speed, supply)
        heading = body.heading
        way, turn = body.step(STEP_SIZE, left, right)
        self._place_x += way * math.cos(heading + 0.5 * turn)
        self._place_y += way * math.sin(heading + 0.5 * turn)
        self.battery.deliver(self._left_motor.power + self._right_motor.power)
        self._sample()
        return s

    def _disturb(self) -> None:
        disturbance = tuple(self.s)
        if disturbance == self._disturbance:
            return
        self._disturbance = disturbance
        force, slope, payload = disturbance
        self.body.push(force)
        self.body.tilt(slope)
        self.body.load(payload, self.p["PayloadHeight"])

    def _sample(self) -> None:
        body = self.body
        left_angle, right_angle = body.wheel_angles()
        left_speed, right_speed = body.wheel_speeds()
        self._left_encoder.sample(left_angle, left_speed)
        self._right_encoder.sample(right_angle, right_speed)
        motion = self._motion()
        self._imu_sample = motion if self._imu is None else self._imu.sample(motion)

    def _motion(self) -> Sequence[float]:
        b = self.body
        motion = Motion(b.v, b.q, b.w, b.dv, b.dq, b.dw, b.pitch + b.slope, b.pitch)
        return measured_motion(motion, self._imu_height, self._gravity)

    def output(self) -> Sequence[float]:
        """Encoders, IMU, and how it really is."""
        left, right, body = self._left_encoder, self._right_encoder, self.body
        return (
            left.angle,
            left.velocity,
            right.angle,
            right.velocity,
            *self._imu_sample,
            self._place_x,
            self._place_y,
            body.heading,
            body.v,
            body.w,
            body.pitch,
            body.q,
            self.battery.voltage,
        )


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
