# SPDX-License-Identifier: MIT
"""What is at the other end of a link: sensors, and drives, which are sensors that also move something.

How their frames are followed is the same for all: how old the newest of each kind is, and counters that wrap.
"""

import math
from collections.abc import Collection, Hashable, Mapping, Sequence
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

from segway_ecc.firmware_io.hardware import Diagnosed
from segway_ecc.firmware_io.links.link import Frame, NowNs
from segway_ecc.firmware_io.value import Value

Kind = TypeVar("Kind", bound=Hashable)

STALE_PERIODS: Final = 3
"""A value older than this many of its own periods, or of the loop's if those are longer, is not valid."""
PATIENCE_PERIODS: Final = 5
"""Nor, while the device still sends other frames, one older than this many.

A bus that loses one frame in a hundred loses three in a row of one kind every hour, and of all kinds never. So a device
that is silent is known after three periods, and a healthy one is not cut off for the frames that were lost.
"""
SUPPLY_STALE_NS: Final = 1_000_000_000
"""The voltage of the supply is sent seldom and changes slowly: it is valid up to this age."""
TURN: Final = 6.283185307179586
"""One turn, rad."""
SUPPLY_VOLTAGE: Final = "supply.voltage"
"""The signal of what feeds the motors, V. A robot has one: of several drives that each measure it, the first one's."""


class FrameKey(NamedTuple):
    """What identifies one kind of frame on a bus."""

    arbitration_id: int
    is_extended: bool = False


class Readings(Value, frozen=True):
    """The newest values of one device, in the order of its `signals`; see `Sensors`.

    Attributes:
        unseen: Those of its signals that it measures only once its motors are on; they are not valid before.
        events: What it reported since it was last read, for people.
    """

    values: tuple[float, ...]
    ages: tuple[float, ...]
    valid: tuple[bool, ...]
    unseen: tuple[str, ...] = ()
    events: tuple[str, ...] = ()


def with_one_more(readings: Readings, value: float, age: tuple[float, bool]) -> Readings:
    """Readings and one value more: in SI, with its age, s, and whether it is fresh enough."""
    return Readings(
        (*readings.values, value),
        (*readings.ages, age[0]),
        (*readings.valid, age[1]),
        readings.unseen,
        readings.events,
    )


class Sensor(Diagnosed, Protocol):
    """A device that measures. It sends over a link that it was given, and is handed what is received; nothing waits.

    Attributes:
        signals: Names of the values it measures, such as `left.velocity`, with their units.
        listens_to: The frames it wants to be handed.
        periods_s: Of those, which come at a steady rate, and how long after one another, s: none of them any sooner.
    """

    name: str
    signals: Mapping[str, str]
    listens_to: Collection[FrameKey]
    periods_s: Mapping[FrameKey, float]

    def start(self) -> None:
        """Send what the device must receive once the link is open."""

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the frames it listens to; True where it was intact, else it has been counted by cause."""

    def read(self) -> Readings:
        """The newest values."""


class MotorState(Protocol):
    """What a drive reports of its motors."""

    @property
    def is_enabled(self) -> bool:
        """Whether the drive has confirmed that its motors follow commands."""

    @property
    def is_off(self) -> bool:
        """Whether the drive reports that its motors are off.

        By its newest report, fresh, and received after it was last commanded to switch off; False without one.
        """

    def faults(self) -> tuple[str, ...]:
        """The faults that the drive has reported since it was commanded to enable; empty where there are none."""


class Drive(Sensor, MotorState, Protocol):
    """A motor controller for one or more axes.

    Its part of `Sensor`, `MotorState` and `Diagnosed` is the same for every family; `PhasedDrive` has that of the
    motors.

    Attributes:
        commands: Names of the values it takes, such as `left.torque`, with their units.
        limits: Largest magnitude of each command.
        commanded_by: The frames that command it, which nobody but its own node may send.
    """

    commands: Mapping[str, str]
    limits: Sequence[float]
    commanded_by: Collection[FrameKey]

    def enable(self) -> None:
        """Begin to switch the motors on, through the drive's own states; zero is sent until it confirms."""

    def command(self, commands: Sequence[float]) -> None:
        """Send this cycle's frames: the commands where the drive is enabled, else zero or the next step of enabling."""

    def disable(self) -> None:
        """Send zero and switch the motors off; may be called at any time, and sends every time."""


def stale_after_ns(frame_period_s: float, loop_period_s: float) -> int:
    """Age above which a value from a frame that comes at this period is not valid, ns."""
    return round(STALE_PERIODS * max(frame_period_s, loop_period_s) * 1e9)


class Freshness(Generic[Kind]):
    """Remembers when each kind of frame of one device last arrived intact; `newest_ns` is when any did, None before.

    A device that was silent for longer than its quickest kind may be has made a gap.
    """

    def __init__(self, stale_ns: Mapping[Kind, int], now_ns: NowNs, ride_through_s: float = 0.0) -> None:
        """Follow the kinds that are keys of `stale_ns`, whose values are the ages above which they are not valid.

        A gap of up to `ride_through_s`, s, leaves every kind valid.
        """
        self.newest_ns: int | None = None
        self._stale_ns = stale_ns
        self._now_ns = now_ns
        self._ride_ns = round(ride_through_s * 1e9)
        self._received_ns: dict[Kind, int] = {}
        self._gap_ns = min(stale_ns.values())
        self._gaps = self._longest_ns = 0

    def mark(self, kind: Kind, received_ns: int) -> None:
        """Note that a frame of this kind arrived intact."""
        self._received_ns[kind] = received_ns
        newest_ns = self.newest_ns
        if newest_ns is None:
            self.newest_ns = received_ns
        elif received_ns > newest_ns:
            self.newest_ns = received_ns
            if received_ns - newest_ns > self._gap_ns:
                self._gaps += 1
                self._longest_ns = max(self._longest_ns, received_ns - newest_ns)

    @property
    def health(self) -> Mapping[str, str]:
        """How many gaps there were, and the longest, as text."""
        return {"gaps": str(self._gaps), "longest_gap_ms": f"{self._longest_ns * 1e-6:.1f}"}

    def age(self, kind: Kind, stale_ns: int | None = None, now_ns: int | None = None) -> tuple[float, bool]:
        """Age of the newest frame of a kind, s, infinite where none has arrived, and whether it is fresh enough.

        The limit is `stale_ns` for what the frame carries beside its quicker values, else the one of the kind; `now_ns`
        is the time, for who asks for several kinds at once.
        """
        received_ns = self._received_ns.get(kind)
        if received_ns is None or self.newest_ns is None:
            return math.inf, False
        if now_ns is None:
            now_ns = self._now_ns()
        age_ns = now_ns - received_ns
        limit_ns = self._stale_ns[kind] if stale_ns is None else stale_ns
        if age_ns <= limit_ns:  # as nearly always; what follows only makes it longer
            return age_ns * 1e-9, True
        if now_ns - self.newest_ns <= limit_ns:
            limit_ns = limit_ns * PATIENCE_PERIODS // STALE_PERIODS
        if self._ride_ns:  # the first frame after a gap may be refused, by its counter
            limit_ns = max(limit_ns, self._ride_ns + self._stale_ns[kind])
        return age_ns * 1e-9, age_ns <= limit_ns


class WrappedCounter:
    """Follows a counter of a few bits over its wraps; exact, since Python's integers do not wrap.

    `total` are the counts since the first, which counts as itself.
    """

    __slots__ = ("_half", "_is_resumed", "_last", "_modulus", "total")

    def __init__(self, bits: int, modulus: int | None = None) -> None:
        """Follow a counter of this many bits, or one that begins anew at an even `modulus`."""
        self.total = 0
        self._modulus = 1 << bits if modulus is None else modulus
        self._half = self._modulus >> 1
        self._last: int | None = None
        self._is_resumed = False

    def follow(self, raw: int) -> int:
        """Take a count, signed or unsigned, and return the total; steps of up to half the range are followed."""
        if self._last is not None:
            self.total += (raw - self._last + self._half) % self._modulus - self._half
        elif not self._is_resumed:
            self.total = raw
        self._last = raw
        return self.total

    def resume(self) -> None:
        """Keep the total over the next count, whatever that is: the device has restarted, perhaps at another count."""
        self._last = None
        self._is_resumed = True
