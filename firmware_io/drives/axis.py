# SPDX-License-Identifier: MIT
"""What the drives share that have one axis each and report all that they measure together."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from mypy_extensions import mypyc_attr

from segway_ecc.firmware_io.devices import SUPPLY_STALE_NS, SUPPLY_VOLTAGE, Freshness, Readings, with_one_more
from segway_ecc.firmware_io.drives.enabling import PhasedDrive, wheel_signals
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, Link, NowNs
from segway_ecc.firmware_io.settings import WheelSettings

REPORT: Final = "report"
"""The kind of frame whose freshness they follow."""


@mypyc_attr(allow_interpreted_subclasses=True)  # as `PhasedDrive`, and its methods call what a family overrides
class ReportingAxis(PhasedDrive):
    """A drive of one axis that takes a torque and measures angle, velocity, torque, perhaps the supply; see `Drive`.

    A family overrides `_take`, and calls `_report` from there.
    """

    def __init__(self, link: Link, name: str, axis: WheelSettings, fresh: Freshness[str], now_ns: NowNs) -> None:
        """Drive the axis `name` over `link`; its reports are as old as `fresh` has it."""
        super().__init__(now_ns)
        self.name = name
        self.signals: Mapping[str, str] = wheel_signals(name)
        self.commands: Mapping[str, str] = {f"{name}.torque": "N m"}
        self.limits: Sequence[float] = (axis.max_torque,)
        self._link = link
        self._axis = axis
        self._fresh = fresh
        self._refused: Counter[str] = Counter()
        self._measured, self._supply = (0.0, 0.0, 0.0), 0.0

    def take_frame(self, frame: Frame) -> bool:
        """Take a frame, or count why not; see `Sensor.take_frame`."""
        try:
            self._take(frame)
        except FrameRefusedError as error:
            self._refused[error.refusal] += 1
            return False
        return True

    def read(self) -> Readings:
        """The axis' angle, velocity and torque, and the supply's voltage where it is among the signals."""
        age, is_valid = self._fresh.age(REPORT)
        readings = Readings(self._measured, (age,) * 3, (is_valid,) * 3)
        if SUPPLY_VOLTAGE not in self.signals:
            return readings
        return with_one_more(readings, self._supply, self._fresh.age(REPORT, SUPPLY_STALE_NS))

    @property
    def is_off(self) -> bool:
        """Whether it has reported so since it was last commanded to be off."""
        return self._enabling.confirms_disable(self._off_ns) and self._is_fresh

    @property
    def _is_fresh(self) -> bool:
        """Whether its newest report is recent."""
        return self._fresh.age(REPORT)[1]

    @property
    def _refusals(self) -> dict[str, str]:
        """How many frames, and commands, were refused, by cause: for its health."""
        return {f"refused.{cause}": str(count) for cause, count in self._refused.items()}

    def _take(self, frame: Frame) -> None:
        """Take a frame; FrameRefusedError for one that is not to be used."""
        raise NotImplementedError

    def _report(self, motor: tuple[float, float, float], received_ns: int, *, is_off: bool, follows: bool) -> None:
        """Note a report: the motor's angle, rad, velocity, rad/s, torque, N m, and whether it is off, or follows."""
        angle, velocity, torque = motor
        self._measured = self._axis.wheel(angle), self._axis.wheel(velocity), self._axis.wheel_torque(torque)
        self._fresh.mark(REPORT, received_ns)
        self._off_ns = received_ns if is_off else None
        if follows:
            self._enabling.confirm()

    def _motor_torque(self, torque: float) -> float:
        """The motor's torque for one at the wheel, N m: within its limit, and zero for one that is not finite."""
        if not math.isfinite(torque):
            self._refused[Refusal.RANGE] += 1
            return 0.0
        limit = self._axis.max_torque
        return self._axis.motor_torque(min(max(torque, -limit), limit))
