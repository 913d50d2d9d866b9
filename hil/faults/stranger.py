# SPDX-License-Identifier: MIT
"""Another participant of the bus, who sends there what only the node or the devices may send."""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.drives.stopper import Meaning, Stopper
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.faults.fault import Injection, Injections, active
from segway_ecc.hil.rig.simulated_bus import NowNs

_LISTENS_EVERY_NS: Final = 1_000_000
_MOST_PARTS: Final = 3
"""Frames of a command before the one that completes it: a wheel board's has one."""


class Stranger:
    """Plays what the node commanded or the devices sent, or makes up its own; see `Source`."""

    def __init__(self, link: Link, stopper: Stopper, injections: Injections, now_ns: NowNs) -> None:
        """Listen on `link`, and send there while a fault asks for it."""
        self._link = link
        self._stopper = stopper
        self._injections = injections.of("stranger")
        self._now_ns = now_ns
        self._newest: dict[str, Sequence[Frame]] = {}
        self._parts: deque[Frame] = deque(maxlen=_MOST_PARTS)
        self._of_devices: dict[FrameKey, Frame] = {}
        self._recording: deque[tuple[int, Frame]] = deque()
        self._records = any(injection.fault.type == "delayed" for injection in self._injections)
        self.next_ns: int | None = 0 if self._injections else None

    def overhear(self, frame: Frame) -> None:
        """Note a frame of a device, as it is sent."""
        self._of_devices[FrameKey(frame.arbitration_id, frame.is_extended)] = frame
        if self._records:
            self._recording.append((self._now_ns(), frame))

    def act(self) -> None:
        """Note what moves a drive, and send what is asked for."""
        faults = active(self._injections)
        # Before the fault only what it heard counts: after it, the node's zeros are not worth playing.
        for frame in self._link.receive():
            observed = self._stopper.read(frame)
            if observed is None and (frame.arbitration_id, frame.is_extended) not in self._of_devices:
                self._parts.append(frame)  # of the node; a command may take several, of which the last one is read
                continue
            if observed is not None and observed.meaning is Meaning.MOVE and not faults:
                self._newest[observed.drive] = (*self._parts, frame)
            self._parts.clear()
        self.next_ns = self._now_ns() + _LISTENS_EVERY_NS
        for injection in faults:
            for frame in self._frames(injection):
                self._link.send(frame)
            self.next_ns = self._next_ns(injection)

    def _next_ns(self, injection: Injection) -> int:
        """When the next of them is due: what is played, as long after its time as the recording is old."""
        if injection.fault.type != "delayed":
            return self._now_ns() + round(1e9 / injection.size)
        listens_ns = self._now_ns() + _LISTENS_EVERY_NS
        return min([listens_ns, *(sent_ns + round(injection.size * 1e9) for sent_ns, _ in [*self._recording][:1])])

    def _frames(self, injection: Injection) -> Iterator[Frame]:
        match injection.fault.type:
            case "off":
                yield from self._stopper.stop()
            case "garbage":
                for frame in self._of_devices.values():
                    yield replace(frame, data=injection.random.randbytes(len(frame.data)))
            case "delayed":
                recording, now_ns = self._recording, self._now_ns()
                delay_ns = round(injection.size * 1e9)
                begun_ns = now_ns - injection.since_ns - delay_ns
                while recording and recording[0][0] + delay_ns <= now_ns:
                    sent_ns, frame = recording.popleft()
                    if sent_ns >= begun_ns:
                        yield frame
            case _:
                for frames in self._newest.values():
                    yield from frames
