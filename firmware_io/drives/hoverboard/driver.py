# SPDX-License-Identifier: MIT
"""The board of a hoverboard as a `Drive`: motor current in, speed (and angle, where it is measured) out."""

import math
from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.devices import (
    SUPPLY_STALE_NS,
    SUPPLY_VOLTAGE,
    TURN,
    FrameKey,
    Freshness,
    Readings,
    WrappedCounter,
    stale_after_ns,
    with_one_more,
)
from segway_ecc.firmware_io.drives.enabling import Phase, PhasedDrive
from segway_ecc.firmware_io.drives.hoverboard import frames as board
from segway_ecc.firmware_io.drives.hoverboard.frames import FEEDBACK, FULL, Feedback
from segway_ecc.firmware_io.drives.hoverboard.settings import LOOP_S, HoverboardSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, Link

_PERIOD_S: Final = 2 * LOOP_S
_REMEMBERED: Final = 8
_OBEYS_WITHIN_NS: Final = 100_000_000  # one of as many commands must come back in this time
_RESTARTED_NS: Final = 1_000_000_000  # silent for longer, it may have been switched off: its counts have begun anew
_GAP_NS: Final = 100_000_000
_PULL_PER_S: Final = (
    3.0  # how fast the sum of velocities, in whole turns a minute, is drawn to the angle that was counted
)
_SIDES: Final = ("left", "right")
_ZERO: Final[Sequence[float]] = (0.0, 0.0)
_SETUP: Final = "is it switched on, wired to this port, and its firmware built as docs/drives/hoverboard.md has it?"


class _Odometer:
    """A motor's angle, by counts of its Hall sensors; its velocity is that of the board, held to the angle's change."""

    def __init__(self) -> None:
        self.angle = self.velocity = self._sum = 0.0
        self._counter = WrappedCounter(0, board.TICK_COUNTS)

    def follow(self, count: int, velocity: float, elapsed_ns: int) -> None:
        if elapsed_ns > _RESTARTED_NS:
            self._counter.resume()
        self.angle = self._counter.follow(count) * TURN / board.TICKS_PER_TURN
        self._sum = self.angle if elapsed_ns > _GAP_NS else self._sum + self.velocity * elapsed_ns * 1e-9
        self.velocity = velocity + _PULL_PER_S * (self.angle - self._sum)


class Hoverboard(PhasedDrive):
    """Both motors; see `Drive`.

    The board reports neither a state nor a fault: it follows every command, and sends back which. So it counts as
    enabled, and as off, once a zero that was sent has come back; as failed, when what is sent does not come back.
    """

    name = "hoverboard"
    listens_to: Collection[FrameKey] = (FrameKey(FEEDBACK),)
    periods_s: Mapping[FrameKey, float] = {FrameKey(FEEDBACK): _PERIOD_S}
    commanded_by: Collection[FrameKey] = (FrameKey(board.COMMAND),)

    def __init__(self, link: Link, settings: HoverboardSettings, loop_period_s: float, clock: Clock) -> None:
        """Drive the board at the other end of `link`."""
        super().__init__(clock.now_ns)
        self._link = link
        self._wheels = (settings.left, settings.right)
        self._full = [wheel.torque_constant * settings.max_current for wheel in self._wheels]
        self._rests = [*_ZERO]
        self._odometers = [_Odometer() for _ in _SIDES if settings.feedback == "odometry"]
        angles = {f"{side}.angle": "rad" for side in _SIDES if self._odometers}
        self.signals: Mapping[str, str] = angles | {f"{s}.velocity": "rad/s" for s in _SIDES} | {SUPPLY_VOLTAGE: "V"}
        self.commands: Mapping[str, str] = {f"{side}.torque": "N m" for side in _SIDES}
        self.limits: Sequence[float] = tuple(wheel.max_torque for wheel in self._wheels)
        stale_ns = stale_after_ns(_PERIOD_S, loop_period_s)
        self._fresh = Freshness({FEEDBACK: stale_ns}, clock.now_ns, settings.ride_through_s)
        self._refused: Counter[str] = Counter()
        self._newest = Feedback((0, 0), (0.0, 0.0), (), 0.0, 0.0)
        self._sent: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)
        self._obeyed_ns: int | None = None
        self._zero_ns: int | None = None  # when the first zero since `enable` was sent

    def start(self) -> None:
        """Send zero."""
        self._send(_ZERO)

    def take_frame(self, frame: Frame) -> bool:
        """Take the board's feedback; see `Sensor.take_frame`."""
        try:
            self._newest = newest = board.read_feedback(frame.data)
        except FrameRefusedError as error:
            self._refused[error.refusal] += 1
            return False
        received_ns, is_zero = frame.received_ns, not any(newest.commands)
        for odometer, count, velocity in zip(self._odometers, newest.ticks, newest.velocities, strict=False):
            odometer.follow(count, velocity, received_ns - (self._fresh.newest_ns or 0))
        self._fresh.mark(FEEDBACK, received_ns)
        self._off_ns = received_ns if is_zero else None
        if newest.commands in self._sent:
            self._obeyed_ns = received_ns
            if is_zero and self._zero_ns is not None and received_ns > self._zero_ns:
                self._enabling.confirm()
        return True

    def read(self) -> Readings:
        """The wheels' angles where they are measured, their velocities, and the supply's voltage."""
        age, is_fresh = self._fresh.age(FEEDBACK)
        motors: Sequence[float] = self._newest.velocities
        if self._odometers:
            motors = [each.angle for each in self._odometers] + [each.velocity for each in self._odometers]
        values = tuple(wheel.wheel(motor) for wheel, motor in zip(self._wheels * 2, motors, strict=False))
        readings = Readings(values, (age,) * len(values), (is_fresh,) * len(values))
        return with_one_more(readings, self._newest.voltage, self._fresh.age(FEEDBACK, SUPPLY_STALE_NS))

    def arming_failures(self) -> list[str]:
        """A board that is silent, or does not take what is sent."""
        if not self._fresh.age(FEEDBACK)[1]:
            return [f"the hoverboard sends nothing intact on {self._link.description}; {_SETUP}"]
        return [] if self._obeys else [self._disobedience]

    @property
    def is_off(self) -> bool:
        """Whether it has sent back, since it was last switched off, that it was commanded zero."""
        return self._enabling.confirms_disable(self._off_ns) and self._fresh.age(FEEDBACK)[1]

    def enable(self) -> None:
        """Send zero until it comes back."""
        self._zero_ns = None
        self._enabling.begin(self._now_ns())

    def command(self, commands: Sequence[float]) -> None:
        """Send the torques, N m, where the board is enabled and was heard of lately, else zero: now, not in a cycle."""
        phase = self._enabling.phase
        self._send(commands if phase is Phase.ENABLED and self._fresh.age(FEEDBACK)[1] else _ZERO)
        if phase is Phase.ENABLING and self._zero_ns is None:
            self._zero_ns = self._now_ns()

    def disable(self) -> None:
        """Send zero: the motors coast."""
        self._enabling.end(self._now_ns())
        self._send(_ZERO)

    def faults(self) -> tuple[str, ...]:
        """A board that has fallen silent, or does not take what is sent."""
        age, is_fresh = self._fresh.age(FEEDBACK)
        if self.is_enabled and not is_fresh:
            return (f"the feedback of the hoverboard is too old: {age * 1e3:.0f} ms",)
        if self._enabling.is_overdue(self._now_ns()) or (self.is_enabled and not self._obeys):
            return (self._disobedience,)
        return ()

    @property
    def health(self) -> Mapping[str, str]:
        """What the board sends back, and what was refused of it."""
        health = {f"refused.{cause}": str(count) for cause, count in self._refused.items()}
        health |= {"phase": str(self._enabling.phase), "commands_taken": "{}, {}".format(*self._newest.commands)}
        health |= {"bus_voltage_v": f"{self._newest.voltage:.2f}", "board_deg_c": f"{self._newest.temperature:.1f}"}
        return {**health, **self._fresh.health}

    @property
    def _obeys(self) -> bool:
        """Whether one of the newest commands has come back lately."""
        return self._obeyed_ns is not None and self._now_ns() - self._obeyed_ns <= _OBEYS_WITHIN_NS

    @property
    def _disobedience(self) -> str:
        return f"the hoverboard does not take what is sent: {self._newest.commands} comes back; {_SETUP}"

    def _send(self, torques: Sequence[float]) -> None:
        """Send the commands for torques at the wheels, N m; what is rounded off joins the next, unless that is zero."""
        if not all(map(math.isfinite, torques)):
            self._refused[Refusal.RANGE] += 1
            torques = _ZERO
        commands = []
        for place, (wheel, torque) in enumerate(zip(self._wheels, torques, strict=True)):
            share = wheel.motor_torque(min(max(torque, -wheel.max_torque), wheel.max_torque)) / self._full[place]
            wanted = FULL * share + self._rests[place] if share else 0.0
            commands.append(min(max(round(wanted), -FULL), FULL))
            self._rests[place] = wanted - commands[place]
        left, right = commands
        self._sent.append((left, right))
        self._link.send(board.command_frame(left, right))
