# SPDX-License-Identifier: MIT
"""A simulated ODrive board: the errors of its supply, and its properties by name (ASCII) and by endpoint (SDO)."""

import enum
import math
import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.hil.devices._odrive_axis import Release, SimulatedAxis

OVER_REGEN_CURRENT: Final = 0x8
OVER_CURRENT: Final = 0x10
"""Error bits of a board of 0.5, `ODrive.Error`."""
_OF_0_6: Final = {OVER_REGEN_CURRENT: 0x800, OVER_CURRENT: 0x400}
"""The same of an axis of 0.6."""
SYSTEM_LEVEL: Final = 0x1000000
"""Error bit of a motor of 0.5: the board has the cause, which CAN does not carry."""
FACTORY_NEGATIVE_CURRENT_A: Final = -0.01
"""`dc_max_negative_current` of a new board."""


class SimulatedBoard:
    """What its axes share.

    Attributes:
        release: What runs on it.
        axes: Its axes, in its order.
        error: Bits that are latched until they are cleared; 0.5.
        dc_max_negative_current_a: The most negative current that may flow back to the supply, A.
        dc_max_positive_current_a: The largest current that it may take, A.
        enable_brake_resistor: Whether what flows back ends in a resistor, taken as large enough.
    """

    def __init__(self, release: Release, axes: Sequence[SimulatedAxis]) -> None:
        """Have no limits of current, as a board that was set up for a battery."""
        self.release = release
        self.axes = axes
        self.error = 0
        self.dc_max_negative_current_a = -math.inf
        self.dc_max_positive_current_a = math.inf
        self.enable_brake_resistor = False

    def restart(self) -> None:
        """Be as after power-on."""
        self.error = 0
        for axis in self.axes:
            axis.restart()

    @property
    def supply_voltage(self) -> float:
        """Of the supply, V."""
        return self.axes[0].supply_voltage

    @property
    def supply_current_a(self) -> float:
        """What its motors take from the supply, A."""
        current_a = sum(axis.supply_current_a for axis in self.axes)
        return max(current_a, 0.0) if self.enable_brake_resistor else current_a

    @property
    def fw_version_major(self) -> int:
        """Of its release."""
        return self.release.numbers[0]

    @property
    def fw_version_minor(self) -> int:
        """Of its release."""
        return self.release.numbers[1]

    @property
    def fw_version_revision(self) -> int:
        """Of its release."""
        return self.release.numbers[2]

    def clear_errors(self) -> None:
        """Forget the errors of the board and of all of its axes: `ODrive::clear_errors`, fw-v0.5.6."""
        self.error = 0
        for axis in self.axes:
            axis.clear_errors()

    @property
    def limits_current(self) -> bool:
        """Whether the current of its supply has a limit."""
        return not (math.isinf(self.dc_max_negative_current_a) and math.isinf(self.dc_max_positive_current_a))

    def check_supply(self) -> None:
        """Switch all motors off where the current leaves its limits: `update_brake_current`, fw-v0.5.6."""
        if not self.limits_current:
            return
        least_a, most_a = self.dc_max_negative_current_a, self.dc_max_positive_current_a
        current_a = self.supply_current_a
        if current_a > most_a:
            self._fail(OVER_CURRENT)
        elif current_a < least_a:
            self._fail(OVER_REGEN_CURRENT)

    def _fail(self, bit: int) -> None:
        if self.release.firmware is Firmware.V0_5:
            self.error |= bit
        for axis in self.axes:
            if self.release.firmware is Firmware.V0_5:
                axis.fail_motor(SYSTEM_LEVEL)
            else:
                axis.latch(_OF_0_6[bit])


class Kind(enum.Enum):
    """What a property is; the value packs it for SDO."""

    FLOAT = struct.Struct("<f")
    UINT32 = struct.Struct("<I")
    UINT8 = struct.Struct("<B")
    BOOL = struct.Struct("<?")

    def read_text(self, text: str) -> float:
        """The value that a text has; ValueError where it has none."""
        return float(text) if self is Kind.FLOAT else int(text)


class Property(NamedTuple):
    """A value with a name in the firmware: whose attribute it is, and whether it may be written."""

    attribute: str
    kind: Kind
    is_writable: bool = False


_BOTH: Final = {
    "config.enable_watchdog": Property("enable_watchdog", Kind.BOOL, is_writable=True),
    "config.watchdog_timeout": Property("watchdog_timeout_s", Kind.FLOAT, is_writable=True),
    "controller.config.control_mode": Property("control_mode", Kind.UINT8, is_writable=True),
    "controller.config.input_mode": Property("input_mode", Kind.UINT8, is_writable=True),
    "controller.config.vel_limit": Property("velocity_limit_rev_s", Kind.FLOAT, is_writable=True),
    "controller.config.vel_limit_tolerance": Property("velocity_limit_tolerance", Kind.FLOAT, is_writable=True),
    "controller.config.enable_overspeed_error": Property("enable_overspeed_error", Kind.BOOL, is_writable=True),
    "controller.config.enable_torque_mode_vel_limit": Property(
        "enable_torque_mode_velocity_limit", Kind.BOOL, is_writable=True
    ),
    "current_state": Property("state", Kind.UINT8),
    "requested_state": Property("requested_state", Kind.UINT8, is_writable=True),
}
_OF_AXIS: Final[Mapping[Firmware, Mapping[str, Property]]] = {
    Firmware.V0_5: {
        **_BOTH,
        "error": Property("error", Kind.UINT32),
        "motor.error": Property("motor_error", Kind.UINT32),
        "encoder.error": Property("encoder_error", Kind.UINT32),
        "controller.error": Property("controller_error", Kind.UINT32),
        "motor.is_calibrated": Property("is_calibrated", Kind.BOOL),
        "motor.config.current_lim": Property("current_limit_a", Kind.FLOAT, is_writable=True),
        "motor.config.current_lim_margin": Property("current_limit_margin_a", Kind.FLOAT, is_writable=True),
        "motor.config.torque_lim": Property("torque_limit_nm", Kind.FLOAT, is_writable=True),
        "motor.config.torque_constant": Property("torque_constant", Kind.FLOAT, is_writable=True),
        "motor.current_control.Iq_measured": Property("current_a", Kind.FLOAT),
        "encoder.pos_estimate": Property("position_rev", Kind.FLOAT),
        "encoder.vel_estimate": Property("velocity_rev_s", Kind.FLOAT),
    },
    Firmware.V0_6: {
        **_BOTH,
        "active_errors": Property("active_errors", Kind.UINT32),
        "disarm_reason": Property("disarm_reason", Kind.UINT32),
        "pos_estimate": Property("position_rev", Kind.FLOAT),
        "vel_estimate": Property("velocity_rev_s", Kind.FLOAT),
        "config.torque_soft_max": Property("torque_limit_nm", Kind.FLOAT, is_writable=True),
        "config.motor.torque_constant": Property("torque_constant", Kind.FLOAT, is_writable=True),
        "config.motor.current_soft_max": Property("current_limit_a", Kind.FLOAT, is_writable=True),
    },
}
_OF_EVERY_BOARD: Final = {
    "vbus_voltage": Property("supply_voltage", Kind.FLOAT),
    "ibus": Property("supply_current_a", Kind.FLOAT),
    "error": Property("error", Kind.UINT32),
    "fw_version_major": Property("fw_version_major", Kind.UINT8),
    "fw_version_minor": Property("fw_version_minor", Kind.UINT8),
    "fw_version_revision": Property("fw_version_revision", Kind.UINT8),
    "config.dc_max_negative_current": Property("dc_max_negative_current_a", Kind.FLOAT, is_writable=True),
    "config.dc_max_positive_current": Property("dc_max_positive_current_a", Kind.FLOAT, is_writable=True),
}
_BRAKE_RESISTOR: Final = Property("enable_brake_resistor", Kind.BOOL, is_writable=True)
_OF_BOARD: Final[Mapping[Firmware, Mapping[str, Property]]] = {
    Firmware.V0_5: {**_OF_EVERY_BOARD, "config.enable_brake_resistor": _BRAKE_RESISTOR},
    Firmware.V0_6: {**_OF_EVERY_BOARD, "config.brake_resistor0.enable": _BRAKE_RESISTOR},
}
ENDPOINTS: Final[Mapping[int, str]] = {
    1: "vbus_voltage",
    2: "ibus",
    10: "fw_version_major",
    11: "fw_version_minor",
    12: "fw_version_revision",
    144: "config.dc_max_positive_current",
    145: "config.dc_max_negative_current",
    150: "config.brake_resistor0.enable",
    175: "axis0.active_errors",
    176: "axis0.disarm_reason",
    180: "axis0.current_state",
    181: "axis0.requested_state",
    182: "axis0.pos_estimate",
    183: "axis0.vel_estimate",
    200: "axis0.config.watchdog_timeout",
    201: "axis0.config.enable_watchdog",
    252: "axis0.config.torque_soft_max",
    259: "axis0.config.motor.torque_constant",
    271: "axis0.config.motor.current_soft_max",
    378: "axis0.controller.config.enable_torque_mode_vel_limit",
    381: "axis0.controller.config.enable_overspeed_error",
    382: "axis0.controller.config.control_mode",
    383: "axis0.controller.config.input_mode",
    388: "axis0.controller.config.vel_limit",
    389: "axis0.controller.config.vel_limit_tolerance",
}
"""Endpoints of 0.6 that are simulated. On a real drive the numbers are those of the `flat_endpoints.json` of its
very release and hardware; these are of one list of 0.6, but for that of the brake resistor, which is made up."""


class Found(NamedTuple):
    """A property and whose it is."""

    owner: SimulatedAxis | SimulatedBoard
    entry: Property

    def read(self) -> float:
        """What it is now."""
        value: float = getattr(self.owner, self.entry.attribute)
        return value

    def write(self, value: float) -> bool:
        """Make it another; returns whether that is allowed."""
        if self.entry.is_writable:
            is_bool = self.entry.kind is Kind.BOOL
            setattr(self.owner, self.entry.attribute, bool(value) if is_bool else value)
        return self.entry.is_writable

    def pack(self) -> bytes:
        """What it is now, as SDO carries it."""
        return self.entry.kind.value.pack(self.read())

    def unpack(self, data: bytes) -> bool:
        """Make it what SDO carries; returns whether that is allowed, and data long enough."""
        packing = self.entry.kind.value
        return len(data) >= packing.size and self.write(packing.unpack_from(data)[0])


def find(board: SimulatedBoard, name: str) -> Found | None:
    """The property of a board that is called `name`, such as `axis0.error` or `vbus_voltage`; None where none is."""
    root, _, key = name.partition(".")
    names = [f"axis{index}" for index in range(len(board.axes))]
    if root in names:
        axis, found = board.axes[names.index(root)], _OF_AXIS[board.release.firmware].get(key)
        return None if found is None else Found(axis, found)
    of_board = _OF_BOARD[board.release.firmware].get(name)
    return None if of_board is None else Found(board, of_board)
