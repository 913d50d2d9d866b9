# SPDX-License-Identifier: MIT
import errno
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

import can
import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links import can_ports
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.can_ports import make_python_can_link
from segway_ecc.firmware_io.links.link import Frame, LinkState
from tests.patience import PATIENCE_S

S = 1_000_000_000
START_NS = 5 * S
WALL_NS = 1_700_000_000 * S
MICROSECOND = 1_000


class FakeBus:
    """What python-can hands out, with everything that arrives or fails prepared."""

    def __init__(self) -> None:
        self.arriving: deque[can.Message | Exception] = deque()
        self.refusing: Exception | None = None
        self.sent: list[can.Message] = []
        self.timeouts: set[float | None] = set()
        self.closed = 0
        self.refusing_to_close: Exception | None = None

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self.timeouts.add(timeout)
        if not self.arriving:
            return None
        arriving = self.arriving.popleft()
        if isinstance(arriving, Exception):
            raise arriving
        return arriving

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.timeouts.add(timeout)
        if self.refusing is not None:
            raise self.refusing
        self.sent.append(msg)

    def shutdown(self) -> None:
        self.closed += 1
        if self.refusing_to_close is not None:
            raise self.refusing_to_close


class Clocks:
    """Both clocks of the loop, moved by hand."""

    def __init__(self) -> None:
        self.now_ns, self.wall_ns = START_NS, WALL_NS

    def pass_s(self, seconds: float) -> None:
        self.now_ns += round(seconds * S)
        self.wall_ns += round(seconds * S)


@pytest.fixture
def clocks() -> Clocks:
    return Clocks()


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> FakeBus:
    fake = FakeBus()
    monkeypatch.setattr(can, "Bus", lambda **_: fake)
    return fake


@pytest.fixture
def link(bus: FakeBus, clocks: Clocks) -> CanLink:
    link = make_python_can_link("fake", "here", 500_000, lambda: clocks.now_ns, lambda: clocks.wall_ns)
    link.open()
    assert bus.closed == 0
    return link


def _message(stamp_ns: int, identifier: int = 1, **kind: Any) -> can.Message:
    return can.Message(timestamp=stamp_ns / S, arbitration_id=identifier, is_extended_id=False, **kind)


def _kinds(message: can.Message) -> tuple[int, bytes, int, bool, bool]:
    data = bytes(message.data)
    return message.arbitration_id, data, message.dlc, message.is_extended_id, message.is_remote_frame


def _stamps(link: CanLink) -> list[int]:
    return [frame.received_ns for frame in link.receive()]


def _receive(link: CanLink, count: int) -> list[Frame]:
    """Receive as many frames; the operating system carries those of the local bus in its own time."""
    frames: list[Frame] = []
    deadline = time.monotonic() + PATIENCE_S
    while len(frames) < count and time.monotonic() < deadline:
        frames += link.receive()
    return frames


@pytest.fixture(params=["virtual", "local"])
def pair(request: pytest.FixtureRequest, channel: str) -> Iterator[tuple[CanLink, can.BusABC]]:
    link = make_python_can_link(request.param, channel, 500_000)
    link.open()
    with can.Bus(interface=request.param, channel=channel) as peer:
        yield link, peer
    link.close()


def test_frames_cross_a_real_backend_both_ways(pair: tuple[CanLink, can.BusABC]) -> None:
    link, peer = pair
    assert link.send(Frame(0x110, b"12345678"))
    assert link.send(Frame(0x1ABCDEF0, b"", is_extended=True))
    arrived = [peer.recv(PATIENCE_S) for _ in range(2)]
    assert [m and (m.arbitration_id, bytes(m.data), m.is_extended_id) for m in arrived] == [
        (0x110, b"12345678", False),
        (0x1ABCDEF0, b"", True),
    ]

    peer.send(can.Message(arbitration_id=0x120, data=b"abc", is_extended_id=False))
    peer.send(can.Message(arbitration_id=0x20, is_extended_id=False, is_error_frame=True))
    peer.send(can.Message(arbitration_id=0x121, is_extended_id=False, is_remote_frame=True))
    peer.send(can.Message(arbitration_id=0x120, data=b"", is_extended_id=True))
    frames = _receive(link, 2)
    assert [replace(frame, received_ns=0) for frame in frames] == [
        Frame(0x120, b"abc"),
        Frame(0x120, b"", is_extended=True),
    ]
    assert link.receive() == []
    counters = link.counters
    assert (counters.sent, counters.received, counters.error_frames, counters.remote_frames) == (2, 2, 1, 1)


def test_error_frame_is_never_data_whatever_its_other_flags(link: CanLink, bus: FakeBus) -> None:
    bus.arriving.append(_message(WALL_NS, 0x120, is_error_frame=True, is_remote_frame=True))
    assert link.receive() == []
    assert (link.counters.error_frames, link.counters.remote_frames, link.counters.received) == (1, 0, 0)


def test_the_kernels_stamp_is_moved_to_the_loops_clock(link: CanLink, bus: FakeBus, clocks: Clocks) -> None:
    clocks.pass_s(0.01)
    bus.arriving += [_message(WALL_NS + 2_000_000), _message(WALL_NS + 9_000_000)]
    assert _stamps(link) == pytest.approx([START_NS + 2_000_000, START_NS + 9_000_000], abs=MICROSECOND)


@pytest.mark.parametrize(("step_s", "bound_s"), [(3600.0, 0.01), (-3600.0, 0.02)], ids=["forwards", "backwards"])
def test_a_stepped_wall_clock_makes_no_frame_older_than_the_last_drain_or_newer_than_now(
    link: CanLink, bus: FakeBus, clocks: Clocks, step_s: float, bound_s: float
) -> None:
    clocks.pass_s(0.01)
    link.receive()
    clocks.pass_s(0.01)
    bus.arriving.append(_message(clocks.wall_ns - 5_000_000))
    clocks.wall_ns += round(step_s * S)
    assert _stamps(link) == [START_NS + round(bound_s * S)]


@pytest.mark.parametrize(("stamp_ns", "bound_s"), [(0, 0.01), (77 * S, 0.01), (2 * WALL_NS, 0.02)])
def test_a_backend_with_a_clock_of_its_own_is_kept_within_the_same_bounds(
    link: CanLink, bus: FakeBus, clocks: Clocks, stamp_ns: int, bound_s: float
) -> None:
    clocks.pass_s(0.01)
    link.receive()
    clocks.pass_s(0.01)
    bus.arriving.append(_message(stamp_ns))
    assert _stamps(link) == [START_NS + round(bound_s * S)]


def test_nothing_is_older_than_the_opening(link: CanLink, bus: FakeBus, clocks: Clocks) -> None:
    clocks.pass_s(0.01)
    bus.arriving.append(_message(WALL_NS - 60 * S))
    assert _stamps(link) == [START_NS]


def test_a_flooded_bus_is_taken_in_bounded_portions_in_order(link: CanLink, bus: FakeBus) -> None:
    bus.arriving += [_message(WALL_NS, number) for number in range(1200)]
    portions = [[frame.arbitration_id for frame in link.receive()] for _ in range(4)]
    assert [len(portion) for portion in portions] == [512, 512, 176, 0]
    assert [identifier for portion in portions for identifier in portion] == list(range(1200))


def test_neither_way_waits(link: CanLink, bus: FakeBus) -> None:
    link.send(Frame(1, b""))
    link.receive()
    assert bus.timeouts == {0}, "python-can takes no time-out for as long as it takes"


def test_a_full_queue_drops_the_frame_at_once(channel: str) -> None:
    link = make_python_can_link("virtual", channel, 500_000)
    link.open()
    with can.Bus(interface="virtual", channel=channel, rx_queue_size=1):
        assert link.send(Frame(1, b""))
        assert not link.send(Frame(2, b""))
        link.close()
    assert (link.counters.sent, link.counters.send_dropped) == (1, 1)


@pytest.mark.parametrize("failure", [can.CanOperationError("full"), can.CanTimeoutError(), OSError(errno.ENOBUFS, "")])
def test_a_failure_to_send_is_counted_and_not_raised(link: CanLink, bus: FakeBus, failure: Exception) -> None:
    bus.refusing = failure
    assert not link.send(Frame(1, b""))
    bus.refusing = None
    assert link.send(Frame(1, b""))
    assert (link.counters.sent, link.counters.send_dropped) == (1, 1)


@pytest.mark.parametrize("code", [errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF])
@pytest.mark.parametrize("kind", [can.CanOperationError, OSError])
def test_a_gone_interface_is_a_lost_link(link: CanLink, bus: FakeBus, kind: type[Exception], code: int) -> None:
    bus.arriving.append(OSError(code, "gone") if kind is OSError else can.CanOperationError("gone", code))
    with pytest.raises(LinkLostError, match=r"^CAN bus fake here is gone: .*gone"):
        link.receive()


def test_a_bus_that_is_closed_under_a_link_is_a_lost_link(channel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    link = make_python_can_link("local", channel, 500_000)
    with can.Bus(interface="local", channel=channel) as bus:
        monkeypatch.setattr(can, "Bus", lambda **_: bus)
        link.open()
    with pytest.raises(LinkLostError, match="is gone"):
        link.receive()
    link.close()


@pytest.mark.parametrize("hiccup", [can.CanOperationError("odd"), OSError(errno.EIO, "odd"), IndexError("t12")])
def test_any_other_failure_to_receive_is_counted_and_what_arrived_is_kept(
    link: CanLink, bus: FakeBus, hiccup: Exception
) -> None:
    bus.arriving += [_message(WALL_NS, 1), hiccup, _message(WALL_NS, 2)]
    assert [frame.arbitration_id for frame in (*link.receive(), *link.receive())] == [1, 2]
    assert (link.counters.received, link.counters.undecodable) == (2, 1)


def test_a_closed_link_counts_what_is_sent_and_cannot_be_received_from(link: CanLink, bus: FakeBus) -> None:
    link.close()
    link.close()
    assert bus.closed == 1
    assert not link.send(Frame(1, b""))
    assert link.counters.send_dropped == 1
    with pytest.raises(LinkLostError, match="CAN bus fake here is not open"):
        link.receive()


@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        (Frame(0x123, b"12"), (0x123, b"12", 2, False, False)),
        (Frame(0x123, b"", is_remote=True), (0x123, b"", 8, False, True)),
        (Frame(0x123, b"1234", is_remote=True), (0x123, b"", 4, False, True)),
        (Frame(0x1ABCDEF0, b"", is_extended=True, is_remote=True), (0x1ABCDEF0, b"", 8, True, True)),
    ],
)
def test_a_frame_is_handed_to_python_can_as_it_is(
    link: CanLink, bus: FakeBus, frame: Frame, expected: tuple[object, ...]
) -> None:
    assert link.send(frame)
    assert [_kinds(message) for message in bus.sent] == [expected]


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=0x800, is_extended_id=False, data=b"1", check=False),
        can.Message(arbitration_id=0x20000000, is_extended_id=True, data=b"1", check=False),
        can.Message(arbitration_id=-1, is_extended_id=False, data=b"1", check=False),
        can.Message(arbitration_id=1, is_extended_id=False, data=b"12", dlc=8, check=False),
        can.Message(arbitration_id=1, is_extended_id=False, data=bytes(12), is_fd=True),
        can.Message(arbitration_id=1, is_extended_id=False, dlc=9, is_remote_frame=True, check=False),
    ],
    ids=["standard id", "extended id", "negative id", "cut short", "too long", "remote and too long"],
)
def test_what_is_no_classic_frame_is_counted_and_what_follows_is_taken(
    link: CanLink, bus: FakeBus, message: can.Message
) -> None:
    bus.arriving += [message, _message(WALL_NS, 0x7FF, data=b"good")]
    assert [(f.arbitration_id, f.data) for f in link.receive()] == [(0x7FF, b"good")]
    assert (link.counters.undecodable, link.counters.received) == (1, 1)


@pytest.mark.parametrize("seconds", [float("nan"), float("inf")])
def test_a_stamp_that_is_no_time_is_counted_like_any_other_failure(link: CanLink, bus: FakeBus, seconds: float) -> None:
    bus.arriving.append(can.Message(timestamp=seconds, arbitration_id=1, data=b"1", is_extended_id=False))
    assert link.receive() == []
    assert link.counters.undecodable == 1


BUS_OFF = can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True, is_extended_id=False)


@pytest.mark.parametrize(
    ("interface", "state"),
    [("local", LinkState.BUS_OFF), ("gs_usb", LinkState.BUS_OFF), ("pcan", LinkState.ACTIVE), ("x", LinkState.ACTIVE)],
)
def test_only_error_frames_of_the_kernels_kind_are_understood(
    monkeypatch: pytest.MonkeyPatch, interface: str, state: LinkState
) -> None:
    bus = FakeBus()
    monkeypatch.setattr(can, "Bus", lambda **_: bus)
    link = make_python_can_link(interface, "here", 500_000)
    link.open()
    bus.arriving.append(BUS_OFF)
    assert link.receive() == []
    assert (link.state, link.counters.error_frames) == (state, 1)


@pytest.mark.parametrize("interface", ["virtual", "local"])
def test_a_frame_that_somebody_repeats_is_received(channel: str, interface: str) -> None:
    link = make_python_can_link(interface, channel, 500_000)
    link.open()
    with can.Bus(interface=interface, channel=channel) as mirror:
        link.send(Frame(0x110, b"12"))
        message = mirror.recv(PATIENCE_S)
        assert message is not None
        mirror.send(message)
        assert [(f.arbitration_id, f.data) for f in _receive(link, 1)] == [(0x110, b"12")]
    assert (link.counters.echoes, link.counters.received) == (0, 1)
    link.close()


@pytest.mark.parametrize(("interface", "is_ours"), [("gs_usb", True), ("socketcan", False)])
def test_a_frame_that_the_backend_marks_as_sent_is_ours(
    monkeypatch: pytest.MonkeyPatch, interface: str, *, is_ours: bool
) -> None:
    """Of SocketCAN, python-can marks what any program of this machine sent; our own does not come back there."""
    bus = FakeBus()
    monkeypatch.setattr(can, "Bus", lambda **_: bus)
    monkeypatch.setattr(can_ports, "check_socketcan", lambda *_: None)
    link = make_python_can_link(interface, "here", 500_000)
    link.open()
    bus.arriving.append(can.Message(arbitration_id=0x110, data=b"1", is_extended_id=False, is_rx=False))

    assert len(link.receive()) == (0 if is_ours else 1)
    assert link.counters.echoes == (1 if is_ours else 0)


def test_a_bus_that_does_not_shut_down_cleanly_is_closed_all_the_same(link: CanLink, bus: FakeBus) -> None:
    bus.refusing_to_close = can.CanOperationError("the adapter is not there")
    link.close()
    assert link.state is LinkState.GONE
