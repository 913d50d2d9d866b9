# SPDX-License-Identifier: MIT
"""The robot's hardware under a person's hands, one exchange a period: what is measured, and small commands.

Commands are zero but inside `Session.driving`, pass the robot's own limiter, and are zero again on every way out.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.clock import NS_PER_S, Clock
from segway_ecc.firmware_io.errors import ArmingRefusedError
from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.hil.commission.person import Answer, Person, Task
from segway_ecc.hil.errors import RigError
from segway_ecc.node.config import RobotFile
from segway_ecc.node.safety.limiter import CommandLimiter
from segway_ecc.node.safety.settings import NOTHING_WATCHED

SIDES: Final = ("left", "right")
FASTEST_RAD_S: Final = 40.0
"""A wheel that turns faster in the air has got away: torque ends."""
_SHARE: Final = 0.2
"""Of the largest command of the robot that is ever sent here."""
_SLEW_S: Final = 0.02
"""From nothing to that, at the least, s."""
_FIT_WITHIN_S: Final = 5.0
_READY_WITHIN_S: Final = 3.0
_PATIENCE_S: Final = 600.0
_RAMP_S: Final = 3.0
_ZEROES: Final = 3


class StepRefusedError(RigError):
    """A step found what it looks for, or could not be done; the text is the reason, with the remedy."""


class Recording:
    """What was measured in a while: SI values of each signal by name, at times in s."""

    def __init__(self, names: Sequence[str]) -> None:
        """Record these signals."""
        self.times: list[float] = []
        self.sent: list[Sequence[float]] = []
        self._places = {name: place for place, name in enumerate(names)}
        self._rows: list[Sequence[float]] = []

    def add(self, time_s: float, sensors: Sensors, sent: Sequence[float]) -> None:
        """Add what was measured at a time, and what was sent then."""
        self.times.append(time_s)
        self._rows.append(sensors.values)
        self.sent.append(sent)

    @property
    def most_sent(self) -> float:
        """The largest command that was sent to any drive, in its unit."""
        return max(max(map(abs, row)) for row in self.sent)

    def of(self, name: str) -> list[float]:
        """The values of a signal."""
        place = self._places[name]
        return [row[place] for row in self._rows]

    def mean(self, name: str) -> float:
        """The mean of a signal."""
        values = self.of(name)
        return math.fsum(values) / len(values)

    def change(self, name: str) -> float:
        """By how much a signal changed from beginning to end."""
        values = self.of(name)
        return values[-1] - values[0]

    def integral(self, name: str, bias: float = 0.0) -> float:
        """Of a signal over time, after taking off a bias."""
        steps = zip(self.of(name)[1:], self.times, self.times[1:], strict=False)
        return math.fsum((value - bias) * (now - before) for value, before, now in steps)

    def vector(self, kind: str) -> tuple[float, float, float]:
        """The mean of the IMU's `angular_velocity` or `linear_acceleration`."""
        x, y, z = (self.mean(f"imu.{kind}_{axis}") for axis in "xyz")
        return x, y, z


class Session:
    """One person with one robot whose hardware is open.

    Attributes:
        file: The robot file.
        person: Who has it in hand.
        hardware: The hardware.
        limits: The largest command of each drive that is sent here, in its unit.
        period_s: Of the loop, s.
        newest: What was measured last.
    """

    def __init__(self, file: RobotFile, hardware: Hardware, clock: Clock, period_s: float, person: Person) -> None:
        """Begin with nothing sent."""
        self.file, self.person, self.hardware, self.period_s = file, person, hardware, period_s
        most = (file.safety or NOTHING_WATCHED).max_command
        whole = CommandLimiter(hardware.limits, most, None, period_s).limits
        self.limits = tuple(_SHARE * limit for limit in whole)
        slew = max(self.limits) / _SLEW_S
        self._limiter = CommandLimiter(self.limits, None, slew, period_s)
        self._names, self._commands = list(hardware.signals), list(hardware.commands)
        self._clock, self._period_ns = clock, round(period_s * NS_PER_S)
        self._deadline_ns = clock.now_ns()
        self._zero: Sequence[float] = (0.0,) * len(self._commands)
        self._sent: Sequence[float] = self._zero
        self.newest = hardware.exchange(self._zero)

    def cycle(self, wanted: Mapping[str, float] | None = None, *, silent: bool = False) -> Sensors:
        """Wait for the next period and exchange once: with commands by side, zero where none is given.

        With `silent`, nothing is sent.
        """
        self._deadline_ns = max(self._deadline_ns + self._period_ns, self._clock.now_ns() - self._period_ns)
        self._clock.sleep_until_ns(self._deadline_ns)
        commands: Sequence[float] = self._zero
        if wanted:
            asked = [wanted.get(name.partition(".")[0], 0.0) for name in self._commands]
            commands = self._limiter.apply(asked, self._sent)
        self._sent = commands
        self.newest = self.hardware.exchange(None if silent else commands)
        return self.newest

    def record(
        self,
        seconds: float,
        wanted: Mapping[str, float] | Callable[[float], Mapping[str, float]] | None = None,
        until: Callable[[Sensors], bool] | None = None,
        *,
        silent: bool = False,
    ) -> Recording:
        """Measure for some seconds, or `until` something is so; `wanted` may depend on the time since the start, s."""
        recording, begun_ns = Recording(self._names), self._clock.now_ns()
        for _ in range(max(round(seconds / self.period_s), 1)):
            since_s = (self._clock.now_ns() - begun_ns) / NS_PER_S
            sensors = self.cycle(wanted(since_s) if callable(wanted) else wanted, silent=silent)
            recording.add((self._clock.now_ns() - begun_ns) / NS_PER_S, sensors, self._sent)
            if until is not None and until(sensors):
                break
        return recording

    def drive(
        self,
        seconds: float,
        wanted: Mapping[str, float] | Callable[[float], Mapping[str, float]],
        until: Callable[[Sensors], bool] | None = None,
    ) -> Recording:
        """Have commands sent, as `record` does; a wheel that turns too fast ends it.

        Raises:
            StepRefusedError: The drives report a fault, or telemetry was lost.
        """

        def over(sensors: Sensors) -> bool:
            is_over = until is not None and until(sensors)
            return is_over or bool(sensors.faults) or bool(self.stale()) or self.too_fast()

        recording = self.record(seconds, wanted, over)
        if self.newest.faults or self.stale():
            reasons = [*self.newest.faults, *(f"no fresh {name}" for name in self.stale())]
            raise StepRefusedError(f"while a wheel was driven: {'; '.join(reasons)}")
        return recording

    def ramp(self, side: str, until: Callable[[], bool]) -> Recording:
        """Raise the command of a drive from zero to its limit here, in 3 s, until something is so; see `drive`."""
        most = self.limits[SIDES.index(side)]
        return self.drive(_RAMP_S, lambda since_s: {side: most * min(since_s / _RAMP_S, 1.0)}, lambda _: until())

    def ask(self, task: Task, *, may_be_silent: bool = False) -> Recording:
        """Tell the person what to do, and measure until they have done it.

        Raises:
            StepRefusedError: It cannot be done, or takes longer than ten minutes; or telemetry was lost meanwhile,
                where that may not be.
        """
        self.person.begin(task)
        answers: list[Answer] = []

        def answered(_sensors: Sensors) -> bool:
            answers.extend(answer for answer in (self.person.answer(),) if answer is not None)
            return bool(answers)

        recording = self.record(_PATIENCE_S, until=answered)
        if not answers:
            raise StepRefusedError(f"not done within {_PATIENCE_S:g} s: {task}")
        if answers[0] is Answer.CANNOT:
            raise StepRefusedError(f"the person cannot do it: {task}")
        if self.stale() and not may_be_silent:
            raise StepRefusedError(f"telemetry was lost: no fresh {', '.join(self.stale())}")
        return recording

    def value(self, name: str) -> float:
        """The newest value of a signal."""
        return self.newest.values[self._names.index(name)]

    def stale(self) -> list[str]:
        """The signals that no fresh value has arrived of, and that are measured with the motors as they are."""
        newest = self.newest
        return [
            name
            for name, valid in zip(self._names, newest.valid, strict=True)
            if not valid and name not in newest.unseen
        ]

    def wait_until_fit(self) -> None:
        """Wait until nothing keeps the drives from being switched on.

        Raises:
            StepRefusedError: Something does, after 5 s.
        """
        for _ in range(round(_FIT_WITHIN_S / self.period_s)):
            self.cycle()
            if not self.hardware.arming_failures() and not self.stale():
                return
        reasons = [*self.hardware.arming_failures(), *(f"no fresh {name}" for name in self.stale())]
        raise StepRefusedError("; ".join(reasons))

    @contextlib.contextmanager
    def driving(self) -> Iterator[None]:
        """Have the drives on, at zero, while the context lasts; then zero is sent, and they are off.

        Raises:
            StepRefusedError: They are not fit, or do not come on.
        """
        self.wait_until_fit()
        try:
            self.hardware.arm()
            self.record(_READY_WITHIN_S, until=lambda sensors: sensors.ready)
            if not self.newest.ready or self.newest.faults:
                raise StepRefusedError("; ".join(self.newest.faults) or "the drives do not switch on")
            yield
        except ArmingRefusedError as error:
            raise StepRefusedError("; ".join(error.reasons)) from error
        finally:
            self._sent = self._zero
            self.hardware.disarm()  # first of all, and it sends zero: whatever follows may fail on a lost bus
            for _ in range(_ZEROES):
                self.cycle()

    def too_fast(self) -> bool:
        """Whether a wheel turns so fast that torque is to end."""
        return max(abs(self.value(f"{side}.velocity")) for side in SIDES) > FASTEST_RAD_S

    def rest(self) -> None:
        """Wait until both wheels are at rest, 5 s at the most."""
        self.record(
            _FIT_WITHIN_S,
            until=lambda _: max(abs(self.value(f"{side}.velocity")) for side in SIDES) < 0.1,  # noqa: PLR2004
        )
