# SPDX-License-Identifier: MIT
"""The state machine of CiA 402, as the host sees and drives it."""

import enum
from typing import Final


@enum.unique
class DriveState(enum.StrEnum):
    """The states of the profile, by the statusword (0x6041)."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"


class Controlword(enum.IntEnum):
    """The commands of the profile (0x6040)."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


_BY_SIX_BITS: Final = {
    0x21: DriveState.READY,
    0x23: DriveState.SWITCHED_ON,
    0x27: DriveState.OPERATION_ENABLED,
    0x07: DriveState.QUICK_STOP_ACTIVE,
}
_BY_FIVE_BITS: Final = {
    0x00: DriveState.NOT_READY,
    0x40: DriveState.SWITCH_ON_DISABLED,
    0x08: DriveState.FAULT,
    0x0F: DriveState.FAULT_REACTION_ACTIVE,
}


def state_of(statusword: int) -> DriveState | None:
    """The state that a statusword carries, by the profile's masks; None for one that the profile does not know."""
    return _BY_SIX_BITS.get(statusword & 0x6F) or _BY_FIVE_BITS.get(statusword & 0x4F)


WITHOUT_TORQUE: Final = frozenset(
    {
        DriveState.NOT_READY,
        DriveState.SWITCH_ON_DISABLED,
        DriveState.READY,
        DriveState.SWITCHED_ON,
        DriveState.FAULT,
    }
)
"""The states in which the profile has the drive function disabled; a quick stop and a fault's reaction brake."""

_TOWARDS_OPERATION: Final = {
    DriveState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    DriveState.READY: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: Controlword.ENABLE_OPERATION,
}


def step_towards_operation(state: DriveState | None, last_sent: int) -> Controlword:
    """The controlword of the next step to "operation enabled"; disables the voltage where there is nothing better.

    A fault is reset by a rising edge: after a reset something else is sent before the next.
    """
    if state is DriveState.FAULT and last_sent != Controlword.FAULT_RESET:
        return Controlword.FAULT_RESET
    return _TOWARDS_OPERATION.get(state, Controlword.DISABLE_VOLTAGE) if state else Controlword.DISABLE_VOLTAGE
