# SPDX-License-Identifier: MIT
"""A CAN bus in simulated time: frames take their time on the wire, and the lowest identifier wins it."""

from collections.abc import Callable, Mapping
from typing import Final

from segway_ecc.firmware_io.links.link import (
    FD_LENGTHS,
    Frame,
    LinkCounters,
    LinkState,
    worst_case_bits,
    worst_case_fd_bits,
)

NowNs = Callable[[], int]

_NS_PER_S: Final = 1_000_000_000
_LENGTHS: Final = 9
_TRAILING_BITS: Final = 18
"""Of an extended identifier, after those that it has in common with a standard one."""


_Waiting = tuple[int, int, int, Frame, "SimulatedLink"]
"""A frame that is to go over the wire: since when (ns), its priority in arbitration, of which the lowest wins, how long
it takes (ns), and whose it is."""


class SimulatedBus:
    """The wire: every frame reaches every other participant when its last bit has passed.

    Attributes:
        carries_fd: Whether it takes frames of CAN FD.
    """

    def __init__(self, bitrate: int, now_ns: NowNs, fd_bitrate: int | None = None) -> None:
        """Make a bus at `bitrate` bit/s on a simulated clock, which carries CAN FD where its data have a bit rate."""
        self._durations_ns = [
            [round(worst_case_bits(n, is_extended=extended) * _NS_PER_S / bitrate) for n in range(_LENGTHS)]
            for extended in (False, True)
        ]
        self.carries_fd = fd_bitrate is not None
        self._fd_durations_ns = [
            {n: _fd_duration_ns(n, (bitrate, fd_bitrate or bitrate), is_extended=extended) for n in FD_LENGTHS}
            for extended in (False, True)
        ]
        self._now_ns = now_ns
        self._links: list[SimulatedLink] = []
        self._waiting: list[_Waiting] = []  # as they were submitted, so the time never falls
        self._busy_until_ns = 0

    def attach(self, name: str) -> "SimulatedLink":
        """A new participant."""
        link = SimulatedLink(self, name)
        self._links.append(link)
        return link

    def submit(self, frame: Frame, sender: "SimulatedLink") -> None:
        """Queue a frame for the wire."""
        identifier, is_extended = frame.arbitration_id, frame.is_extended
        if frame.is_fd:
            duration_ns = self._fd_durations_ns[is_extended][len(frame.data)]
        else:
            duration_ns = self._durations_ns[is_extended][len(frame.data)]
        # In arbitration the lower leading bits win; of equal ones the standard frame (ISO 11898-1).
        priority = identifier << _TRAILING_BITS + 1
        if is_extended:
            priority = (identifier >> _TRAILING_BITS) << _TRAILING_BITS + 1 | 1 + (
                identifier & (1 << _TRAILING_BITS) - 1
            )
        self._waiting.append((self._now_ns(), priority, duration_ns, frame, sender))

    def deliver(self) -> None:
        """Put on the wire, and hand out, everything that has passed by now."""
        waiting = self._waiting
        if not waiting:
            return
        now_ns = self._now_ns()
        while waiting:
            start_ns, busy_ns = waiting[0][0], self._busy_until_ns
            if busy_ns > start_ns:  # noqa: PLR1730 - max() takes longer
                start_ns = busy_ns
            winner = waiting[0] if len(waiting) == 1 else self._winner(start_ns)
            _, _, duration_ns, sent, sender = winner
            end_ns = start_ns + duration_ns
            if end_ns > now_ns:
                # Nothing that is submitted later can be on the wire before this one has won it, except what beats it
                # in arbitration at the same instant; so it stays queued until its end is certain.
                return
            waiting.remove(winner)
            self._busy_until_ns = end_ns
            received = Frame(sent.arbitration_id, sent.data, end_ns, sent.is_extended, sent.is_remote, sent.is_fd)
            for link in self._links:
                if link is not sender:
                    link.hand(received)

    def _winner(self, start_ns: int) -> _Waiting:
        """Which of those that wait at `start_ns` wins the wire; of equal ones the first."""
        waiting = self._waiting
        best = waiting[0]
        for entry in waiting:
            if entry[0] > start_ns:
                break
            if entry[1] < best[1]:
                best = entry
        return best


def _fd_duration_ns(length: int, bitrates: tuple[int, int], *, is_extended: bool) -> int:
    """How long a frame of CAN FD takes, ns, where all but its data go at the first bit rate, bit/s."""
    slow, fast = worst_case_fd_bits(length, is_extended=is_extended)
    return round((slow / bitrates[0] + fast / bitrates[1]) * _NS_PER_S)


class SimulatedLink:
    """One participant's connection to a simulated bus; see `Link`."""

    def __init__(self, bus: SimulatedBus, name: str) -> None:
        """Attach to a bus; use `SimulatedBus.attach`."""
        self.counters = LinkCounters()
        self._bus = bus
        self._name = name
        self._received: list[Frame] = []

    @property
    def description(self) -> str:
        """Which bus this is."""
        return f"simulated bus, {self._name}"

    @property
    def state(self) -> LinkState:
        """The simulated bus is always well."""
        return LinkState.ACTIVE

    @property
    def health(self) -> Mapping[str, str]:
        """The counts so far."""
        return self.counters.as_text()

    def open(self) -> None:
        """Discard what passed before."""
        self._received.clear()

    def send(self, frame: Frame) -> bool:
        """Queue a frame for the wire; False for one of CAN FD on a bus that carries classic ones."""
        if frame.is_fd and not self._bus.carries_fd:
            self.counters.send_dropped += 1
            return False
        self._bus.submit(frame, self)
        self.counters.sent += 1
        return True

    def receive(self) -> list[Frame]:
        """Everything that has passed by now."""
        self._bus.deliver()
        frames, self._received = self._received, []
        return frames

    def hand(self, frame: Frame) -> None:
        """Called by the bus with each frame of another participant."""
        self.counters.received += 1
        self._received.append(frame)

    def close(self) -> None:
        """Discard what was not received."""
        self._received.clear()
