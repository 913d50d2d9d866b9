# SPDX-License-Identifier: MIT
"""The MTi as a `Sensor`: it is only listened to, and never spoken to."""

import time
from collections import Counter
from collections.abc import Collection, Mapping
from typing import Final

from segway_ecc.firmware_io.devices import FrameKey, Freshness, Readings, stale_after_ns
from segway_ecc.firmware_io.imus.mounting import Vector
from segway_ecc.firmware_io.imus.xsens_mti.frames import GROUP_COUNTS, LAYOUTS, Message, decode, elapsed_s
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, Link, NowNs

_NEEDED: Final = (Message.GROUP_COUNTER, Message.RATE_OF_TURN, Message.ACCELERATION)
_SIGNALS: Final = {f"imu.angular_velocity_{axis}": "rad/s" for axis in "xyz"} | {
    f"imu.linear_acceleration_{axis}": "m/s2" for axis in "xyz"
}
_BURST: Final = 16
"""Sets that may seem to come at once, because they waited somewhere."""


class GroupCounter:
    """Follows the count of the sets of measurements.

    Attributes:
        lost: Sets missing between those received.
        repeated: Counts that came again: a sensor that sends without measuring.
        restarts: Counts further on than time allows: the sensor began anew.
    """

    def __init__(self, period_ns: int) -> None:
        """Follow a sensor that sends a set every `period_ns`."""
        self.lost = 0
        self.repeated = 0
        self.restarts = 0
        self.is_stalled = False
        self._period_ns = period_ns
        self._last: int | None = None
        self._moved_ns = 0

    def follow(self, count: int, received_ns: int) -> bool:
        """Take a count (0 to 65,535); whether it is a new one."""
        if self._last is not None:
            ahead = (count - self._last) % GROUP_COUNTS
            self.is_stalled = ahead == 0
            if self.is_stalled:
                self.repeated += 1
                return False
            # Twice what the period allows, as the sensor may be set to send faster than configured.
            if ahead > 2 * (received_ns - self._moved_ns) // self._period_ns + _BURST:
                self.restarts += 1
            else:
                self.lost += ahead - 1
        self._last, self._moved_ns = count, received_ns
        return True


class XsensMti:
    """Angular velocity and specific force in the robot's axes; see `Sensor`.

    A value is valid while its own message and the group counter are fresh, and the group counter moves.
    """

    name = "imu"
    signals: Mapping[str, str] = _SIGNALS

    def __init__(
        self,
        link: Link,
        settings: XsensMtiSettings,
        loop_period_s: float,
        now_ns: NowNs = time.monotonic_ns,
        ride_through_s: float = 0.0,
    ) -> None:
        """Listen to the sensor on `link`."""
        keys = {message: settings.key(message) for message in LAYOUTS}
        self._messages: dict[tuple[int, bool], Message] = {key: message for message, key in keys.items()}
        self.listens_to: Collection[FrameKey] = frozenset(keys.values())
        self.periods_s: Mapping[FrameKey, float] = {keys[message]: settings.period_s for message in _NEEDED}
        self._link = link
        self._mounting = settings.rotation
        self._tick_s = settings.sample_time_tick_s
        self._fresh = Freshness(
            dict.fromkeys(_NEEDED, stale_after_ns(settings.period_s, loop_period_s)), now_ns, ride_through_s
        )
        self._now_ns = now_ns
        self._counter = GroupCounter(round(settings.period_s * 1e9))
        self._refused: Counter[Refusal] = Counter()
        self._vectors: dict[Message, Vector] = dict.fromkeys(
            (Message.RATE_OF_TURN, Message.ACCELERATION), (0.0, 0.0, 0.0)
        )
        self._newest: dict[Message, float] = {}
        self._error: int | None = None
        self._warnings = 0
        self._sample_period_s = 0.0

    def start(self) -> None:
        """Send nothing: the sensor needs no frame from us."""

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the sensor's messages; see `Sensor.take_frame`."""
        message = self._messages.get((frame.arbitration_id, frame.is_extended))
        if message is None:
            return False
        try:
            values = decode(message, frame.data)
        except FrameRefusedError as error:
            self._refused[error.refusal] += 1
            return False
        if message in self._vectors:
            self._vectors[message] = self._mounting.to_robot(values)
            self._fresh.mark(message, frame.received_ns)
        else:
            self._take_status(message, values[0], frame.received_ns)
        return True

    def read(self) -> Readings:
        """Angular velocity and specific force in the robot's axes."""
        rate, force = self._vectors[Message.RATE_OF_TURN], self._vectors[Message.ACCELERATION]
        age, now_ns = self._fresh.age, self._now_ns()
        counter_age, counter_valid = age(Message.GROUP_COUNTER, now_ns=now_ns)
        rate_age, rate_valid = age(Message.RATE_OF_TURN, now_ns=now_ns)
        force_age, force_valid = age(Message.ACCELERATION, now_ns=now_ns)
        ages = (max(rate_age, counter_age),) * 3 + (max(force_age, counter_age),) * 3
        return Readings(
            (*rate, *force), ages, (rate_valid and counter_valid,) * 3 + (force_valid and counter_valid,) * 3
        )

    def arming_failures(self) -> list[str]:
        """Silence, a group counter that does not advance, or an error that the sensor reported."""
        missing = [message.replace("_", " ") for message in _NEEDED if not self._fresh.age(message)[1]]
        reasons = []
        if self._counter.is_stalled:
            reasons.append(
                "the IMU sends but measures nothing new: its group counter does not advance; switch it off and on"
            )
        elif missing:
            reasons.append(
                f"the IMU sends no {' and no '.join(missing)} on {self._link.description}; is it powered, on this bus "
                "at its bit rate, and set to send them on CAN?"
            )
        if self._error is not None:
            reasons.append(
                f"the IMU reported error {self._error}"
                + (", its output buffer was full: let it send less, or make the bus faster" if self._error == 1 else "")
                + "; switch it off and on to clear it"
            )
        return reasons

    @property
    def health(self) -> Mapping[str, str]:
        """What the sensor reports, and what was lost or refused of it."""
        health = {f"refused.{cause}": str(count) for cause, count in self._refused.items()}
        health |= {
            "lost": str(self._counter.lost),
            "repeated": str(self._counter.repeated),
            "restarts": str(self._counter.restarts),
            "error": "none" if self._error is None else str(self._error),
            "warnings": str(self._warnings),
            "sample_period_s": f"{self._sample_period_s:.6f}",
            **self._fresh.health,
        }
        if Message.STATUS_WORD in self._newest:
            health["status_word"] = f"0x{int(self._newest[Message.STATUS_WORD]):08X}"
        if Message.TEMPERATURE in self._newest:
            health["temperature_c"] = f"{self._newest[Message.TEMPERATURE]:.1f}"
        return health

    def _take_status(self, message: Message, value: float, received_ns: int) -> None:
        match message:
            case Message.GROUP_COUNTER:
                restarts = self._counter.restarts
                if self._counter.follow(int(value), received_ns):
                    self._fresh.mark(Message.GROUP_COUNTER, received_ns)
                if self._counter.restarts != restarts:
                    self._error = None  # what it reported before it began anew is over
            case Message.ERROR:
                self._error = int(value)
            case Message.WARNING:
                self._warnings += 1
            case Message.SAMPLE_TIME:
                self._sample_period_s = elapsed_s(value, self._newest.get(message, value), self._tick_s)
        self._newest[message] = value
