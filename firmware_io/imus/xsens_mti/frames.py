# SPDX-License-Identifier: MIT
"""The CAN messages of the MTi 600 series: bytes to SI and back.

Source: Xsens, "MTi 600-series MT CAN Protocol Documentation", MT1604P revision A (2019), section 6, and the page "CAN
messages" of mtidocs.movella.com. All fields are big-endian. No message has a checksum or a counter of its own: the
group counter is a message that is sent with each set of measurements.
"""

import enum
import math
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal


@enum.unique
class Message(enum.StrEnum):
    """The messages, and the values of those that are used."""

    ERROR = "error"
    """A code; 1 means that the output buffer was full and messages were lost."""
    WARNING = "warning"
    """A code. The document names the message and not its layout, which is taken to be that of the error."""
    SAMPLE_TIME = "sample_time"
    """Time since power-on, in ticks that differ between firmware versions: 100 us or 1 us; wraps at 2^32."""
    GROUP_COUNTER = "group_counter"
    """Counts the sets of measurements; wraps at 2^16."""
    UTC_TIME = "utc_time"
    STATUS_WORD = "status_word"
    """32 flags."""
    QUATERNION = "quaternion"
    EULER_ANGLES = "euler_angles"
    DELTA_V = "delta_v"
    RATE_OF_TURN = "rate_of_turn"
    """About x, y, z, rad/s."""
    DELTA_Q = "delta_q"
    ACCELERATION = "acceleration"
    """Specific force along x, y, z, m/s2: 9.81 upward at rest."""
    FREE_ACCELERATION = "free_acceleration"
    MAGNETIC_FIELD = "magnetic_field"
    TEMPERATURE = "temperature"
    """Inside the sensor, degrees Celsius."""
    RATE_OF_TURN_HR = "rate_of_turn_hr"
    ACCELERATION_HR = "acceleration_hr"


DEFAULT_IDS: Final = {
    Message.ERROR: 0x001,
    Message.WARNING: 0x002,
    Message.SAMPLE_TIME: 0x005,
    Message.GROUP_COUNTER: 0x006,
    Message.UTC_TIME: 0x007,
    Message.STATUS_WORD: 0x011,
    Message.QUATERNION: 0x021,
    Message.EULER_ANGLES: 0x022,
    Message.DELTA_V: 0x031,
    Message.RATE_OF_TURN: 0x032,
    Message.DELTA_Q: 0x033,
    Message.ACCELERATION: 0x034,
    Message.FREE_ACCELERATION: 0x035,
    Message.MAGNETIC_FIELD: 0x041,
    Message.TEMPERATURE: 0x051,
    Message.RATE_OF_TURN_HR: 0x061,
    Message.ACCELERATION_HR: 0x062,
}
"""Arbitration ids as the sensor is delivered."""

MAX_ANGULAR_VELOCITY: Final = 35.0
"""Largest magnitude on each axis, rad/s; the gyroscopes end at 2000 deg/s, a little below."""
MAX_LINEAR_ACCELERATION: Final = 100.0
"""Largest magnitude on each axis, m/s2; the accelerometers end at 10 g, a little below."""
GROUP_COUNTS: Final = 1 << 16
SAMPLE_TIME_TICKS: Final = 1 << 32

_RADIAN_PER_SECOND: Final = 2.0**-9
_METRE_PER_SECOND_SQUARED: Final = 2.0**-8
_DEGREE_CELSIUS: Final = 2.0**-8


class _MessageLayout(NamedTuple):
    """Integers on the wire, what one of them is worth, and the values that each may take."""

    fields: struct.Struct
    unit: float
    allowed: range


def _number(code: str, bits: int) -> _MessageLayout:
    return _MessageLayout(struct.Struct(f">{code}"), 1, range(1 << bits))


def _signed(count: int, unit: float, largest: float) -> _MessageLayout:
    """16-bit fields whose magnitude is at most `largest`."""
    most = round(largest / unit)
    return _MessageLayout(struct.Struct(f">{count}h"), unit, range(-most, min(most, 32767) + 1))


LAYOUTS: Final = {
    Message.ERROR: _number("B", 8),
    Message.WARNING: _number("B", 8),
    Message.SAMPLE_TIME: _number("I", 32),
    Message.GROUP_COUNTER: _number("H", 16),
    Message.STATUS_WORD: _number("I", 32),
    Message.RATE_OF_TURN: _signed(3, _RADIAN_PER_SECOND, MAX_ANGULAR_VELOCITY),
    Message.ACCELERATION: _signed(3, _METRE_PER_SECOND_SQUARED, MAX_LINEAR_ACCELERATION),
    Message.TEMPERATURE: _signed(1, _DEGREE_CELSIUS, 128.0),
}
"""The messages that are used."""


def encode(message: Message, values: Sequence[float]) -> bytes:
    """The data of a message of `LAYOUTS`; FrameRefusedError for too few or many values, or one out of its range."""
    layout = LAYOUTS[message]
    if not all(map(math.isfinite, values)):
        raise FrameRefusedError(Refusal.RANGE, f"{message} of the MTi")
    raw = [round(value / layout.unit) for value in values]
    _check(message, layout, raw)
    try:
        return layout.fields.pack(*raw)
    except struct.error as error:
        raise FrameRefusedError(Refusal.LENGTH, f"{message} of the MTi") from error


def decode(message: Message, data: bytes) -> tuple[float, ...]:
    """The values of a message of `LAYOUTS`, whole where it counts; FrameRefusedError for a wrong length or value."""
    layout = LAYOUTS[message]
    if len(data) != layout.fields.size:
        raise FrameRefusedError(Refusal.LENGTH, f"{message} of the MTi")
    raw = layout.fields.unpack(data)
    _check(message, layout, raw)
    # A count times one would be a float where this is compiled.
    return raw if layout.unit == 1 else tuple([value * layout.unit for value in raw])


def elapsed_s(newest: float, before: float, tick_s: float) -> float:
    """Time between two sample times over their wrap, s, with ticks of `tick_s`."""
    return int(newest - before) % SAMPLE_TIME_TICKS * tick_s


def _check(message: Message, layout: _MessageLayout, raw: Sequence[int]) -> None:
    allowed = layout.allowed
    for value in raw:
        if value not in allowed:
            raise FrameRefusedError(Refusal.RANGE, f"{message} of the MTi")
