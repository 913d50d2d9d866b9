# SPDX-License-Identifier: MIT
"""A manoeuvre: segments of constant set-points, and when each of them has to be sent."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec

from segway_ecc.node.cycle.clock import NS_PER_S
from segway_ecc.node.cycle.setpoints import REST, Setpoint
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError

RENEW_NS: Final = 100_000_000
"""A set-point that stays the same is sent again this often, well within a robot's time-out."""

LONGEST_S: Final = 86_400.0
"""Length of the longest segment, s."""


class Segment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Set-points held for a while.

    Attributes:
        linear: Linear velocity, m/s.
        angular: Angular velocity, rad/s, counter-clockwise positive.
        duration: How long, s of model time.
    """

    duration: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_S)]
    linear: float = 0.0
    angular: float = 0.0


class Manoeuvre(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Segments, one after the other; at the end the set-point is zero."""

    segments: Annotated[tuple[Segment, ...], msgspec.Meta(min_length=1)]

    @property
    def duration_ns(self) -> int:
        """Length of the whole manoeuvre, ns."""
        return sum(_ns(segment.duration) for segment in self.segments)


class TimedSetpoint(NamedTuple):
    """A set-point and when it is for, ns since the start of the manoeuvre."""

    offset_ns: int
    setpoint: Setpoint


def load_manoeuvre(path: str) -> Manoeuvre:
    """Read a manoeuvre from a YAML file with a list of `segments`.

    Raises:
        ConfigurationError: The file is missing or not as it must be.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"cannot read sequence file '{path}': {reason}") from error
    manoeuvre = decode_yaml(text, Manoeuvre, path)
    _check_finite(manoeuvre.segments, path)
    return manoeuvre


def single_segment(linear: float, angular: float, duration: float) -> Manoeuvre:
    """One segment: m/s, rad/s, s.

    Raises:
        ConfigurationError: A value is not finite or the duration not positive.
    """
    if not 0.0 < duration <= LONGEST_S:
        raise ConfigurationError(f"the duration must be more than 0 s and at most {LONGEST_S:g} s, not {duration}")
    segments = (Segment(linear=linear, angular=angular, duration=duration),)
    _check_finite(segments, "sequence")
    return Manoeuvre(segments=segments)


def schedule(manoeuvre: Manoeuvre) -> Iterator[TimedSetpoint]:
    """Every set-point to send, in order: each segment's set-point at its start and renewed, rest at the end."""
    start_ns = 0
    for segment in manoeuvre.segments:
        end_ns = start_ns + _ns(segment.duration)
        setpoint = Setpoint(segment.linear, segment.angular)
        for offset_ns in range(start_ns, end_ns, RENEW_NS):
            yield TimedSetpoint(offset_ns, setpoint)
        start_ns = end_ns
    yield TimedSetpoint(start_ns, REST)


def _ns(seconds: float) -> int:
    return max(round(seconds * NS_PER_S), 1)


def _check_finite(segments: Sequence[Segment], where: str) -> None:
    for index, segment in enumerate(segments):
        values = {"linear": segment.linear, "angular": segment.angular, "duration": segment.duration}
        for name, value in values.items():
            if not math.isfinite(value):
                raise ConfigurationError(f"{where}: {name} of segment {index} is {value}; it must be finite")
