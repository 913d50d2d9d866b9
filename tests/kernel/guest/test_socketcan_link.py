# SPDX-License-Identifier: MIT
"""Links over raw sockets and through python-can on the kernel's own CAN: vcan0, and vcan1, which goes and returns."""

import contextlib
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.can_interfaces import read_interface_state
from segway_ecc.firmware_io.links.can_ports import SocketCanPort, make_can_link, make_python_can_link
from segway_ecc.firmware_io.links.link import Frame, Link, LinkState

BITRATE = 500_000
PATIENCE_S = 60.0
CAN_FRAME = struct.Struct("=IB3x8s")
EXTENDED, REMOTE, ERROR = 0x80000000, 0x40000000, 0x20000000

Make = Callable[[str], Link]


def over_raw_socket(channel: str) -> Link:
    return make_can_link("socketcan", channel, BITRATE)


def over_python_can(channel: str) -> Link:
    return make_python_can_link("socketcan", channel, BITRATE)


BOTH = pytest.mark.parametrize("make", [over_raw_socket, over_python_can])


def ip_link(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)  # noqa: S607 - the guest's PATH is ours


@contextlib.contextmanager
def opened(link: Link) -> Iterator[Link]:
    link.open()
    try:
        yield link
    finally:
        link.close()


@contextlib.contextmanager
def raw_socket(channel: str) -> Iterator[socket.socket]:
    """Another program on the bus."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sock:
        sock.bind((channel,))
        sock.settimeout(PATIENCE_S)
        yield sock


def wire(word: int, data: bytes = b"", length: int | None = None) -> bytes:
    return CAN_FRAME.pack(word, len(data) if length is None else length, data)


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, "it did not come to pass"
        time.sleep(0.001)


def is_back(link: Link) -> bool:
    try:
        link.receive()
    except LinkLostError:
        return False
    return True


def is_lost(link: Link) -> bool:
    return not is_back(link)


def heard(link: Link) -> list[bytes]:
    """The data of what arrives next; the kernel may hand a frame on a moment after it was sent."""
    frames: list[Frame] = []

    def arrived() -> bool:
        frames.extend(link.receive())
        return bool(frames)

    until(arrived)
    return [frame.data for frame in frames]


@pytest.fixture
def vcan1() -> Iterator[None]:
    """vcan1 as it was, whatever a test did to it."""
    yield
    subprocess.run(["ip", "link", "add", "vcan1", "type", "vcan"], check=False, capture_output=True)  # noqa: S607
    ip_link("set", "vcan1", "up")


def test_the_kernels_can_goes_over_a_raw_socket() -> None:
    link = make_can_link("auto", "auto", BITRATE)
    link.open()
    assert isinstance(link._port, SocketCanPort)
    link.close()
    assert link.description == "socketcan vcan0 (chosen by 'auto auto')"


@BOTH
def test_frames_are_sent_as_linux_has_them(make: Make) -> None:
    frames = {
        Frame(0x123, b"\x01\x02"): wire(0x123, b"\x01\x02"),
        Frame(0x7FF, bytes(range(8))): wire(0x7FF, bytes(range(8))),
        Frame(0x1ABCDEF0, b"", is_extended=True): wire(0x1ABCDEF0 | EXTENDED),
        Frame(0x049, b"", is_remote=True): wire(0x049 | REMOTE, length=8),
        Frame(0x049, b"1234", is_remote=True): wire(0x049 | REMOTE, length=4),
        Frame(0x1, b"", is_extended=True, is_remote=True): wire(0x1 | EXTENDED | REMOTE, length=8),
    }
    with opened(make("vcan0")) as link, raw_socket("vcan0") as witness:
        for frame, expected in frames.items():
            assert link.send(frame)
            received = bytearray(witness.recv(16))
            received[7] = 0  # the length that python-can puts beside the length
            assert received == expected


@BOTH
def test_frames_of_every_length_and_kind_are_received_with_the_kernels_stamps(make: Make) -> None:
    data = [bytes(range(length)) for length in range(9)]
    with opened(make("vcan0")) as link, raw_socket("vcan0") as peer:
        before_ns = time.monotonic_ns()
        for piece in data:
            for word in (0x7E0, 0x7E0 | EXTENDED, 0x7E0 | REMOTE):
                peer.send(wire(word, piece))
        after_ns = time.monotonic_ns()
        time.sleep(0.05)
        frames = link.receive()
    expected = [Frame(0x7E0, piece, 0, is_extended) for piece in data for is_extended in (False, True)]
    assert [replace(frame, received_ns=0) for frame in frames] == expected
    stamps = [frame.received_ns for frame in frames]
    # Within the sending: that is when they arrived, and not when they were taken.
    assert stamps == sorted(stamps)
    assert before_ns - 1_000_000 <= stamps[0] <= stamps[-1] <= after_ns + 1_000_000
    assert (link.counters.received, link.counters.remote_frames) == (18, 9)


@BOTH
def test_own_frames_do_not_come_back_and_those_of_others_with_our_identifiers_do(make: Make) -> None:
    with opened(make("vcan0")) as link, raw_socket("vcan0") as peer:
        link.send(Frame(0x100, b"1"))
        link.send(Frame(0x101, b"", is_remote=True))
        peer.send(wire(0x200, b"end of the first part"[:8]))
        assert [frame.arbitration_id for frame in link.receive()] == [0x200]
        for word in (0x100, 0x101, 0x100 | EXTENDED):
            peer.send(wire(word, b"1"))
        assert [(frame.arbitration_id, frame.is_extended) for frame in link.receive()] == [
            (0x100, False),
            (0x101, False),
            (0x100, True),
        ]
        assert link.counters.echoes == 0


@BOTH
def test_four_thousand_frames_in_bursts_arrive_in_order(make: Make) -> None:
    received: list[int] = []
    with opened(make("vcan0")) as link, raw_socket("vcan0") as peer:
        for burst in range(40):
            for number in range(burst * 100, burst * 100 + 100):
                peer.send(wire(0x300, number.to_bytes(4, "little")))
            received += [int.from_bytes(frame.data, "little") for frame in link.receive()]
        received += [int.from_bytes(frame.data, "little") for frame in link.receive()]
    assert received == list(range(4000))
    assert link.counters.overflows == 0
    assert link.counters.bits == 4000 * (55 + 40)


def test_a_receive_queue_of_a_mebibyte_takes_a_thousand_frames() -> None:
    with opened(over_raw_socket("vcan0")) as link, raw_socket("vcan0") as peer:
        for _ in range(1000):
            peer.send(wire(0x300, bytes(8)))
        assert [len(link.receive()) for _ in range(3)] == [512, 488, 0]


def test_what_does_not_fit_is_counted() -> None:
    total = 6000
    with opened(over_raw_socket("vcan0")) as link, raw_socket("vcan0") as peer:
        for _ in range(total):
            peer.send(wire(0x300, bytes(8)))
        kept = 0
        while frames := link.receive():
            kept += len(frames)
        # The kernel tells of the loss with the next frame that it could keep.
        peer.send(wire(0x301))
        assert [frame.arbitration_id for frame in link.receive()] == [0x301]
        assert 0 < kept < total
        assert link.counters.overflows == total - kept
        assert link.health["overflows"] == str(total - kept)


@BOTH
@pytest.mark.parametrize(
    ("word", "data", "state"),
    [
        (0x040, bytes(8), LinkState.BUS_OFF),
        (0x204, bytes((0, 0x20, 0, 0, 0, 0, 130, 5)), LinkState.PASSIVE),
        (0x204, bytes((0, 0x04, 0, 0, 0, 0, 5, 97)), LinkState.WARNING),
    ],
)
def test_error_frames_are_no_data_and_make_the_state(make: Make, word: int, data: bytes, state: LinkState) -> None:
    with opened(make("vcan0")) as link, raw_socket("vcan0") as peer, raw_socket("vcan0") as witness:
        peer.send(wire(word | ERROR, data))
        assert link.receive() == []
        assert (link.state, link.counters.error_frames) == (state, 1)
        assert link.send(Frame(0x111, b"")) == (state is not LinkState.BUS_OFF)
        peer.send(wire(0x100 | ERROR, bytes(8)))
        assert link.receive() == []
        assert link.state is LinkState.ACTIVE
        assert link.send(Frame(0x112, b""))
        sent = [0x112] if state is LinkState.BUS_OFF else [0x111, 0x112]
        heard = [CAN_FRAME.unpack(witness.recv(16))[0] for _ in sent]
        assert heard == sent


@BOTH
@pytest.mark.usefixtures("vcan1")
def test_an_interface_that_is_set_down_and_up_again_comes_back(make: Make) -> None:
    with opened(make("vcan1")) as link:
        ip_link("set", "vcan1", "down")
        for _ in range(3):
            with pytest.raises(LinkLostError, match=r"^CAN bus socketcan vcan1 is gone: .*Network is down"):
                link.receive()
        assert link.state is LinkState.GONE
        assert not link.send(Frame(0x100, b""))
        until(lambda: is_lost(link) and "vcan1 is down; set it up" in link.health.get("reopening", ""))

        ip_link("set", "vcan1", "up")
        until(lambda: is_back(link))
        with raw_socket("vcan1") as peer:
            peer.send(wire(0x200, b"back"))
            assert heard(link) == [b"back"]
            assert link.send(Frame(0x100, b"too"))
            assert peer.recv(16)[8:11] == b"too"
    assert (link.counters.reopened, link.counters.send_dropped, link.counters.overflows) == (1, 1, 0)


@BOTH
@pytest.mark.usefixtures("vcan1")
def test_an_interface_that_is_set_down_is_noticed_on_sending(make: Make) -> None:
    with opened(make("vcan1")) as link:
        ip_link("set", "vcan1", "down")
        assert not link.send(Frame(0x100, b""))
        assert link.state is LinkState.GONE
        with pytest.raises(LinkLostError):
            link.receive()


@BOTH
@pytest.mark.usefixtures("vcan1")
def test_an_interface_that_is_pulled_and_put_back_comes_back(make: Make) -> None:
    with opened(make("vcan1")) as link:
        for round_number in (1, 2):
            ip_link("delete", "vcan1")
            until(lambda: is_lost(link) and "no CAN interface is called 'vcan1'" in link.health.get("reopening", ""))
            ip_link("add", "vcan1", "type", "vcan")
            ip_link("set", "vcan1", "up")
            until(lambda: is_back(link))
            assert link.counters.reopened == round_number
        with raw_socket("vcan1") as peer:
            peer.send(wire(0x200, b"back"))
            assert heard(link) == [b"back"]


@BOTH
@pytest.mark.usefixtures("vcan1")
def test_a_link_that_is_closed_while_it_is_lost_leaves_no_socket_behind(make: Make) -> None:
    def sockets() -> int:
        lines = subprocess.run(["cat", "/proc/net/can/rcvlist_all"], check=True, capture_output=True, text=True)  # noqa: S607
        return lines.stdout.count("raw")

    before = sockets()
    link = make("vcan1")
    link.open()
    assert sockets() == before + 1
    ip_link("set", "vcan1", "down")
    assert is_lost(link)
    ip_link("set", "vcan1", "up")
    is_back(link)  # begins to open it again
    link.close()
    until(lambda: sockets() == before)
    time.sleep(0.2)
    assert sockets() == before


def test_what_the_kernel_knows_of_a_virtual_interface_is_its_kind() -> None:
    state = read_interface_state("vcan0")
    assert (state.kind, state.is_up, state.state, state.bitrate) == ("vcan", True, None, None)
    with opened(over_raw_socket("vcan0")) as link:
        assert link.health["interface"] == "vcan: no controller that reports"
        assert link.health["state"] == "active"


def test_frames_of_can_fd_pass_between_the_ways_and_not_to_who_takes_classic_ones() -> None:
    sent = Frame(0x8001, bytes(range(48)), is_extended=True, is_fd=True)
    raw = make_can_link("socketcan", "vcan0", BITRATE, fd_bitrate=5_000_000)
    through = make_python_can_link("socketcan", "vcan0", BITRATE, fd_bitrate=5_000_000)
    with opened(raw), opened(through), opened(over_raw_socket("vcan0")) as classic:
        for link, other in ((raw, through), (through, raw)):
            assert link.send(sent)
            assert link.send(Frame(0x123, b"classic"))
            found: list[Frame] = []
            until(lambda link=other, found=found: found.extend(link.receive()) or len(found) == 2)  # type: ignore[misc]
            assert [replace(frame, received_ns=0) for frame in found] == [sent, Frame(0x123, b"classic")]
        assert heard(classic)[0] == b"classic"
        assert not classic.send(sent), "the kernel takes no such frame from a socket for classic ones"
