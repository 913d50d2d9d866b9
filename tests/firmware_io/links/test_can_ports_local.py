# SPDX-License-Identifier: MIT
import select
import socket
import time
from collections.abc import Iterator

import can
import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.can_ports import PORT, encode, make_can_link, multicast_group, multicast_socket
from segway_ecc.firmware_io.links.link import Frame, Link
from tests.patience import PATIENCE_S

INET_ATON = socket.inet_aton
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000


@pytest.fixture
def link(channel: str) -> Iterator[Link]:
    link = make_can_link("local", channel, 500_000)
    link.open()
    yield link
    link.close()


@pytest.fixture
def bus(channel: str) -> Iterator[can.BusABC]:
    """The same bus as python-can sees it."""
    with can.Bus(interface="local", channel=channel) as bus:
        yield bus


def send_raw(channel: str, datagram: bytes) -> None:
    group = multicast_group(channel)
    with multicast_socket(group) as sock:
        sock.sendto(datagram, (group, PORT))


def frames(link: Link) -> list[Frame]:
    """What arrives; the datagrams of one machine are there as soon as they were sent."""
    return [replace(frame, received_ns=0) for frame in link.receive()]


@pytest.mark.parametrize(
    "frame",
    [Frame(0x7FF, b""), Frame(0x123, bytes(range(8))), Frame(0x1FFFFFFF, b"x", is_extended=True)],
    ids=["empty", "full", "extended"],
)
def test_python_can_and_the_link_understand_each_other(link: Link, bus: can.BusABC, frame: Frame) -> None:
    assert link.send(frame)
    heard = bus.recv(PATIENCE_S)
    assert heard is not None
    assert (heard.arbitration_id, bytes(heard.data), heard.is_extended_id) == (
        frame.arbitration_id,
        frame.data,
        frame.is_extended,
    )
    bus.send(can.Message(arbitration_id=0x55, data=frame.data, is_extended_id=False))
    assert frames(link) == [Frame(0x55, frame.data)]
    assert link.counters.echoes == 0, "its own frames do not come back"


def test_a_remote_frame_asks_with_a_length_and_no_data(link: Link, bus: can.BusABC) -> None:
    assert link.send(Frame(0x10, b"", is_remote=True))
    heard = bus.recv(PATIENCE_S)
    assert heard is not None
    assert (heard.is_remote_frame, heard.dlc, bytes(heard.data)) == (True, 8, b"")
    bus.send(can.Message(arbitration_id=0x11, is_remote_frame=True, dlc=3, is_extended_id=False))
    assert frames(link) == []
    assert link.counters.remote_frames == 1


def test_frame_carries_its_send_time(link: Link, bus: can.BusABC) -> None:
    link.receive()
    before_ns = time.monotonic_ns()
    bus.send(can.Message(arbitration_id=1, is_extended_id=False))
    after_ns = time.monotonic_ns()
    time.sleep(0.05)
    (frame,) = link.receive()
    # Two clocks are read one after the other on either side; one of them may be slewed in between.
    assert before_ns - 5_000_000 <= frame.received_ns <= after_ns + 5_000_000


@pytest.mark.parametrize(
    "datagram",
    [b"", b"ECC1", encode(1, 1, 8, bytes(8))[:-1], encode(1, 1, 8, bytes(8)) + b"x", b"ECC2" + bytes(29)],
    ids=["empty", "short", "a byte less", "a byte more", "another mark"],
)
def test_what_is_no_frame_is_counted(link: Link, channel: str, datagram: bytes) -> None:
    send_raw(channel, datagram)
    assert frames(link) == []
    assert link.counters.undecodable == 1


@pytest.mark.parametrize(("word", "length"), [(0x800, 0), (0x800 | REMOTE, 0), (1, 9), (1, 255)])
def test_no_identifier_and_no_length_beyond_what_can_has(link: Link, channel: str, word: int, length: int) -> None:
    send_raw(channel, encode(1, word, length, bytes(8)))
    assert frames(link) == []
    assert link.counters.undecodable == 1


def test_error_frames_are_understood(link: Link, channel: str) -> None:
    bus_off = 0x40
    send_raw(channel, encode(1, ERROR | bus_off, 8, bytes(8)))
    assert frames(link) == []
    assert (link.counters.error_frames, link.state) == (1, "bus-off")


def test_other_channels_are_other_buses(link: Link, channel: str) -> None:
    other = make_can_link("local", f"{channel} other", 500_000)
    other.open()
    other.send(Frame(1, b"x"))
    other.close()
    assert frames(link) == []


def test_a_flood_is_taken_in_pieces(link: Link, bus: can.BusABC) -> None:
    for number in range(600):
        bus.send(can.Message(arbitration_id=number, is_extended_id=False))
    assert [len(frames(link)) for _ in range(3)] == [512, 88, 0]


def test_error_of_a_bus_that_cannot_be_joined_names_the_remedy(channel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = socket.inet_aton("192.0.2.1")  # for documentation, on no machine's device
    monkeypatch.setattr(socket, "inet_aton", lambda text: elsewhere if text == "127.0.0.1" else INET_ATON(text))
    with pytest.raises(BusNotFoundError, match="bring the loopback device up: ip link set"):
        make_can_link("local", channel, 500_000).open()


def test_a_socket_that_is_closed_under_it_is_a_lost_bus(link: CanLink) -> None:
    port = link._port
    assert port is not None
    port.close()
    assert not link.send(Frame(1, b""))
    with pytest.raises(LinkLostError):
        link.receive()


def test_nothing_waits(link: Link) -> None:
    assert frames(link) == []
    assert link.send(Frame(1, b""))


def test_closed_bus_receives_nothing(link: CanLink, bus: can.BusABC) -> None:
    link.close()
    assert not link.send(Frame(1, b""))
    assert not select.select([bus.fileno()], [], [], 0)[0]
