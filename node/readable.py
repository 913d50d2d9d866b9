# SPDX-License-Identifier: MIT
"""Numbers and units for people: four digits, no exponents, and an SI prefix on what is very small or very large."""

import decimal
import math
from typing import Final

DIGITS: Final = 4
"""Significant ones: as many as are taken in at a glance."""
_PREFIXES: Final = {-15: "f", -12: "p", -9: "n", -6: "\u00b5", -3: "m", 3: "k", 6: "M", 9: "G"}
_TAKE_PREFIX: Final = frozenset({"m", "s", "rad", "V", "A", "N", "W", "J", "Hz", "Ohm", "H", "F", "T", "Pa"})
_RAISED: Final = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
_LEAST: Final = 1e-2
_MOST: Final = 1e4
"""Between them numbers are read without a prefix."""
_ZERO: Final = 1e-300
"""What is less is none: it has no power of ten that a number of this machine could be divided by."""


def short(value: float, least: float = 0.0) -> str:
    """A number in plain digits, four that count at most; what is no larger than `least`, either way, is 0."""
    if not math.isfinite(value):
        return str(value)
    if abs(value) <= least or value == 0.0:
        return "0"
    text = f"{decimal.Decimal(f'{value:.{DIGITS - 1}e}'):f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def scaled_unit(magnitude: float, unit: str) -> tuple[int, str]:
    """The power of ten to divide by so that a magnitude, in a unit, reads well, and the unit of what comes of it.

    It has an SI prefix where it takes one, else the power of ten before it; the unit "1" is left out.
    """
    own = "" if unit == "1" else unit
    if not _ZERO < magnitude < math.inf or _LEAST <= magnitude < _MOST:
        return 0, own
    exponent = 3 * math.floor(math.log10(magnitude) / 3)
    if own.replace("/", " ").partition(" ")[0] in _TAKE_PREFIX and exponent in _PREFIXES:
        return exponent, _PREFIXES[exponent] + own
    return exponent, f"10{str(exponent).translate(_RAISED)} {own}".rstrip()


def with_unit(value: float, unit: str, least: float = 0.0) -> str:
    """A number with its unit, with a prefix where that reads better; what is no larger than `least` is 0."""
    least = max(least, _ZERO)
    exponent, text = scaled_unit(0.0 if abs(value) <= least else abs(value), unit)
    factor = 10.0**-exponent
    return f"{short(value * factor, least * factor)} {text}".rstrip()
