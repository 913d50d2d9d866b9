"""A CAN bus in simulated time: frames take their time on the wire, and the lowest identifier wins it."""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Final

from firmware_io.links.link import Frame, LinkCounters, LinkState, worst_case_bits

NowNs = Callable[[], int]

_NS_PER_S: Final = 1_000_000_000


class SimulatedBus:
    """The wire: every frame reaches every other participant when its last bit has passed."""

    def __init__(self, bitrate: int, now_ns: NowNs) -> None:
        """Make a bus at `bitrate` bit/s on a simulated clock."""
        self._ns_per_bit = _NS_PER_S / bitrate
        self._now_ns = now_ns
        self._links: list[SimulatedLink] = []
        self._waiting: list[tuple[int, Frame, SimulatedLink]] = []
        self._busy_until_ns = 0

    def attach(self, name: str) -> "SimulatedLink":
        """A new participant."""
        link = SimulatedLink(self, name)
        self._links.append(link)
        return link

    def submit(self, frame: Frame, sender: "SimulatedLink") -> None:
        """Queue a frame for the wire."""
        self._waiting.append((self._now_ns(), frame, sender))

    def deliver(self) -> None:
        """Put on the wire, and hand out, everything that has passed by now."""
        now_ns = self._now_ns()
        while self._waiting:
            start_ns = max(self._busy_until_ns, min(submitted for submitted, _, _ in self._waiting))
            ready = [entry for entry in self._waiting if entry[0] <= start_ns]
            winner = min(ready, key=_priority)
            end_ns = start_ns + round(worst_case_bits(winner[1]) * self._ns_per_bit)
            if end_ns > now_ns:
                # Nothing that is submitted later can be on the wire before this one has won it, except what beats it
                # in arbitration at the same instant; so it stays queued until its end is certain.
                return
            self._waiting.remove(winner)
            self._busy_until_ns = end_ns
            _, frame, sender = winner
            received = frame._replace(received_ns=end_ns)
            for link in self._links:
                if link is not sender:
                    link.hand(received)


def _priority(entry: tuple[int, Frame, "SimulatedLink"]) -> tuple[int, int]:
    """Arbitration: the lower leading bits win; of equal ones the standard frame (ISO 11898-1)."""
    frame = entry[1]
    if frame.is_extended:
        return frame.arbitration_id >> 18, 1 + (frame.arbitration_id & 0x3FFFF)
    return frame.arbitration_id, 0


class SimulatedLink:
    """One participant's connection to a simulated bus; see `Link`."""

    def __init__(self, bus: SimulatedBus, name: str) -> None:
        """Attach to a bus; use `SimulatedBus.attach`."""
        self.counters = LinkCounters()
        self._bus = bus
        self._name = name
        self._received: deque[Frame] = deque()

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
        """Forget what passed before."""
        self._received.clear()

    def send(self, frame: Frame) -> bool:
        """Queue a frame for the wire."""
        self._bus.submit(frame, self)
        self.counters.sent += 1
        return True

    def receive(self) -> list[Frame]:
        """Everything that has passed by now."""
        self._bus.deliver()
        frames = list(self._received)
        self._received.clear()
        return frames

    def hand(self, frame: Frame) -> None:
        """Called by the bus with each frame of another participant."""
        self.counters.received += 1
        self._received.append(frame)

    def close(self) -> None:
        """Forget what was not taken."""
        self._received.clear()
