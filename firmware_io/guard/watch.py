# SPDX-License-Identifier: MIT
"""What the guard decides: given the frames on the bus, the node's heartbeats and the time, which frames to send.

A command keeps nothing alive: anybody can send one. Only the heartbeats of the bus' owner show that the node lives.
"""

import enum
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.firmware_io.drives.stopper import Meaning, Stopper
from segway_ecc.firmware_io.links.link import Frame

LIMIT_NS: Final = 30_000_000
"""Heartbeats that stopped this long ago have stopped."""
AGAIN_NS: Final = 10_000_000
"""From one round of stop frames to the next."""
GIVE_UP_NS: Final = 1_000_000_000
"""Longest time that stop frames are sent for."""
IN_FLIGHT_NS: Final = 5_000_000
"""A report that arrives this soon after a command may have been on its way before it."""
STRANGE_NS: Final = 100_000_000
"""Stop frames go on until strange commands have been missing for as long."""
KEPT: Final = 100
"""Interventions that are remembered; all are counted."""


@enum.unique
class Cause(enum.StrEnum):
    """Why the guard stopped the drives."""

    SILENCE = "the node's heartbeats stopped"
    STRANGER = "motion was commanded that the node did not want"
    DEFIANCE = "a stopped node commanded motion without a zero before"


@enum.unique
class End(enum.StrEnum):
    """Why the guard stopped stopping them."""

    OFF = "the drives report off"
    NODE = "the node is back"
    TIME = "the time for it is over"


@dataclass(slots=True)
class Intervention:
    """A time in which the guard sent stop frames.

    Attributes:
        last_alive_ns: When the node's last heartbeat before that was received, monotonic; None where none was.
        first_ns: When the first stop frame was sent, monotonic.
        last_ns: When the last one was.
        frames: How many were sent.
        end: Why it ended; None while it lasts.
    """

    cause: Cause
    last_alive_ns: int | None
    first_ns: int
    last_ns: int
    frames: int = 0
    end: End | None = None


@dataclass(slots=True)
class _Drive:
    """What is known of a drive.

    Attributes:
        moved_ns: When it was last commanded to move, or the node last wanted it to.
        rested_ns: When it was last sent a zero, or switched off.
        off_ns: When it last reported that it is off; None where it was commanded to move since.
        wants: Whether its last command was to move, or the node wants it to.
        is_on: Whether its last report was that it is on.
        is_barred: Whether it was stopped, and has not been sent a zero since.
        is_defied: Whether it was commanded to move nevertheless.
    """

    moved_ns: int = 0
    rested_ns: int = 0
    off_ns: int | None = None
    wants: bool = False
    is_on: bool = False
    is_barred: bool = False
    is_defied: bool = False

    def move(self, at_ns: int) -> None:
        """It is to move."""
        self.wants, self.moved_ns, self.off_ns = True, at_ns, None

    def report_off(self, at_ns: int) -> None:
        """It is off; what was on its way before the last command to move does not count."""
        self.is_on = False
        if at_ns - self.moved_ns >= IN_FLIGHT_NS:
            self.wants, self.off_ns = False, at_ns


class Watch:
    """Watches the drives of a robot and decides which frames to send; none while all is well.

    Attributes:
        commands: To the drives, that were received; likewise `heartbeats`, of the node.
        strange: Commands to move while the node wanted none, or did not live.
        longest_gap_ns: Longest time between two heartbeats while a drive followed.
        present: The intervention that lasts; None where none does.
        interventions: The newest ones.
        intervened: How many there were.
    """

    def __init__(self, stopper: Stopper, now_ns: int, limit_ns: int = LIMIT_NS) -> None:
        """Watch from now on; heartbeats silent for longer than `limit_ns` have stopped."""
        self.commands = 0
        self.heartbeats = 0
        self.strange = 0
        self.longest_gap_ns = 0
        self.present: Intervention | None = None
        self.interventions: deque[Intervention] = deque(maxlen=KEPT)
        self.intervened = 0
        self._stopper = stopper
        self._limit_ns = limit_ns
        self._drives = {name: _Drive() for name in stopper.drives}
        self._watching_ns = now_ns
        self._stepped_ns = now_ns
        self._alive_ns: int | None = None
        self._wanted_on_ns = now_ns
        self._strange_ns: int | None = None

    def take_frame(self, frame: Frame) -> None:
        """Take a frame of somebody else from the bus."""
        observed = self._stopper.read(frame)
        if observed is None:
            return
        drive = self._drives[observed.drive]
        match observed.meaning:
            case Meaning.ON:
                drive.is_on = True
            case Meaning.OFF:
                drive.report_off(frame.received_ns)
            case _:
                self._obey(drive, observed.meaning, frame.received_ns)

    def beat(self, now_ns: int, *, is_on: bool) -> None:
        """Take a heartbeat of the node, with whether it wants the motors on."""
        self.heartbeats += 1
        drives, before_ns, self._alive_ns = self._drives.values(), self._alive_ns, now_ns
        if before_ns is not None and any(drive.wants or drive.is_on for drive in drives):
            self.longest_gap_ns = max(self.longest_gap_ns, now_ns - before_ns)
        if is_on:
            self._wanted_on_ns = now_ns
        for drive in drives:
            if is_on:
                drive.move(now_ns)
            else:
                drive.wants = False

    def excuse(self, now_ns: int) -> None:
        """Nothing could be received until now, which is not the node's fault."""
        self._watching_ns = self._stepped_ns = now_ns

    def step(self, now_ns: int) -> Sequence[Frame]:
        """What to send now."""
        self._look_at_self(now_ns)
        present = self.present
        if present is None:
            cause = self._cause(now_ns)
            if cause is None:
                return ()
            present = self._begin(cause, now_ns)
        elif (end := self._end_of(present, now_ns)) is not None:
            self._end(present, end)
            return ()
        return self._stop(present, now_ns)

    def _obey(self, drive: _Drive, meaning: Meaning, at_ns: int) -> None:
        self.commands += 1
        if meaning is Meaning.MOVE:
            drive.move(at_ns)
            # Nobody but a node that lives and wants the motors on, now or a moment ago, commands motion.
            is_strange = at_ns - max(self._wanted_on_ns, self._watching_ns) > self._limit_ns
            if is_strange:
                self.strange += 1
                self._strange_ns = at_ns
            drive.is_defied = drive.is_defied or drive.is_barred or is_strange
            return
        drive.wants = drive.is_barred = drive.is_defied = False
        drive.rested_ns = at_ns
        if meaning is Meaning.DISABLE:
            # Its last report is out of date; should it not obey, its next one shows it.
            drive.is_on = False

    def _look_at_self(self, now_ns: int) -> None:
        """A guard that was preempted itself listens for half the limit before it judges."""
        if now_ns - self._stepped_ns > self._limit_ns // 2:
            self._watching_ns = now_ns - self._limit_ns // 2
        self._stepped_ns = now_ns

    def _cause(self, now_ns: int) -> Cause | None:
        drives = self._drives.values()
        if any(drive.is_defied for drive in drives):
            return Cause.STRANGER if self._is_strange(now_ns) else Cause.DEFIANCE
        since_ns = self._watching_ns if self._alive_ns is None else max(self._alive_ns, self._watching_ns)
        if now_ns - since_ns > self._limit_ns and any(drive.wants or drive.is_on for drive in drives):
            return Cause.SILENCE
        return None

    def _is_strange(self, now_ns: int) -> bool:
        """Whether a strange command came lately."""
        return self._strange_ns is not None and now_ns - self._strange_ns <= STRANGE_NS

    def _begin(self, cause: Cause, now_ns: int) -> Intervention:
        self.present = present = Intervention(cause, self._alive_ns, now_ns, now_ns - AGAIN_NS)
        self.interventions.append(present)
        self.intervened += 1
        for drive in self._drives.values():
            drive.off_ns = None
            # Of drives that do not report, the node cannot learn that they were stopped: it would never send a zero.
            drive.is_barred = self._stopper.reports
        return present

    def _end_of(self, present: Intervention, now_ns: int) -> End | None:
        drives, first_ns = self._drives.values(), present.first_ns
        if self._is_strange(now_ns):  # it goes on: else each of its commands would be an intervention of its own
            return None
        if self._stopper.reports:
            if all(drive.off_ns is not None and drive.off_ns >= first_ns for drive in drives):
                return End.OFF
            is_back = all(drive.rested_ns >= first_ns for drive in drives)
        else:
            is_back = self._alive_ns is not None and self._alive_ns >= first_ns
        if is_back:
            return End.NODE
        return End.TIME if now_ns - max(first_ns, self._strange_ns or 0) >= GIVE_UP_NS else None

    def _end(self, present: Intervention, end: End) -> None:
        """Discard what was known of the drives: one that is still on reports so again."""
        present.end = end
        self.present = None
        for drive in self._drives.values():
            drive.wants = drive.is_on = False

    def _stop(self, present: Intervention, now_ns: int) -> Sequence[Frame]:
        is_defied = any(drive.is_defied for drive in self._drives.values())
        if not (is_defied or now_ns - present.last_ns >= AGAIN_NS):
            return ()
        for drive in self._drives.values():
            drive.is_defied = False
        frames = self._stopper.stop()
        present.frames += len(frames)
        present.last_ns = now_ns
        return frames
