# SPDX-License-Identifier: MIT
"""What is behind an axis' errors: asked for, named, with the remedy where there is one to give.

A heartbeat of 0.5 names only the part that failed; the part's own error bits are asked for (Get_Motor_Error,
Get_Encoder_Error, Get_Controller_Error). 0.6 reports the errors themselves, and on request what disarmed the axis
(Get_Error). Source: the error enumerations of ODrive firmware 0.5.1 to 0.5.6 and of 0.6.10; an error of the whole
board, such as DC_BUS_OVER_REGEN_CURRENT, is SYSTEM_LEVEL to the motors of 0.5.2 and newer.
"""

from collections.abc import Mapping
from typing import Final

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import WATCHDOG, Firmware, Message, error_names, named_bits

_ASK_EVERY_NS: Final = 50_000_000
_TRIES: Final = 3
_GET_ERROR: Final = 0x03
"""Get_Error of 0.6; of 0.5 it is the motor's."""
_PARTS: Final[Mapping[int, int]] = {0x40: 0x03, 0x100: 0x04, 0x200: 0x1D}
"""Of 0.5: MOTOR_FAILED, ENCODER_FAILED, CONTROLLER_FAILED, and the command that asks why."""
_COMMAND_OF: Final[Mapping[type[Message], int]] = {
    m.MotorError: 0x03,
    m.EncoderError: 0x04,
    m.ControllerError: 0x1D,
    m.Errors: _GET_ERROR,
}
MOTOR_ERRORS: Final[Mapping[int, str]] = {
    0x1: "PHASE_RESISTANCE_OUT_OF_RANGE",
    0x2: "PHASE_INDUCTANCE_OUT_OF_RANGE",
    0x8: "DRV_FAULT",
    0x10: "CONTROL_DEADLINE_MISSED",
    0x80: "MODULATION_MAGNITUDE",
    0x400: "CURRENT_SENSE_SATURATION",
    0x1000: "CURRENT_LIMIT_VIOLATION",
    0x4000: "DC_BUS_OVER_REGEN_CURRENT",
    0x8000: "DC_BUS_OVER_CURRENT",
    0x10000: "MODULATION_IS_NAN",
    0x20000: "MOTOR_THERMISTOR_OVER_TEMP",
    0x40000: "FET_THERMISTOR_OVER_TEMP",
    0x80000: "TIMER_UPDATE_MISSED",
    0x100000: "CURRENT_MEASUREMENT_UNAVAILABLE",
    0x200000: "CONTROLLER_FAILED",
    0x400000: "I_BUS_OUT_OF_RANGE",
    0x800000: "BRAKE_RESISTOR_DISARMED",
    0x1000000: "SYSTEM_LEVEL",
    0x2000000: "BAD_TIMING",
    0x4000000: "UNKNOWN_PHASE_ESTIMATE",
    0x8000000: "UNKNOWN_PHASE_VEL",
    0x10000000: "UNKNOWN_TORQUE",
    0x20000000: "UNKNOWN_CURRENT_COMMAND",
    0x40000000: "UNKNOWN_CURRENT_MEASUREMENT",
    0x80000000: "UNKNOWN_VBUS_VOLTAGE",
    0x100000000: "UNKNOWN_VOLTAGE_COMMAND",
    0x200000000: "UNKNOWN_GAINS",
    0x400000000: "CONTROLLER_INITIALIZING",
    0x800000000: "UNBALANCED_PHASES",
}
ENCODER_ERRORS: Final[Mapping[int, str]] = {
    0x1: "UNSTABLE_GAIN",
    0x2: "CPR_POLEPAIRS_MISMATCH",
    0x4: "NO_RESPONSE",
    0x8: "UNSUPPORTED_ENCODER_MODE",
    0x10: "ILLEGAL_HALL_STATE",
    0x20: "INDEX_NOT_FOUND_YET",
    0x40: "ABS_SPI_TIMEOUT",
    0x80: "ABS_SPI_COM_FAIL",
    0x100: "ABS_SPI_NOT_READY",
    0x200: "HALL_NOT_CALIBRATED_YET",
}
CONTROLLER_ERRORS: Final[Mapping[int, str]] = {
    0x1: "OVERSPEED",
    0x2: "INVALID_INPUT_MODE",
    0x4: "UNSTABLE_GAIN",
    0x8: "INVALID_MIRROR_AXIS",
    0x10: "INVALID_LOAD_ENCODER",
    0x20: "INVALID_ESTIMATE",
    0x40: "INVALID_CIRCULAR_RANGE",
    0x80: "SPINOUT_DETECTED",
}
_REGENERATION: Final = (
    "set config.dc_max_negative_current to what the battery takes while the robot brakes, such as -10, or connect a "
    "brake resistor; the default, -0.01 A, ends at the first braking"
)
_SPEED: Final = (
    "set controller.config.vel_limit above the fastest that the motor turns, in turns a second, or "
    "controller.config.enable_overspeed_error = False"
)
_REMEDIES: Final[Mapping[str, str]] = {
    "OVERSPEED": _SPEED,
    "VELOCITY_LIMIT_VIOLATION": _SPEED,
    "DC_BUS_OVER_REGEN_CURRENT": _REGENERATION,
    "SYSTEM_LEVEL": f"an error of the board, which CAN does not name; read odrv0.error over USB: where that is "
    f"DC_BUS_OVER_REGEN_CURRENT, {_REGENERATION}",
    "BRAKE_RESISTOR_DISARMED": "see the brake resistor's wiring, config.brake_resistance and enable_brake_resistor",
    "DC_BUS_OVER_CURRENT": "raise config.dc_max_positive_current to what the battery gives",
    "CURRENT_LIMIT_VIOLATION": "raise motor.config.current_lim_margin, or lower the current controller's bandwidth",
    "MODULATION_MAGNITUDE": "the supply's voltage is too low for this speed",
    "SPINOUT_DETECTED": "see that the encoder is fixed to the motor, and calibrate it",
    "NO_RESPONSE": "see the encoder's cable",
    "ILLEGAL_HALL_STATE": "see the hall sensors' cable, and put 22 nF on each line",
    "ABS_SPI_COM_FAIL": "see the encoder's cable",
}


def causes_of(message: Message) -> list[str]:
    """The causes in an answer, by name, each with its remedy where one is known; none for another message."""
    match message:
        case m.MotorError(error):
            part, names = "motor ", named_bits(MOTOR_ERRORS, error)
        case m.EncoderError(error):
            part, names = "encoder ", named_bits(ENCODER_ERRORS, error)
        case m.ControllerError(error):
            part, names = "controller ", named_bits(CONTROLLER_ERRORS, error)
        case m.Errors(active, reason):
            part, names = "", error_names(Firmware.V0_6, active | reason)
        case _:
            return []
    return [f"{part}{name} ({_REMEDIES[name]})" if name in _REMEDIES else f"{part}{name}" for name in names]


class ErrorCauses:
    """Asks for the causes of an axis' errors while they stand, each part three times at the most.

    `event` is what was found since it was last taken, for people.
    """

    def __init__(self) -> None:
        """Begin without errors."""
        self.event: str | None = None
        self._tries: dict[int, int] = {}
        self._found: dict[int, list[str]] = {}
        self._asked_ns: int | None = None
        self._is_over = True

    @property
    def found(self) -> tuple[str, ...]:
        """The causes of the newest errors, also after these were cleared."""
        return tuple(cause for causes in self._found.values() for cause in causes)

    def note_errors(self, firmware: Firmware, errors: int) -> None:
        """Take the error bits of a heartbeat."""
        if not errors:
            self._tries.clear()
            self._asked_ns = None
            self._is_over = True
            return
        self._begin()
        if firmware is Firmware.V0_6:
            commands = [_GET_ERROR] if errors & ~WATCHDOG[firmware] else []
        else:
            commands = [command for bit, command in _PARTS.items() if errors & bit]
        for command in commands:
            self._tries.setdefault(command, 0)

    def next_request(self, now_ns: int) -> int | None:
        """The command to ask for now; None where nothing is to be asked."""
        if self._asked_ns is not None and now_ns - self._asked_ns < _ASK_EVERY_NS:
            return None
        for command, tries in self._tries.items():
            if tries < _TRIES and command not in self._found:
                self._tries[command] = tries + 1
                self._asked_ns = now_ns
                return command
        return None

    def take(self, message: Message) -> None:
        """Take an answer, or the same sent unasked."""
        causes = causes_of(message)
        command = _COMMAND_OF[type(message)]
        if causes:
            self._begin()
        if causes and causes != self._found.get(command):
            self._found[command] = causes
            self._asked_ns = None
            self.event = ", ".join(causes)

    def _begin(self) -> None:
        """Discard the causes of errors that were cleared: there are new ones."""
        if self._is_over:
            self._is_over = False
            self._found.clear()
