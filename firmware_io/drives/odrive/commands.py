# SPDX-License-Identifier: MIT
"""Commands of the host to an axis in ODrive's CANSimple frames, firmware 0.5 and 0.6.

Every value is in the unit of the wire, which its name carries: turns of the motor, not radians. A message that only one
firmware has is marked. Source: the DBC files beside this one.
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


class RxSdo(NamedTuple):
    """Read (opcode 0), or write or call (1), an endpoint by its number in that very firmware; 0.6."""

    opcode: int
    endpoint: int
    value: bytes = b""


class Address(NamedTuple):
    """Node id, 48-bit serial number and, from 0.6.11 on, connection id; 0.6, both ways."""

    node_id: int
    serial_number: int
    connection_id: int | None = None


class SetAxisNodeId(NamedTuple):
    """Change the node id; 0.5."""

    node_id: int


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


class StartAnticogging(NamedTuple):
    """Begin the anticogging calibration; 0.5."""


class SetTrajectoryVelocityLimit(NamedTuple):
    """Largest velocity of a planned move."""

    velocity_rev_s: float


class SetTrajectoryAccelerationLimits(NamedTuple):
    """Largest acceleration and deceleration of a planned move."""

    acceleration_rev_s2: float
    deceleration_rev_s2: float


class SetTrajectoryInertia(NamedTuple):
    """Torque for an acceleration."""

    inertia_nm_per_rev_s2: float


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


class SetPositionGain(NamedTuple):
    """Gain of the position controller, (rev/s)/rev."""

    gain_per_s: float


class SetVelocityGains(NamedTuple):
    """Gains of the velocity controller."""

    gain_nm_per_rev_s: float
    integrator_gain_nm_per_rev: float


class EnterDfuMode(NamedTuple):
    """Go to the boot loader; 0.6."""
