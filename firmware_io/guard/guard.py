# SPDX-License-Identifier: MIT
"""The guard at work: a link to the bus, the heartbeats, and a small loop around the watch."""

import contextlib
import itertools
import logging
from collections.abc import Iterator
from typing import Final, Protocol

from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.guard.watch import Intervention, Watch
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.settings import HardwareSettings

PASS_NS: Final = 2_000_000
"""From one look at the bus to the next."""
_HASTE_NS: Final = 500_000
"""The same while the drives are being stopped: whatever is commanded meanwhile acts for no longer."""
_REPORT_EVERY_NS: Final = 1_000_000_000
_DRAINS: Final = 20
"""A link hands out so many frames at a time; after a preemption more are waiting."""
_logger = logging.getLogger(__name__)


class HeartbeatSource(Protocol):
    """Where the node's heartbeats arrive."""

    def open(self) -> None:
        """Listen."""

    def take_heartbeats(self) -> Iterator[bool]:
        """Of each heartbeat, whether the motors are wanted on."""

    def answer(self, stops: str) -> None:
        """Answer them, with why the drives are being stopped; empty where they are not."""

    def close(self) -> None:
        """Stop listening."""


class Guard:
    """Watches a bus, and stops the drives on it."""

    def __init__(self, link: Link, beats: HeartbeatSource, watch: Watch, clock: Clock) -> None:
        """Guard what `watch` watches."""
        self._link = link
        self._beats = beats
        self._watch = watch
        self._clock = clock
        self._is_bus_lost = False
        self._begun: Intervention | None = None
        self._reported_ns: int | None = None
        self._is_stopped = False

    def stop(self, _reason: str = "") -> None:
        """End after the present pass; may be called from a signal handler."""
        self._is_stopped = True

    def run(self) -> None:
        """Guard until stopped.

        Raises:
            HardwareError: The bus is not there, or has a guard already.
        """
        with contextlib.ExitStack() as exits:
            for part in (self._beats, self._link):
                exits.callback(part.close)
                part.open()
            self._watch.excuse(self._clock.now_ns())
            _logger.info("guard on %s", self._link.description)
            while not self._is_stopped:
                self.step()
                pause_ns = PASS_NS if self._watch.present is None else _HASTE_NS
                self._clock.sleep_until_ns(self._clock.now_ns() + pause_ns)

    def step(self) -> None:
        """One pass: listen, judge, stop what must be stopped."""
        # The node sends its heartbeat before its commands: of those that are here now, the heartbeats are too.
        frames = self._listen()
        for is_on in self._beats.take_heartbeats():
            self._watch.beat(self._clock.now_ns(), is_on=is_on)
        now_ns = self._clock.now_ns()
        if frames is None:
            self._watch.excuse(now_ns)
            self._beats.answer("")
            return
        for frame in frames:
            self._watch.take_frame(frame)
        stop_frames, present = self._watch.step(now_ns), self._watch.present
        # The node knows from this who sent the frames that follow.
        self._beats.answer("" if present is None else str(present.cause))
        for frame in stop_frames:
            self._link.send(frame)
        self._report(present, now_ns)

    def _report(self, present: Intervention | None, now_ns: int) -> None:
        """Log an intervention when it begins and when it has ended; of many in a row one a second."""
        if present is self._begun:
            return
        ended, self._begun = self._begun, present
        if present is not None:
            if self._reported_ns is None or now_ns - self._reported_ns >= _REPORT_EVERY_NS:
                self._reported_ns = now_ns
                _logger.warning("stopping the drives: %s", present.cause)
        elif ended is not None and self._reported_ns == ended.first_ns:
            _logger.warning("%s", describe(ended))

    def _listen(self) -> list[Frame] | None:
        """What has arrived; None while the bus is gone, which is logged once."""
        frames: list[Frame] = []
        try:
            for found in itertools.takewhile(len, (self._link.receive() for _ in range(_DRAINS))):
                frames += found
        except LinkLostError as error:
            if not self._is_bus_lost:
                _logger.warning("%s: nothing is guarded until it is back", error)
            self._is_bus_lost = True
            return None
        if self._is_bus_lost:
            _logger.warning("%s is back, and guarded", self._link.description)
            self._is_bus_lost = False
        return frames


def describe(done: Intervention) -> str:
    """An intervention in one line."""
    after = "no heartbeat was ever received"
    if done.last_alive_ns is not None:
        after = f"{(done.first_ns - done.last_alive_ns) * 1e-6:.1f} ms after the last heartbeat"
    lasted = f"over {(done.last_ns - done.first_ns) * 1e-6:.0f} ms"
    return f"stopped the drives: {done.cause}; {after}, {done.frames} frames {lasted}, until {done.end}"


def stopper_of(settings: HardwareSettings) -> Stopper:
    """What reads and stops the drives that a robot file describes."""
    return family_of(settings).stopper(settings)
