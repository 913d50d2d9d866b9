# SPDX-License-Identifier: MIT
"""The names of ODrive's axis errors.

Sources: `Axis.Error` of the ODrive v3 firmware 0.5.6; the value table of Axis_Error in the DBC of 0.6.10.
"""

from collections.abc import Mapping
from typing import Final

from segway_ecc.firmware_io.drives.odrive.frames import Firmware

AXIS_ERRORS: Final[Mapping[Firmware, Mapping[int, str]]] = {
    Firmware.V0_5: {
        0x1: "INVALID_STATE",
        0x40: "MOTOR_FAILED",
        0x80: "SENSORLESS_ESTIMATOR_FAILED",
        0x100: "ENCODER_FAILED",
        0x200: "CONTROLLER_FAILED",
        0x800: "WATCHDOG_TIMER_EXPIRED",
        0x1000: "MIN_ENDSTOP_PRESSED",
        0x2000: "MAX_ENDSTOP_PRESSED",
        0x4000: "ESTOP_REQUESTED",
        0x20000: "HOMING_WITHOUT_ENDSTOP",
        0x40000: "OVER_TEMP",
        0x80000: "UNKNOWN_POSITION",
    },
    Firmware.V0_6: {
        0x1: "INITIALIZING",
        0x2: "SYSTEM_LEVEL",
        0x4: "TIMING_ERROR",
        0x8: "MISSING_ESTIMATE",
        0x10: "BAD_CONFIG",
        0x20: "DRV_FAULT",
        0x40: "MISSING_INPUT",
        0x100: "DC_BUS_OVER_VOLTAGE",
        0x200: "DC_BUS_UNDER_VOLTAGE",
        0x400: "DC_BUS_OVER_CURRENT",
        0x800: "DC_BUS_OVER_REGEN_CURRENT",
        0x1000: "CURRENT_LIMIT_VIOLATION",
        0x2000: "MOTOR_OVER_TEMP",
        0x4000: "INVERTER_OVER_TEMP",
        0x8000: "VELOCITY_LIMIT_VIOLATION",
        0x10000: "POSITION_LIMIT_VIOLATION",
        0x1000000: "WATCHDOG_TIMER_EXPIRED",
        0x2000000: "ESTOP_REQUESTED",
        0x4000000: "SPINOUT_DETECTED",
        0x8000000: "BRAKE_RESISTOR_DISARMED",
        0x10000000: "THERMISTOR_DISCONNECTED",
        0x40000000: "CALIBRATION_ERROR",
    },
}
"""Names by bit."""
WATCHDOG: Final[Mapping[Firmware, int]] = {Firmware.V0_5: 0x800, Firmware.V0_6: 0x1000000}
"""The bit that the watchdog expired."""


def error_names(firmware: Firmware, errors: int) -> tuple[str, ...]:
    """The names of the bits that are set, lowest first; a bit without a name is given as a number."""
    names = AXIS_ERRORS[firmware]
    bits = (1 << index for index in range(errors.bit_length()) if errors >> index & 1)
    return tuple(names.get(bit, f"0x{bit:X}") for bit in bits)
