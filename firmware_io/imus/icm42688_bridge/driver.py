# SPDX-License-Identifier: MIT
"""The sensor behind its bridge as a `Sensor`: it is only listened to, and never spoken to."""

from collections import Counter
from collections.abc import Collection, Mapping
from typing import Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import FrameKey, Freshness, Readings, stale_after_ns
from segway_ecc.firmware_io.imus.icm42688_bridge.frames import KEY, Measurement, read_measurement
from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

_NOTHING: Final = (0.0, 0.0, 0.0)


class Icm42688:
    """Angular velocity and specific force in the robot's axes; see `Sensor`. Both come in one packet, with a count."""

    name = "imu"
    signals: Mapping[str, str] = {f"imu.angular_velocity_{axis}": "rad/s" for axis in "xyz"} | {
        f"imu.linear_acceleration_{axis}": "m/s2" for axis in "xyz"
    }
    listens_to: Collection[FrameKey] = (KEY,)

    def __init__(
        self, settings: Icm42688BridgeSettings, loop_period_s: float, clock: Clock, ride_through_s: float = 0.0
    ) -> None:
        """Listen to the sensor."""
        self.periods_s: Mapping[FrameKey, float] = {KEY: settings.period_s}
        self._port = settings.serial.port
        self._mounting = settings.rotation
        stale_ns = stale_after_ns(settings.period_s, loop_period_s)
        self._fresh = Freshness({KEY: stale_ns}, clock.now_ns, ride_through_s)
        self._refused: Counter[Refusal] = Counter()
        self._newest = Measurement(-1, _NOTHING, _NOTHING, 0.0)
        self._values: tuple[float, ...] = (*_NOTHING, *_NOTHING)

    def start(self) -> None:
        """Send nothing: the bridge needs no frame from us."""

    def take_frame(self, frame: Frame) -> bool:
        """Take a packet; one that comes again is refused, for it is no new measurement. See `Sensor.take_frame`."""
        try:
            newest = read_measurement(frame.data)
        except FrameRefusedError as error:
            self._refused[error.refusal] += 1
            return False
        if newest.number == self._newest.number:
            self._refused[Refusal.COUNTER] += 1
            return False
        self._newest = newest
        self._values = (*self._mounting.to_robot(newest.rate), *self._mounting.to_robot(newest.force))
        self._fresh.mark(KEY, frame.received_ns)
        return True

    def read(self) -> Readings:
        """Angular velocity and specific force in the robot's axes."""
        age, is_fresh = self._fresh.age(KEY)
        return Readings(self._values, (age,) * len(self._values), (is_fresh,) * len(self._values))

    def arming_failures(self) -> list[str]:
        """Silence."""
        if self._fresh.age(KEY)[1]:
            return []
        wiring = "is its bridge powered and wired to this port? It sends nothing where the sensor does not answer"
        return [f"the IMU sends nothing intact on serial {self._port}; {wiring}"]

    @property
    def health(self) -> Mapping[str, str]:
        """What was refused, and how warm the sensor is."""
        return {
            **{f"refused.{cause}": str(count) for cause, count in self._refused.items()},
            "temperature_c": f"{self._newest.temperature:.1f}",
            **self._fresh.health,
        }
