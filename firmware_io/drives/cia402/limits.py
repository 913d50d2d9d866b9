# SPDX-License-Identifier: MIT
"""What a drive is (0x1018) and offers (0x6502), and what its mode asks for (0x60C2); CiA 301 and CiA 402."""

from typing import Final, NamedTuple

CYCLIC_SYNCHRONOUS_TORQUE: Final = 10
"""The mode of operation (0x6060) that the robot is driven in."""
_PROFILE_TORQUE: Final = 4
_MODES: Final = {
    1: "profile position",
    2: "velocity",
    3: "profile velocity",
    4: "profile torque",
    6: "homing",
    7: "interpolated position",
    8: "cyclic synchronous position",
    9: "cyclic synchronous velocity",
    10: "cyclic synchronous torque",
    11: "cyclic synchronous torque with commutation angle",
}
"""By their number in 0x6060; each has the bit before that in 0x6502."""
_STANDARD_BITS: Final = 16
"""Of 0x6502; those above are the manufacturer's."""
_LARGEST: Final = 0xFF
_US_EXPONENT: Final = -6
_MS_EXPONENT: Final = -3
"""The default of 0x60C2:02, which some drives take alone."""


class Identity(NamedTuple):
    """The parts of 0x1018 that a drive has; None for one that it lacks, though the vendor is mandatory."""

    vendor: int | None
    product: int | None
    revision: int | None
    serial: int | None

    def __str__(self) -> str:
        parts = [f"{name} 0x{value:08X}" for name, value in self._asdict().items() if value is not None]
        return ", ".join(parts) or "not reported (0x1018)"


def mode_names(supported: int) -> str:
    """The modes that 0x6502 offers, for people."""
    numbers = [bit + 1 for bit in range(_STANDARD_BITS) if supported >> bit & 1]
    return ", ".join(f"{_MODES.get(number, 'reserved')} ({number})" for number in numbers) or "none of the profile"


def mode_refusal(supported: int | None, what: str = "") -> str | None:
    """Why a drive cannot be driven in cyclic synchronous torque; None where nothing is known against it.

    Args:
        supported: Its 0x6502; None where it does not have that.
        what: What it did when it was asked for the mode; empty before.
    """
    mode = CYCLIC_SYNCHRONOUS_TORQUE
    lacks = supported is not None and not supported >> (mode - 1) & 1
    if not (what or lacks):
        return None
    offers = "it does not report its modes (0x6502)" if supported is None else f"0x6502 offers {mode_names(supported)}"
    text = f"it does not take mode {mode}, {_MODES[mode]}: it {what or 'lacks it'}; {offers}"
    if lacks and supported is not None and supported >> (_PROFILE_TORQUE - 1) & 1:
        text += "; profile torque alone is not enough, since the drive ramps each torque (0x6087)"
    return text


def interpolation_period(cycle_us: int) -> tuple[int, int]:
    """Value and exponent of ten, s, for 0x60C2:01 and :02: the period of SYNC, as exactly as a byte holds it."""
    value, exponent = cycle_us, _US_EXPONENT
    while value > _LARGEST or (value % 10 == 0 and exponent < _MS_EXPONENT):
        value, exponent = (value + 5) // 10, exponent + 1
    return value, exponent
