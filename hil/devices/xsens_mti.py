# SPDX-License-Identifier: MIT
"""An MTi as it behaves on the bus: it sends a set of measurements each period, unasked, and obeys nobody."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.imus.xsens_mti.frames import (
    GROUP_COUNTS,
    MAX_ANGULAR_VELOCITY,
    MAX_LINEAR_ACCELERATION,
    SAMPLE_TIME_TICKS,
    Message,
    encode,
)
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.devices.family import SimulatedImu

_SENT: Final = (Message.GROUP_COUNTER, Message.SAMPLE_TIME, Message.RATE_OF_TURN, Message.ACCELERATION)
_ANGULAR_VELOCITY: Final = ("imu.angular_velocity_x", "imu.angular_velocity_y", "imu.angular_velocity_z")
_LINEAR_ACCELERATION: Final = ("imu.linear_acceleration_x", "imu.linear_acceleration_y", "imu.linear_acceleration_z")


class SimulatedXsensMti:
    """Sends group counter, sample time, rate of turn and acceleration; see `Device`.

    Its period must be a multiple of the rig's tick: it sends no more than one set in a tick. Where it is `powered`
    again, counter and sample time begin anew; while it is `frozen` it sends the same set again and again. Between two
    sets it sleeps; see `Sleeping`.
    """

    inputs: Sequence[str] = ()
    needs: Sequence[str] = (*_ANGULAR_VELOCITY, *_LINEAR_ACCELERATION)

    def __init__(self, link: Link, settings: XsensMtiSettings) -> None:
        """Switch a sensor on, which sends over `link`."""
        self.next_ns = -math.inf
        self.frozen = False
        self._is_powered = True
        self._link = link
        self._keys = {message: settings.key(message) for message in _SENT}
        self._mounting = settings.rotation
        self._tick_s = settings.sample_time_tick_s
        self._period_ns = round(settings.period_s * 1e9)
        self._on_since_ns: int | None = None
        self._sets = 0
        self._newest: list[Frame] = []

    @property
    def powered(self) -> bool:
        """Whether it has its supply."""
        return self._is_powered

    @powered.setter
    def powered(self, is_powered: bool) -> None:
        self._is_powered, self.next_ns = is_powered, -math.inf

    @property
    def refused_frames(self) -> int:
        """None: it listens to no frame."""
        return 0

    def obey(self, _frames: Sequence[Frame], _now_ns: int, _outputs: Mapping[str, float]) -> Sequence[float]:
        """Drive nothing; see `Device.obey`."""
        return ()

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send a set of measurements where one is due; see `Device.send_telemetry`."""
        if not self._is_powered:
            self._on_since_ns = None
            return
        if self._on_since_ns is None:
            self._on_since_ns, self._sets = now_ns, 0
        # Counted from when it was switched on, so that a tick that came late shifts none of those after it.
        if now_ns - self._on_since_ns < self._sets * self._period_ns:
            return
        if not self.frozen or not self._newest:
            ticks = round((now_ns - self._on_since_ns) * 1e-9 / self._tick_s)
            rates, accelerations = (
                [outputs[name] for name in names] for names in (_ANGULAR_VELOCITY, _LINEAR_ACCELERATION)
            )
            self._newest = [
                self._frame(Message.GROUP_COUNTER, (self._sets % GROUP_COUNTS,)),
                self._frame(Message.SAMPLE_TIME, (ticks % SAMPLE_TIME_TICKS,)),
                self._vector(Message.RATE_OF_TURN, rates, MAX_ANGULAR_VELOCITY),
                self._vector(Message.ACCELERATION, accelerations, MAX_LINEAR_ACCELERATION),
            ]
        self._sets += 1
        self.next_ns = self._on_since_ns + self._sets * self._period_ns
        for frame in self._newest:
            self._link.send(frame)

    def _vector(self, message: Message, vector: Sequence[float], largest: float) -> Frame:
        turned = self._mounting.to_sensor(vector)
        return self._frame(message, [min(max(value, -largest), largest) for value in turned])

    def _frame(self, message: Message, values: Sequence[float]) -> Frame:
        arbitration_id, is_extended = self._keys[message]
        return Frame(arbitration_id, encode(message, values), is_extended=is_extended)


SIMULATED: Final[SimulatedImu[XsensMtiSettings]] = SimulatedImu(
    device=lambda settings, link, _port: SimulatedXsensMti(link, settings),
    frames=lambda settings: [settings.key(message) for message in _SENT],
)
