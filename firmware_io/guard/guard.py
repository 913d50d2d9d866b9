# SPDX-License-Identifier: MIT
"""The guard at work: two links to the bus, the heartbeats, and a small loop around the watch."""

import contextlib
import itertools
import logging
from collections.abc import Iterator
from typing import Final, Protocol

from segway_ecc.firmware_io.build import HardwareSettings
from segway_ecc.firmware_io.clock import Clock
from segway_ecc.firmware_io.drives.cia402.stop import Cia402Stopper
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.odrive.stop import OdriveStopper
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.vesc.stop import VescStopper
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.drives.wheel_board.stop import WheelBoardStopper
from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.guard.watch import Intervention, Watch
from segway_ecc.firmware_io.links.link import Frame, Link

PASS_NS: Final = 2_000_000
"""From one look at the bus to the next."""
_DRAINS: Final = 20
"""A link hands out so many frames at a time; after a preemption more are waiting."""
_logger = logging.getLogger(__name__)


class HeartbeatSource(Protocol):
    """Where the node's heartbeats arrive."""

    def open(self) -> None:
        """Listen."""

    def take_heartbeats(self) -> Iterator[bool]:
        """Of each heartbeat, whether the motors are wanted on."""

    def close(self) -> None:
        """Stop listening."""


class Guard:
    """Listens on one link and stops the drives over another.

    A link takes what comes with an identifier that it has sent for its own frame come back. A guard with one link would
    not receive the node from its first stop frame on, so it listens on a link that never sends.
    """

    def __init__(self, receiving: Link, sending: Link, beats: HeartbeatSource, watch: Watch, clock: Clock) -> None:
        """Guard what `watch` watches."""
        self._receiving = receiving
        self._sending = sending
        self._beats = beats
        self._watch = watch
        self._clock = clock
        self._is_bus_lost = False
        self._reported: Intervention | None = None
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
            for part in (self._beats, self._receiving, self._sending):
                exits.callback(part.close)
                part.open()
            self._watch.excuse(self._clock.now_ns())
            _logger.info("guard on %s", self._receiving.description)
            while not self._is_stopped:
                self.step()
                self._clock.sleep_until_ns(self._clock.now_ns() + PASS_NS)

    def step(self) -> None:
        """One pass: listen, judge, stop what must be stopped."""
        for is_on in self._beats.take_heartbeats():
            self._watch.beat(self._clock.now_ns(), is_on=is_on)
        frames = self._listen()
        now_ns = self._clock.now_ns()
        if frames is None:
            self._watch.excuse(now_ns)
            return
        for frame in frames:
            self._watch.take_frame(frame)
        for frame in self._watch.step(now_ns):
            self._sending.send(frame)
        newest = self._watch.interventions[-1] if self._watch.interventions else None
        if newest is not None and newest.end is not None and newest is not self._reported:
            self._reported = newest
            _logger.warning("%s", describe(newest))

    def _listen(self) -> list[Frame] | None:
        """What has arrived; None while the bus is gone, which is logged once."""
        with contextlib.suppress(LinkLostError):
            self._sending.receive()  # nobody needs it, but a link that is lost comes back only where it is read
        frames: list[Frame] = []
        try:
            for found in itertools.takewhile(len, (self._receiving.receive() for _ in range(_DRAINS))):
                frames += found
        except LinkLostError as error:
            if not self._is_bus_lost:
                _logger.warning("%s: nothing is guarded until it is back", error)
            self._is_bus_lost = True
            return None
        if self._is_bus_lost:
            _logger.warning("%s is back, and guarded", self._receiving.description)
            self._is_bus_lost = False
        return frames


def describe(done: Intervention) -> str:
    """An intervention in one line."""
    after = "no command was ever received"
    if done.last_command_ns is not None:
        after = f"{(done.first_ns - done.last_command_ns) * 1e-6:.1f} ms after the last command"
    lasted = f"over {(done.last_ns - done.first_ns) * 1e-6:.0f} ms"
    return f"stopped the drives: {done.cause}; {after}, {done.frames} frames {lasted}, until {done.end}"


def stopper_of(settings: HardwareSettings) -> Stopper:
    """What reads and stops the drives that a robot file describes."""
    match settings:
        case WheelBoardSettings():
            return WheelBoardStopper()
        case OdriveSettings():
            return OdriveStopper(settings)
        case VescSettings():
            return VescStopper(settings)
    return Cia402Stopper(settings)
