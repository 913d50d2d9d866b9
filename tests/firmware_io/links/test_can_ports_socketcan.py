# SPDX-License-Identifier: MIT
import errno
import os
import socket
import struct
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links import can_interfaces
from segway_ecc.firmware_io.links.can_interfaces import UNKNOWN
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.link import Frame, LinkState

S = 1_000_000_000
WALL_NS = 1_700_000_000 * S
START_NS = 5 * S
TIMESTAMPNS, RXQ_OVFL, RCVBUFFORCE = 35, 40, 33
SOL_CAN_RAW, ERR_FILTER, RECV_OWN = 101, 2, 4
Received = tuple[bytes, list[tuple[int, int, bytes]], int, Any]


class FakeSocket:
    """The kernel's side of a raw CAN socket."""

    def __init__(self) -> None:
        self.options: dict[tuple[int, int], int] = {}
        self.arriving: deque[Received | OSError] = deque()
        self.sent: list[bytes] = []
        self.refusing: dict[str, OSError] = {}
        self.bound: object = None
        self.is_blocking = True
        self.closed = 0
        self.readable = os.eventfd(1)

    def setblocking(self, flag: bool) -> None:  # noqa: FBT001 - the standard library's signature
        self.is_blocking = flag

    def setsockopt(self, level: int, option: int, value: int) -> None:
        if option == RCVBUFFORCE and "force" in self.refusing:
            raise self.refusing["force"]
        self.options[level, option] = value

    def bind(self, address: object) -> None:
        if "bind" in self.refusing:
            raise self.refusing["bind"]
        self.bound = address

    def send(self, data: bytes) -> int:
        if "send" in self.refusing:
            raise self.refusing["send"]
        self.sent.append(data)
        return len(data)

    def recvmsg(self, size: int, ancillary: int) -> Received:
        assert (size, ancillary >= socket.CMSG_SPACE(16) + socket.CMSG_SPACE(4)) == (16, True)
        if not self.arriving:
            raise BlockingIOError
        arriving = self.arriving.popleft()
        if isinstance(arriving, OSError):
            raise arriving
        return arriving

    def fileno(self) -> int:
        return self.readable

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def sock(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeSocket]:
    fake = FakeSocket()
    (tmp_path / "can0").mkdir()
    (tmp_path / "can0" / "type").write_text("280\n")
    (tmp_path / "can0" / "flags").write_text("0x40081\n")
    monkeypatch.setattr(can_interfaces, "NETWORK_DEVICES", tmp_path)
    monkeypatch.setattr(can_interfaces, "read_interface_state", lambda _: UNKNOWN)
    monkeypatch.setattr(socket, "socket", lambda *_: fake)
    yield fake
    os.close(fake.readable)


@pytest.fixture
def link(sock: FakeSocket) -> CanLink:
    link = make_can_link("socketcan", "can0", 500_000, lambda: START_NS + 10_000_000, lambda: WALL_NS)
    link._now_ns = lambda: START_NS
    link.open()
    link._now_ns = lambda: START_NS + 10_000_000
    assert sock.bound == ("can0",)
    return link


def _arrival(word: int, data: bytes = b"", stamp_ns: int | None = None, drops: int | None = None) -> Received:
    ancillary = []
    if stamp_ns is not None:
        ancillary.append((1, TIMESTAMPNS, struct.pack("@ll", stamp_ns // S, stamp_ns % S)))
    if drops is not None:
        ancillary.append((1, RXQ_OVFL, drops.to_bytes(4, "little")))
    frame = word.to_bytes(4, "little") + bytes((len(data), 0, 0, 0)) + data.ljust(8, b"\xaa")
    return frame, ancillary, 0, ("can0",)


@pytest.mark.usefixtures("link")
def test_the_socket_is_set_up_for_a_loop(sock: FakeSocket) -> None:
    assert not sock.is_blocking
    assert sock.options == {
        (1, RCVBUFFORCE): 1 << 20,
        (1, TIMESTAMPNS): 1,
        (1, RXQ_OVFL): 1,
        (SOL_CAN_RAW, ERR_FILTER): 0x1FFFFFFF,
        (SOL_CAN_RAW, RECV_OWN): 0,
    }


def test_without_the_right_to_a_large_buffer_it_takes_what_it_gets(sock: FakeSocket) -> None:
    sock.refusing["force"] = PermissionError(errno.EPERM, "")
    make_can_link("socketcan", "can0", 500_000).open()
    assert sock.options[1, socket.SO_RCVBUF] == 1 << 20


def test_socket_that_cannot_be_bound_is_closed_and_reported_in_one_line(sock: FakeSocket) -> None:
    sock.refusing["bind"] = OSError(errno.ENODEV, "No such device")
    with pytest.raises(BusNotFoundError) as error:
        make_can_link("socketcan", "can0", 500_000).open()
    assert str(error.value) == (
        "cannot open CAN bus socketcan can0: [Errno 19] No such device; check interface and channel"
    )
    assert sock.closed == 1


# linux/can.h: identifier with flags in the machine's byte order, length, three bytes of padding, data.
@pytest.mark.parametrize(
    ("frame", "expected"),
    [
        (Frame(0x123, b"\x01\x02"), "2301000002000000 0102000000000000"),
        (Frame(0x7FF, bytes(range(8))), "ff07000008000000 0001020304050607"),
        (Frame(0x1ABCDEF0, b"", is_extended=True), "f0debc9a00000000 0000000000000000"),
        (Frame(0x123, b"", is_remote=True), "2301004008000000 0000000000000000"),
        (Frame(0x123, b"\x01\x02", is_remote=True), "2301004002000000 0000000000000000"),
        (Frame(1, b"", is_extended=True, is_remote=True), "010000c008000000 0000000000000000"),
    ],
)
def test_a_frame_is_sent_as_the_kernel_wants_it(link: CanLink, sock: FakeSocket, frame: Frame, expected: str) -> None:
    assert link.send(frame)
    assert sock.sent == [bytes.fromhex(expected)]


def test_frames_are_read_with_the_kernels_stamps(link: CanLink, sock: FakeSocket) -> None:
    sock.arriving += [
        _arrival(0x123, b"\x01\x02", WALL_NS - 7_000_001),
        _arrival(0x80000123, b"12345678", WALL_NS - 3),
        _arrival(0x123),
        _arrival(0x123, stamp_ns=WALL_NS + 60 * S),
    ]
    now_ns = START_NS + 10_000_000
    assert link.receive() == [
        Frame(0x123, b"\x01\x02", now_ns - 7_000_001),
        Frame(0x123, b"12345678", now_ns - 3, is_extended=True),
        Frame(0x123, b"", START_NS),
        Frame(0x123, b"", now_ns),
    ]


def test_error_frames_make_the_state(link: CanLink, sock: FakeSocket) -> None:
    sock.arriving.append(_arrival(0x20000040, bytes(8)))
    assert link.receive() == []
    assert link.state is LinkState.BUS_OFF


def test_what_the_receive_queue_lost_is_counted(link: CanLink, sock: FakeSocket) -> None:
    sock.arriving += [_arrival(1, stamp_ns=0), _arrival(1, stamp_ns=0, drops=5), _arrival(1, stamp_ns=0, drops=5)]
    link.receive()
    assert link.counters.overflows == 5
    sock.arriving += [_arrival(1, drops=0xFFFFFFFF), _arrival(1, drops=2)]
    link.receive()
    assert link.counters.overflows == 5 + (0xFFFFFFFF - 5) + 3


def test_a_flooded_bus_is_taken_in_bounded_portions(link: CanLink, sock: FakeSocket) -> None:
    sock.arriving += [_arrival(number, stamp_ns=0) for number in range(1200)]
    portions = [[frame.arbitration_id for frame in link.receive()] for _ in range(4)]
    assert [len(portion) for portion in portions] == [512, 512, 176, 0]
    assert sum(portions, []) == list(range(1200))  # noqa: RUF017 - three short lists


def test_a_frame_of_another_size_is_counted_and_passed_over(link: CanLink, sock: FakeSocket) -> None:
    sock.arriving += [(b"short", [], 0, ()), _arrival(7)]
    assert [frame.arbitration_id for frame in link.receive()] == [7]
    assert link.counters.undecodable == 1


@pytest.mark.parametrize("code", [errno.ENOBUFS, errno.EAGAIN, errno.EINVAL])
def test_a_frame_that_finds_no_room_is_dropped(link: CanLink, sock: FakeSocket, code: int) -> None:
    sock.refusing["send"] = OSError(code, "no")
    assert not link.send(Frame(1, b""))
    assert (link.counters.send_dropped, link.state) == (1, LinkState.ACTIVE)


@pytest.mark.parametrize("code", [errno.ENETDOWN, errno.ENODEV, errno.ENXIO, errno.EBADF])
@pytest.mark.parametrize("way", ["send", "receive"])
def test_a_gone_interface_is_a_lost_link(link: CanLink, sock: FakeSocket, way: str, code: int) -> None:
    error = OSError(code, "it is away")
    if way == "send":
        sock.refusing["send"] = error
        assert not link.send(Frame(1, b""))
    else:
        sock.arriving.append(error)
    with pytest.raises(LinkLostError, match=r"^CAN bus socketcan can0 is gone: it is away$"):
        link.receive()
    assert link.state is LinkState.GONE
    link.close()
    assert sock.closed >= 1


def test_any_other_failure_to_receive_is_counted(link: CanLink, sock: FakeSocket) -> None:
    sock.arriving += [_arrival(1), OSError(errno.EIO, "odd"), _arrival(2)]
    assert [frame.arbitration_id for frame in (*link.receive(), *link.receive())] == [1, 2]
    assert link.counters.undecodable == 1
