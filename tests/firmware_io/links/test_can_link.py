# SPDX-License-Identifier: MIT
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links import can_interfaces
from segway_ecc.firmware_io.links.can_interfaces import UNKNOWN, InterfaceState
from segway_ecc.firmware_io.links.can_link import ERROR, EXTENDED, REMOTE, Arrival, CanBus, CanLink, PortError
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState
from tests.patience import PATIENCE_S

S = 1_000_000_000
BUS_OFF, RESTARTED = ERROR | 0x40, ERROR | 0x100
GONE = PortError("Network is down", is_gone=True)
HICCUP = PortError("odd")


class FakePort:
    """A bus on which everything that arrives or fails is prepared."""

    def __init__(self) -> None:
        self.arriving: deque[Arrival | PortError] = deque()
        self.refusing: PortError | None = None
        self.sent: list[Frame] = []
        self.closed = 0

    def send(self, frame: Frame) -> None:
        if self.refusing is not None:
            raise self.refusing
        self.sent.append(frame)

    def drain(self) -> Iterator[Arrival]:
        while self.arriving:
            arriving = self.arriving.popleft()
            if isinstance(arriving, PortError):
                raise arriving
            yield arriving

    def close(self) -> None:
        self.closed += 1


class Bus:
    """Opens ports, when it is let, and keeps them."""

    def __init__(self) -> None:
        self.ports: list[FakePort] = []
        self.failure: Exception | None = None
        self.gate = threading.Event()
        self.gate.set()
        self.attempts = 0
        self.now_ns = 5 * S

    def open(self, _counters: LinkCounters) -> FakePort:
        self.attempts += 1
        assert self.gate.wait(PATIENCE_S)
        if self.failure is not None:
            raise self.failure
        self.ports.append(FakePort())
        return self.ports[-1]

    @property
    def port(self) -> FakePort:
        return self.ports[-1]


@pytest.fixture
def bus() -> Iterator[Bus]:
    bus = Bus()
    yield bus
    bus.gate.set()


@pytest.fixture
def link(bus: Bus) -> Iterator[CanLink]:
    link = CanLink(CanBus("fake bus", 500_000, None), bus.open, lambda: bus.now_ns, lambda: bus.now_ns)
    link.open()
    yield link
    link.close()


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "another thread did not do its part"
        time.sleep(0.001)


def is_back(link: CanLink) -> bool:
    try:
        link.receive()
    except LinkLostError:
        return False
    return True


def lose(link: CanLink, bus: Bus) -> None:
    bus.port.arriving.append(GONE)
    with pytest.raises(LinkLostError, match=r"^CAN bus fake bus is gone: Network is down$"):
        link.receive()


def _error(word: int, **data: int) -> Arrival:
    filled = bytearray(8)
    for name, value in data.items():
        filled[int(name[1:])] = value
    return word, bytes(filled), 0


def test_every_kind_of_frame_is_distinguished(link: CanLink, bus: Bus) -> None:
    bus.port.arriving += [
        (0x123, b"12", 0),
        (0x123 | EXTENDED, b"", 0),
        (0x123 | REMOTE, b"", 0),
        (0x008 | ERROR | REMOTE | EXTENDED, bytes(8), 0),
        (0x7FF | 0x1F000, b"3", 0),  # bits that no standard identifier has
    ]
    assert [replace(frame, received_ns=0) for frame in link.receive()] == [
        Frame(0x123, b"12"),
        Frame(0x123, b"", is_extended=True),
        Frame(0x7FF, b"3"),
    ]
    counters = link.counters
    assert (counters.received, counters.remote_frames, counters.error_frames) == (3, 1, 1)


def test_bits_are_those_of_the_longest_stuffing_both_ways(link: CanLink, bus: Bus) -> None:
    # Davis et al. 2007: 55 + 10 n for a standard identifier and n bytes, 80 + 10 n for an extended one.
    bus.port.arriving += [(1, b"12345678", 0), (1 | EXTENDED, b"123", 0), (2 | REMOTE, bytes(8), 0)]
    link.receive()
    assert link.counters.bits == 135 + 110 + 55
    link.send(Frame(3, b"1"))
    link.send(Frame(3, bytes(8), is_extended=True, is_remote=True))
    assert link.counters.bits == 300 + 65 + 80


def test_what_comes_with_an_identifier_that_we_send_is_somebody_else_s(link: CanLink, bus: Bus) -> None:
    link.send(Frame(0x100, b"1"))
    link.send(Frame(0x200, b"2", is_extended=True))
    bus.port.arriving += [(0x100, b"1", 0), (0x200 | EXTENDED, b"2", 0)]

    assert [(frame.arbitration_id, frame.is_extended) for frame in link.receive()] == [(0x100, False), (0x200, True)]
    assert (link.counters.echoes, link.counters.received) == (0, 2)


def test_remote_frames_are_received_only_where_wanted(link: CanLink, bus: Bus) -> None:
    asked = (0x300 | REMOTE, b"", 0)
    bus.port.arriving.append(asked)
    assert link.receive() == []
    link.receives_remote = True
    bus.port.arriving.append(asked)
    (frame,) = link.receive()
    assert (frame.arbitration_id, frame.data, frame.is_remote, frame.is_extended) == (0x300, b"", True, False)
    assert (link.counters.remote_frames, link.counters.received) == (2, 0)


def test_error_frames_make_the_state(link: CanLink, bus: Bus) -> None:
    steps = [
        (_error(0x204 | ERROR, _1=0x08, _6=97, _7=2), LinkState.WARNING),
        (_error(0x204 | ERROR, _1=0x20, _6=128, _7=2), LinkState.PASSIVE),
        (_error(0x020 | ERROR), LinkState.PASSIVE),
        (_error(BUS_OFF), LinkState.BUS_OFF),
        (_error(RESTARTED), LinkState.ACTIVE),
        (_error(0x204 | ERROR, _1=0x04, _6=0, _7=96), LinkState.WARNING),
        (_error(0x004 | ERROR, _1=0x40), LinkState.ACTIVE),
    ]
    for arrival, state in steps:
        bus.port.arriving.append(arrival)
        assert link.receive() == []
        assert link.state is state
    health = link.health
    assert (health["state"], health["tec"], health["rec"]) == ("active", "0", "96")
    assert (health["errors.controller"], health["errors.bus_off"], health["error_frames"]) == ("4", "1", "7")


def test_nothing_is_handed_to_a_controller_that_is_bus_off(link: CanLink, bus: Bus) -> None:
    bus.port.arriving.append(_error(BUS_OFF))
    link.receive()
    assert not link.send(Frame(1, b""))
    assert (bus.port.sent, link.counters.send_dropped, link.counters.sent) == ([], 1, 0)

    bus.port.arriving.append(_error(RESTARTED))
    link.receive()
    assert link.send(Frame(1, b""))


@pytest.mark.parametrize(
    ("later", "state"), [([], LinkState.BUS_OFF), ([(1, b"", 0)], LinkState.ACTIVE)], ids=["none", "one"]
)
def test_frame_received_after_bus_off_ends_it(link: CanLink, bus: Bus, later: list[Arrival], state: LinkState) -> None:
    bus.port.arriving += [(1, b"", 0), _error(BUS_OFF), *later]
    link.receive()
    assert link.state is state


def test_a_lost_bus_comes_back_by_itself(link: CanLink, bus: Bus) -> None:
    lose(link, bus)
    assert link.state is LinkState.GONE
    assert link.health["lost"] == "Network is down"
    bus.gate.clear()
    for _ in range(3):
        with pytest.raises(LinkLostError, match=r"^CAN bus fake bus is gone: Network is down$"):
            link.receive()
        assert not link.send(Frame(1, b""))
    assert (link.counters.send_dropped, link.counters.reopened) == (3, 0)
    bus.gate.set()
    until(lambda: is_back(link))

    assert (link.state, link.counters.reopened, len(bus.ports)) == (LinkState.ACTIVE, 1, 2)
    assert [port.closed for port in bus.ports] == [1, 0], "the lost one was closed, and before the next was opened"
    assert "lost" not in link.health
    assert link.send(Frame(1, b""))
    bus.port.arriving.append((2, b"", 0))
    assert len(link.receive()) == 1


def test_a_bus_found_lost_on_sending_is_lost(link: CanLink, bus: Bus) -> None:
    """The kernel tells it once, to whoever asks first."""
    bus.port.refusing = GONE
    assert not link.send(Frame(1, b""))
    assert (link.state, link.counters.send_dropped) == (LinkState.GONE, 1)
    with pytest.raises(LinkLostError, match="gone"):
        link.receive()
    until(lambda: is_back(link))


def test_a_bus_that_stays_away_is_tried_again_at_its_distance(link: CanLink, bus: Bus) -> None:
    lose(link, bus)
    bus.failure = BusNotFoundError("it is down; set it up")
    until(lambda: not is_back(link) and link.health.get("reopening") == "it is down; set it up")
    for _ in range(5):
        assert not is_back(link)
    assert bus.attempts == 2
    bus.now_ns += 100_000_000
    until(lambda: not is_back(link) and bus.attempts == 3)
    bus.failure = None
    bus.now_ns += 100_000_000

    def returns() -> bool:
        bus.now_ns += 100_000_000
        return is_back(link)

    until(returns)
    assert link.counters.reopened == 1
    assert "reopening" not in link.health


def test_reopening_discards_error_state_and_keeps_counts(link: CanLink, bus: Bus) -> None:
    bus.port.arriving.append(_error(BUS_OFF | 0x200, _6=255))
    link.receive()
    lose(link, bus)
    until(lambda: is_back(link))
    assert link.state is LinkState.ACTIVE
    assert "tec" not in link.health
    assert link.health["errors.bus_off"] == "1"


def test_a_bus_that_only_fails_is_gone_in_the_end(link: CanLink, bus: Bus) -> None:
    for _ in range(9):
        bus.port.arriving.append(HICCUP)
        assert link.receive() == []
    bus.port.arriving.append(HICCUP)
    with pytest.raises(LinkLostError, match="fake bus is gone: odd"):
        link.receive()
    assert link.counters.undecodable == 9


@pytest.mark.parametrize("good", [[], [(1, b"", 0)]], ids=["an empty drain", "a frame before the failure"])
def test_a_bus_that_works_in_between_is_not_gone(link: CanLink, bus: Bus, good: list[Arrival]) -> None:
    for number in range(40):
        if number % 8 == 7 and not good:
            link.receive()
        bus.port.arriving += [*(good if number % 8 == 7 else []), HICCUP]
        link.receive()
    assert link.counters.undecodable == 40


def test_frames_that_waited_while_it_was_opened_again_are_no_older_than_that(link: CanLink, bus: Bus) -> None:
    lose(link, bus)
    bus.now_ns += S
    with pytest.raises(LinkLostError):
        link.receive()
    until(lambda: len(bus.ports) == 2)
    bus.port.arriving.append((1, b"", 0))
    bus.now_ns += S
    received: list[Frame] = []

    def arrives() -> bool:
        try:
            received.extend(link.receive())
        except LinkLostError:
            return False
        return bool(received)

    until(arrives)
    assert received[0].received_ns == 6 * S


def test_a_link_closed_while_it_is_opened_again_leaves_nothing_open(link: CanLink, bus: Bus) -> None:
    lose(link, bus)
    bus.gate.clear()
    with pytest.raises(LinkLostError):
        link.receive()
    until(lambda: bus.attempts == 2)
    link.close()
    bus.gate.set()
    until(lambda: [port.closed for port in bus.ports] == [1, 1])
    with pytest.raises(LinkLostError, match=r"^CAN bus fake bus is not open$"):
        link.receive()
    assert (link.state, link.counters.reopened) == (LinkState.GONE, 0)


def test_a_lost_link_that_is_closed_closes_what_it_lost(link: CanLink, bus: Bus) -> None:
    lose(link, bus)
    link.close()
    assert (bus.ports[0].closed, bus.attempts) == (1, 1)


def test_a_link_may_be_opened_again(link: CanLink, bus: Bus) -> None:
    link.open()
    assert [port.closed for port in bus.ports] == [1, 0]
    link.close()
    link.open()
    assert [port.closed for port in bus.ports] == [1, 1, 0]
    assert link.counters.reopened == 0, "that counts what came back by itself"


def test_health_is_text_with_rates_since_the_last_look(link: CanLink, bus: Bus) -> None:
    bus.now_ns += 2 * S
    for _ in range(10):
        link.send(Frame(1, bytes(8)))
    health = link.health
    assert (health["sent_per_s"], health["sent"], health["load_percent"]) == ("5.0", "10", "0.1")
    assert all(isinstance(value, str) for value in health.values())
    assert "interface" not in health, "it is no network interface"
    assert link.description == "fake bus"


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> dict[str, InterfaceState]:
    known: dict[str, InterfaceState] = {}
    monkeypatch.setattr(can_interfaces, "read_interface_state", lambda name: known.get(name, UNKNOWN))
    return known


def _kernel_link(bus: Bus) -> CanLink:
    return CanLink(CanBus("can0", 500_000, "can0"), bus.open, lambda: bus.now_ns, lambda: bus.now_ns)


def test_a_bus_that_is_off_already_when_it_is_opened_is_known_to_be(
    bus: Bus, kernel: dict[str, InterfaceState]
) -> None:
    kernel["can0"] = InterfaceState("can", True, LinkState.BUS_OFF, 250_000, 100, 248, 1)  # noqa: FBT003 - in order
    link = _kernel_link(bus)
    link.open()
    assert link.state is LinkState.BUS_OFF
    assert not link.send(Frame(1, b""))
    bus.now_ns += S
    bus.port.arriving.append((2, bytes(8), 0))
    link.receive()
    health = link.health
    assert (health["tec"], health["interface"]) == ("248", "bus-off, 250000 bit/s, restarted 100 ms after bus-off")
    assert health["load_percent"] == "0.1", "135 of 250,000 bits"


def test_kernel_state_replaces_missing_error_frames(bus: Bus, kernel: dict[str, InterfaceState]) -> None:
    kernel["can0"] = InterfaceState("vcan", is_up=True)
    link = _kernel_link(bus)
    link.open()
    bus.port.arriving.append(_error(0x204 | ERROR, _1=0x10, _6=1, _7=130))
    link.receive()
    for _ in range(20):
        assert link.health["state"] == "passive", "an interface that tells nothing changes nothing"
        time.sleep(0.001)
    kernel["can0"] = InterfaceState("can", True, LinkState.BUS_OFF, 500_000, 0, 249, 130)  # noqa: FBT003 - in order
    until(lambda: link.health["state"] == "bus-off")
    assert (link.health["tec"], link.health["rec"]) == ("249", "130")


@pytest.mark.parametrize(("held_up", "age_ns"), [(0, 0), (1, 0), (2, 0), (9, 2_000_000)])
def test_being_held_up_between_two_clocks_makes_no_frame_older(bus: Bus, held_up: int, age_ns: int) -> None:
    """Held up for 2 ms after each of the first readings of the loop's clock; the wall clock is an hour ahead of it."""
    readings = 0

    def now_ns() -> int:
        return bus.now_ns

    def wall_ns() -> int:
        nonlocal readings
        readings += 1
        if 1 < readings <= held_up + 1:
            bus.now_ns += 2_000_000
        return bus.now_ns + 3600 * S

    link = CanLink(CanBus("fake bus", 500_000, None), bus.open, now_ns, wall_ns)
    link.open()
    link.receive()
    bus.now_ns += S
    bus.port.arriving.append((1, b"", bus.now_ns + 3600 * S))
    arrived_ns = bus.now_ns
    (frame,) = link.receive()
    assert arrived_ns - frame.received_ns == age_ns
    link.close()
