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
    """The messages, and the values they carry."""

    ERROR = "error"
    """A code; 1 means that the output buffer was full and messages were lost."""
    WARNING = "warning"
    """A code. The document names the message and not its layout, which is taken to be that of the error."""
    SAMPLE_TIME = "sample_time"
    """Time since power-on, in ticks that differ between firmware versions: 100 us or 1 us; wraps at 2^32."""
    GROUP_COUNTER = "group_counter"
    """Counts the sets of measurements; wraps at 2^16."""
    UTC_TIME = "utc_time"
    """Years after 2000, month, day, hour, minute, second, and s within the second."""
    STATUS_WORD = "status_word"
    """32 flags."""
    QUATERNION = "quaternion"
    """w, x, y, z."""
    EULER_ANGLES = "euler_angles"
    """Roll, pitch, yaw, rad."""
    DELTA_V = "delta_v"
    """Change of velocity since the last set along x, y, z, m/s."""
    RATE_OF_TURN = "rate_of_turn"
    """About x, y, z, rad/s."""
    DELTA_Q = "delta_q"
    """Rotation since the last set: w, x, y, z of a quaternion."""
    ACCELERATION = "acceleration"
    """Specific force along x, y, z, m/s2: 9.81 upward at rest."""
    FREE_ACCELERATION = "free_acceleration"
    """Along x, y, z, without gravity, m/s2."""
    MAGNETIC_FIELD = "magnetic_field"
    """Along x, y, z, as a share of the field at the place of calibration."""
    TEMPERATURE = "temperature"
    """Inside the sensor, degrees Celsius."""
    RATE_OF_TURN_HR = "rate_of_turn_hr"
    """As the rate of turn, not filtered."""
    ACCELERATION_HR = "acceleration_hr"
    """As the acceleration, not filtered."""


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
_DEGREE: Final = 2.0**-7
_UNIT: Final = 1.0 / 32767.0
_DELTA_V_EXPONENTS: Final = range(8, 18)


class _MessageLayout(NamedTuple):
    """Integers on the wire, what one of each is worth, and the values each may take."""

    fields: struct.Struct
    units: tuple[float, ...]
    allowed: tuple[range, ...]


def _number(code: str, bits: int) -> _MessageLayout:
    return _MessageLayout(struct.Struct(f">{code}"), (1,), (range(1 << bits),))


def _signed(unit: float, *largest: int) -> _MessageLayout:
    """16-bit fields whose magnitude is at most `largest`, in units on the wire."""
    allowed = tuple(range(-most, most + 1) for most in largest)
    return _MessageLayout(struct.Struct(f">{len(largest)}h"), (unit,) * len(largest), allowed)


_RATE: Final = _signed(_RADIAN_PER_SECOND, *(round(MAX_ANGULAR_VELOCITY / _RADIAN_PER_SECOND),) * 3)
_FORCE: Final = _signed(_METRE_PER_SECOND_SQUARED, *(round(MAX_LINEAR_ACCELERATION / _METRE_PER_SECOND_SQUARED),) * 3)
_ROTATION: Final = _signed(_UNIT, 32767, 32767, 32767, 32767)
_UTC: Final = _MessageLayout(
    struct.Struct(">6BH"),
    (1, 1, 1, 1, 1, 1, 1e-4),
    (range(256), range(1, 13), range(1, 32), range(24), range(60), range(61), range(10_000)),
)
# The unit of a change of velocity travels with it, as the exponent of a power of two.
_DELTA_V: Final = _MessageLayout(struct.Struct(">3hB"), (), (*(range(-32768, 32768),) * 3, _DELTA_V_EXPONENTS))

_LAYOUTS: Final = {
    Message.ERROR: _number("B", 8),
    Message.WARNING: _number("B", 8),
    Message.SAMPLE_TIME: _number("I", 32),
    Message.GROUP_COUNTER: _number("H", 16),
    Message.UTC_TIME: _UTC,
    Message.STATUS_WORD: _number("I", 32),
    Message.QUATERNION: _ROTATION,
    Message.EULER_ANGLES: _signed(math.radians(_DEGREE), 180 << 7, 90 << 7, 180 << 7),
    Message.DELTA_V: _DELTA_V,
    Message.RATE_OF_TURN: _RATE,
    Message.DELTA_Q: _ROTATION,
    Message.ACCELERATION: _FORCE,
    Message.FREE_ACCELERATION: _FORCE,
    Message.MAGNETIC_FIELD: _signed(2.0**-10, 32768, 32768, 32768),
    Message.TEMPERATURE: _signed(2.0**-8, 32768),
    Message.RATE_OF_TURN_HR: _RATE,
    Message.ACCELERATION_HR: _FORCE,
}


def encode(message: Message, values: Sequence[float]) -> bytes:
    """The data of a message that carries `values`, as `Message` orders them.

    Raises:
        FrameRefusedError: Too few or too many values, or one that is not finite or out of the message's range.
    """
    layout = _LAYOUTS[message]
    if not all(map(math.isfinite, values)):
        raise FrameRefusedError(Refusal.RANGE, f"{message} of the MTi")
    units = _delta_v_units(values) if message is Message.DELTA_V else layout.units
    if len(values) != len(units):
        raise FrameRefusedError(Refusal.LENGTH, f"{message} of the MTi")
    raw = [round(value / unit) for value, unit in zip(values, units, strict=True)]
    if message is Message.DELTA_V:
        raw.append(-round(math.log2(units[0])))
    _check(message, raw)
    return layout.fields.pack(*raw)


def decode(message: Message, data: bytes) -> tuple[float, ...]:
    """The values that a message carries, as `Message` orders them; whole numbers where it counts.

    Raises:
        FrameRefusedError: Wrong length, or a value out of the message's range.
    """
    layout = _LAYOUTS[message]
    if len(data) != layout.fields.size:
        raise FrameRefusedError(Refusal.LENGTH, f"{message} of the MTi")
    raw = layout.fields.unpack(data)
    _check(message, raw)
    units = (2.0 ** -raw[3],) * 3 if message is Message.DELTA_V else layout.units
    return tuple(value * unit for value, unit in zip(raw, units, strict=False))


def elapsed_s(newest: float, before: float, tick_s: float) -> float:
    """Time between two sample times over their wrap, s, with ticks of `tick_s`."""
    return int(newest - before) % SAMPLE_TIME_TICKS * tick_s


def _check(message: Message, raw: Sequence[int]) -> None:
    if not all(value in allowed for value, allowed in zip(raw, _LAYOUTS[message].allowed, strict=True)):
        raise FrameRefusedError(Refusal.RANGE, f"{message} of the MTi")


def _delta_v_units(values: Sequence[float]) -> tuple[float, ...]:
    """The finest unit in which all three values fit, or else the coarsest."""
    largest = max(map(abs, values), default=0.0)
    fitting = [exponent for exponent in _DELTA_V_EXPONENTS if largest * 2.0**exponent <= 32767]  # noqa: PLR2004 - int16
    return (2.0 ** -max(fitting, default=_DELTA_V_EXPONENTS.start),) * 3
