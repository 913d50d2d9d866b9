# SPDX-License-Identifier: MIT
"""Telemetry of an axis in ODrive's CANSimple frames, firmware 0.5 and 0.6.

Every value is in the unit of the wire, which its name carries: turns of the motor, not radians; `frames` makes them
SI. A message that only one firmware has is marked. Source: the DBC files beside this one, and the firmware of ODrive v3
where they are wrong (see the tests).
"""

from typing import NamedTuple


class Heartbeat(NamedTuple):
    """State of an axis; 0.5. `state` is a number, since a newer firmware may have states without a name here."""

    axis_error: int
    state: int
    motor_error: bool = False
    encoder_error: bool = False
    controller_error: bool = False
    trajectory_done: bool = False


class ProcedureHeartbeat(NamedTuple):
    """State of an axis; 0.6. `procedure_result` is how the last calibration or other procedure ended."""

    axis_error: int
    state: int
    procedure_result: int = 0
    trajectory_done: bool = False


class Version(NamedTuple):
    """What the drive is; 0.6."""

    protocol: int
    hardware_major: int
    hardware_minor: int
    hardware_variant: int
    firmware_major: int
    firmware_minor: int
    firmware_revision: int
    unreleased: int


class MotorError(NamedTuple):
    """Error bits of the motor; 0.5, 64 of them."""

    error: int


class EncoderError(NamedTuple):
    """Error bits of the encoder; 0.5."""

    error: int


class SensorlessError(NamedTuple):
    """Error bits of the sensorless estimator; 0.5."""

    error: int


class ControllerError(NamedTuple):
    """Error bits of the controller; 0.5."""

    error: int


class Errors(NamedTuple):
    """Errors that are active, and those that switched the axis off; 0.6."""

    active: int
    disarm_reason: int


class TxSdo(NamedTuple):
    """The value of an endpoint, 0 to 4 bytes; 0.6."""

    endpoint: int
    value: bytes = b""


class EncoderEstimates(NamedTuple):
    """Position since power-on or calibration, and velocity, of the motor."""

    position_rev: float
    velocity_rev_s: float


class EncoderCount(NamedTuple):
    """Encoder counts, over all turns and within one; 0.5, both signed."""

    shadow_counts: int
    counts_in_turn: int


class Currents(NamedTuple):
    """Motor current that makes torque: asked for, and measured."""

    setpoint_a: float
    measured_a: float


class SensorlessEstimates(NamedTuple):
    """Position and velocity by the sensorless estimator; 0.5."""

    position_rev: float
    velocity_rev_s: float


class Temperatures(NamedTuple):
    """Of transistors and motor, degree Celsius; None where there is no sensor; 0.6."""

    transistors_c: float | None
    motor_c: float | None


class BusVoltageCurrent(NamedTuple):
    """Supply voltage and current."""

    voltage_v: float
    current_a: float


class AdcVoltage(NamedTuple):
    """Voltage at the pin that the request named; 0.5."""

    voltage_v: float


class Torques(NamedTuple):
    """Torque of the motor: asked for, and estimated; 0.6."""

    target_nm: float
    estimate_nm: float


class Powers(NamedTuple):
    """Electrical and mechanical power; 0.6."""

    electrical_w: float
    mechanical_w: float
