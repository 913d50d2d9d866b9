# SPDX-License-Identifier: MIT
"""A network in simulated time: what is sent arrives later, in another order, or never; and a link that goes over it.

Equal seeds give the same chance.
"""

import enum
import heapq
import random
from collections.abc import Sequence
from typing import Final, Generic, NamedTuple, TypeVar

import msgspec
from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulated_bus import NowNs

T = TypeVar("T")

RESEND_S: Final = 0.01
"""Beyond a round trip, until what was lost in order is sent again: about what the answers of DDS wait for."""
_ATTEMPTS: Final = 100_000
_BURST_NS: Final = 2_000_000
"""Frames that begin to arrive within this time are one snapshot, and one message."""
_NS_PER_S: Final = 1_000_000_000


@enum.unique
class Delivery(enum.StrEnum):
    """What becomes of what is lost or overtaken."""

    ANY_ORDER = "any order"
    """As UDP: what is lost stays lost, and one may overtake another."""
    NEWEST = "newest"
    """As best effort in DDS: what is lost stays lost, and what was overtaken is discarded."""
    IN_ORDER = "in order"
    """As reliable in DDS, or TCP: what is lost is sent again, and what follows waits for it."""


class Partition(NamedTuple):
    """A time in which nothing passes, s of simulated time."""

    at_s: float
    for_s: float


class Network(msgspec.Struct, frozen=True, kw_only=True):
    """What a network does to a message; the same in both directions.

    Attributes:
        latency_s: One way, s.
        jitter_s: Largest deviation from it, s; each message has its own, evenly spread either way.
        loss: Probability that one is lost.
        begins_s: Before this simulated time it does nothing, s.
        grows_s: How long latency, jitter and loss then take to become what they are, s.
        repeats_s: After how long what was lost in order is sent again, s; None for a round trip and `RESEND_S`.
    """

    latency_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    partitions: tuple[Partition, ...] = ()
    begins_s: float = 0.0
    grows_s: float = 0.0
    repeats_s: float | None = None

    @property
    def repeats_ns(self) -> int:
        """After how long what was lost in order is sent again, ns."""
        return _ns(2.0 * self.latency_s + RESEND_S if self.repeats_s is None else self.repeats_s)

    def share(self, time_s: float) -> float:
        """How much of it is there at a simulated time, 0 to 1."""
        since_s = time_s - self.begins_s
        if since_s < 0.0:
            return 0.0
        return min(since_s / self.grows_s, 1.0) if self.grows_s else 1.0

    def is_cut(self, time_ns: int) -> bool:
        """Whether nothing passes at a simulated time, ns."""
        return any(_ns(at_s) <= time_ns < _ns(at_s) + _ns(for_s) for at_s, for_s in self.partitions)


PERFECT: Final = Network()
"""As within one place."""


class Arrived(NamedTuple, Generic[T]):
    """Something that has arrived, with when it was sent and when it arrived, simulated ns."""

    item: T
    sent_ns: int
    arrived_ns: int


class Channel(Generic[T]):
    """One direction of one flow over a network; `lost` never arrive: they are lost, cut off or overtaken."""

    def __init__(self, network: Network, delivery: Delivery, seed: str, now_ns: NowNs) -> None:
        """Send over `network`; `seed` is that of this flow alone, so that flows do not disturb each other's chance."""
        self.sent = 0
        self.lost = 0
        self._network = network
        self._delivery = delivery
        self._random = random.Random(seed)  # noqa: S311 - chance that can be repeated is what is wanted
        self._now_ns = now_ns
        self._under_way: list[tuple[int, int, int, T]] = []
        self._last_due_ns = 0
        self._newest = -1

    @property
    def next_ns(self) -> int | None:
        """When the next one arrives; None while nothing is under way."""
        return self._under_way[0][0] if self._under_way else None

    def send(self, item: T, at_ns: int | None = None) -> None:
        """Send something, now or as it was sent at an earlier time."""
        sent_ns = self._now_ns() if at_ns is None else at_ns
        number, in_order = self.sent, self._delivery is Delivery.IN_ORDER
        self.sent += 1
        tries = (self._attempt(sent_ns + i * self._network.repeats_ns) for i in range(_ATTEMPTS if in_order else 1))
        due_ns = next((at_ns for at_ns in tries if at_ns is not None), None)
        if due_ns is None:
            self.lost += 1
            return
        if in_order:
            due_ns = self._last_due_ns = max(due_ns, self._last_due_ns)
        heapq.heappush(self._under_way, (due_ns, number, sent_ns, item))

    def receive(self) -> list[Arrived[T]]:
        """What has arrived by now, first come first."""
        now_ns, arrived = self._now_ns(), list[Arrived[T]]()
        while self._under_way and self._under_way[0][0] <= now_ns:
            due_ns, number, sent_ns, item = heapq.heappop(self._under_way)
            if self._delivery is Delivery.NEWEST and number < self._newest:
                self.lost += 1
                continue
            self._newest = max(number, self._newest)
            arrived.append(Arrived(item, sent_ns, due_ns))
        return arrived

    def _attempt(self, sent_ns: int) -> int | None:
        """When something that is sent at a time arrives; None where it does not."""
        network, share = self._network, self._network.share(sent_ns / _NS_PER_S)
        deviation, chance = self._random.uniform(-1.0, 1.0), self._random.random()
        due_ns = sent_ns + _ns(max(network.latency_s + network.jitter_s * deviation, 0.0) * share)
        is_lost = chance < network.loss * share or network.is_cut(sent_ns) or network.is_cut(due_ns)
        return None if is_lost else due_ns


def _ns(time_s: float) -> int:
    return round(time_s * _NS_PER_S)


class RemoteLink(LinkFront):
    """The node's end of a bus that is at the other end of a network; see `Link`.

    The gateway on the robot sends each snapshot on as soon as it has passed on the bus, and puts commands on the bus
    when they arrive. Frames carry the time at which they reached the node: two machines have no common clock for
    their age.
    """

    def __init__(self, bus: Link, up: Channel[Sequence[Frame]], down: Channel[list[Frame]], now_ns: NowNs) -> None:
        """Stand at the far end of the network: `up` comes from the gateway, whose link is `bus`, `down` goes to it."""
        super().__init__(bus)
        self._up = up
        self._down = down
        self._now_ns = now_ns
        self._message: list[Frame] = []
        self._message_ns = -1

    @property
    def next_ns(self) -> int | None:
        """When the gateway next has something to put on the bus."""
        return self._down.next_ns

    def act(self) -> None:
        """Put what has arrived at the gateway on the bus."""
        for message in self._down.receive():
            for frame in message.item:
                self.behind.send(frame)

    def send(self, frame: Frame) -> bool:
        """Send over the network; what is sent at one instant is one message. See `Link.send`."""
        now_ns = self._now_ns()
        if now_ns != self._message_ns:
            self._message, self._message_ns = [], now_ns
            self._down.send(self._message)
        self._message.append(frame)
        return True

    def receive(self) -> list[Frame]:
        """What has come over the network; see `Link.receive`."""
        for burst in bursts(self.behind.receive()):
            self._up.send(burst, burst[-1].received_ns)
        return [
            replace(frame, received_ns=frame.received_ns + message.arrived_ns - message.sent_ns)
            for message in self._up.receive()
            for frame in message.item
        ]


def bursts(frames: Sequence[Frame]) -> list[list[Frame]]:
    """Frames that came together."""
    found: list[list[Frame]] = []
    for frame in frames:
        if not found or frame.received_ns - found[-1][0].received_ns > _BURST_NS:
            found.append([])
        found[-1].append(frame)
    return found
