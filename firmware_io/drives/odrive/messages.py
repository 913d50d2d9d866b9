# SPDX-License-Identifier: MIT
"""The messages of ODrive's CANSimple frames that are used here: the host's commands, then an axis' telemetry.

Every value is in the unit of the wire, which its name carries: turns of the motor, not radians; `frames` makes them SI.
A message that only one firmware, 0.5 or 0.6, has is marked. Source: the DBC files beside this one, and the firmware of
ODrive v3 where they are wrong (see the tests).
"""

import enum
from typing import Final, NamedTuple


@enum.unique
class AxisState(enum.IntEnum):
    """States of an axis, and what may be asked of it."""

    UNDEFINED = 0
    IDLE = 1
    STARTUP_SEQUENCE = 2
    FULL_CALIBRATION_SEQUENCE = 3
    MOTOR_CALIBRATION = 4
    SENSORLESS_CONTROL = 5
    ENCODER_INDEX_SEARCH = 6
    ENCODER_OFFSET_CALIBRATION = 7
    CLOSED_LOOP_CONTROL = 8
    LOCKIN_SPIN = 9
    ENCODER_DIR_FIND = 10
    HOMING = 11
    ENCODER_HALL_POLARITY_CALIBRATION = 12
    ENCODER_HALL_PHASE_CALIBRATION = 13
    ANTICOGGING_CALIBRATION = 14


TORQUE_CONTROL: Final = 1
"""Control mode: the input is a torque."""
PASSTHROUGH: Final = 1
"""Input mode: the input takes effect as it is."""


class Estop(NamedTuple):
    """Switch the axis off with an error."""


class SetAxisState(NamedTuple):
    """Ask for a state; see `AxisState`."""

    state: int


class SetControllerMode(NamedTuple):
    """Control mode: 0 voltage, 1 torque, 2 velocity, 3 position. Input mode: 1 passthrough."""

    control_mode: int
    input_mode: int


class SetInputPosition(NamedTuple):
    """Position with feedforward, each within +-32.767: the scale of the feedforwards is 0.001 unless configured."""

    position_rev: float
    velocity_rev_s: float = 0.0
    torque_nm: float = 0.0


class SetInputVelocity(NamedTuple):
    """Velocity, with a torque feedforward."""

    velocity_rev_s: float
    torque_nm: float = 0.0


class SetInputTorque(NamedTuple):
    """Torque of the motor."""

    torque_nm: float


class SetLimits(NamedTuple):
    """Limits of velocity and of motor current."""

    velocity_rev_s: float
    current_a: float


class Reboot(NamedTuple):
    """Restart the board; 0.5."""


class RebootAction(NamedTuple):
    """Restart (0), save (1) or erase (2) the configuration; 0.6."""

    action: int = 0


class ClearErrors(NamedTuple):
    """Clear the errors of all axes of the board; 0.5."""


class ClearAxisErrors(NamedTuple):
    """Clear the errors of the axis; `identify` makes its light blink; 0.6."""

    identify: int = 0


class SetLinearCount(NamedTuple):
    """Set the position, counts; 0.5."""

    counts: int


class SetAbsolutePosition(NamedTuple):
    """Set the position; 0.6."""

    position_rev: float


class Heartbeat(NamedTuple):
    """State of an axis; 0.5. `state` is a number, since a newer firmware may have states without a name here."""

    axis_error: int
    state: int


class ProcedureHeartbeat(NamedTuple):
    """State of an axis; 0.6. `procedure_result` is how the last calibration or other procedure ended."""

    axis_error: int
    state: int
    procedure_result: int = 0


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


class ControllerError(NamedTuple):
    """Error bits of the controller; 0.5."""

    error: int


class Errors(NamedTuple):
    """Errors that are active, and those that switched the axis off; 0.6."""

    active: int
    disarm_reason: int


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


class Temperatures(NamedTuple):
    """Of transistors and motor, degree Celsius; None where there is no sensor; 0.6."""

    transistors_c: float | None
    motor_c: float | None


class BusVoltageCurrent(NamedTuple):
    """Supply voltage and current."""

    voltage_v: float
    current_a: float


class Torques(NamedTuple):
    """Torque of the motor: asked for, and estimated; 0.6."""

    target_nm: float
    estimate_nm: float


class Powers(NamedTuple):
    """Electrical and mechanical power; 0.6."""

    electrical_w: float
    mechanical_w: float
