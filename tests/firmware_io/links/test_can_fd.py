# SPDX-License-Identifier: MIT
"""Frames of CAN FD: their lengths, their time on the wire, and the virtual bus between links and python-can."""

import socket
import struct
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links import can_interfaces
from segway_ecc.firmware_io.links.can_interfaces import UNKNOWN
from segway_ecc.firmware_io.links.can_link import EXTENDED, FD, Arrival, CanBus, CanLink
from segway_ecc.firmware_io.links.can_ports import decode, encode, make_can_link, make_python_can_link
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, fd_length, worst_case_bits, worst_case_fd_bits
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from tests.patience import PATIENCE_S

FAST = 5_000_000
COMMAND = Frame(0x8001, bytes(range(48)), is_extended=True, is_fd=True)
ANSWER = Frame(0x100, bytes(range(32)), is_fd=True)
CLASSIC = Frame(0x123, b"classic")


def received(link: Link) -> list[Frame]:
    return [replace(frame, received_ns=0) for frame in link.receive()]


@pytest.mark.parametrize(
    ("size", "length"),
    [(0, 0), (7, 7), (8, 8), (9, 12), (12, 12), (13, 16), (17, 20), (21, 24), (25, 32), (33, 48), (48, 48), (49, 64)],
)
def test_a_frame_is_as_long_as_the_next_length_that_there_is(size: int, length: int) -> None:
    assert fd_length(size) == length


def test_no_frame_has_room_for_65_bytes() -> None:
    with pytest.raises(ValueError, match="room for 64 bytes, not for 65"):
        fd_length(65)


@pytest.mark.parametrize(
    ("length", "is_extended", "bits"),
    [
        # head, its stuff bits and 13; 5 + 8 n with their stuff bits, stuff count and CRC with theirs
        (0, False, (17 + 4 + 13, 5 + 2 + 21 + 6)),
        (0, True, (36 + 8 + 13, 5 + 2 + 21 + 6)),
        (16, False, (34, 133 + 34 + 21 + 6)),
        (20, False, (34, 165 + 42 + 25 + 7)),
        (64, True, (57, 517 + 130 + 25 + 7)),
    ],
)
def test_the_bits_of_a_frame_by_its_fields(length: int, is_extended: bool, bits: tuple[int, int]) -> None:  # noqa: FBT001
    assert worst_case_fd_bits(length, is_extended=is_extended) == bits


def test_a_frame_of_can_fd_at_one_rate_takes_no_less_than_a_classic_one() -> None:
    for length in range(1, 9):
        assert sum(worst_case_fd_bits(length, is_extended=True)) > worst_case_bits(length, is_extended=True)


class FakePort:
    """A bus on which everything that arrives is prepared."""

    def __init__(self) -> None:
        self.arriving: deque[Arrival] = deque()
        self.sent: list[Frame] = []

    def send(self, frame: Frame) -> None:
        self.sent.append(frame)

    def drain(self) -> Iterator[Arrival]:
        while self.arriving:
            yield self.arriving.popleft()

    def close(self) -> None: ...


def test_a_link_counts_what_a_frame_takes_of_the_bus_at_its_bit_rate() -> None:
    port = FakePort()
    link = CanLink(CanBus("bus", 1_000_000, None, FAST), lambda _: port, lambda: 0, lambda: 0)
    link.open()
    assert link.send(COMMAND)
    slow, fast = worst_case_fd_bits(48, is_extended=True)
    assert link.counters.bits == slow + round(fast / 5)

    port.arriving += [(0x8001 | EXTENDED | FD, COMMAND.data, 0), (0x123, b"classic", 0)]
    assert received(link) == [COMMAND, CLASSIC]
    assert link.counters.bits == 2 * (slow + round(fast / 5)) + worst_case_bits(7, is_extended=False)


@pytest.fixture
def link(channel: str) -> Iterator[Link]:
    link = make_can_link("local", channel, 1_000_000, fd_bitrate=FAST)
    link.open()
    yield link
    link.close()


@pytest.mark.parametrize(
    "frame", [COMMAND, ANSWER, Frame(0x7FF, b"", is_fd=True), CLASSIC], ids=lambda f: f"{f.data!r:.9}"
)
def test_the_link_and_python_can_understand_each_other(link: Link, channel: str, frame: Frame) -> None:
    with can.Bus(interface="local", channel=channel, fd=True) as bus:
        assert link.send(frame)
        found = bus.recv(PATIENCE_S)
        assert found is not None
        assert (found.arbitration_id, bytes(found.data), found.is_fd) == (frame.arbitration_id, frame.data, frame.is_fd)
        assert found.bitrate_switch is frame.is_fd
        bus.send(found)
        assert received(link) == [frame]


def test_a_bus_whose_data_have_no_rate_of_their_own_switches_to_none(channel: str) -> None:
    link = make_can_link("local", channel, 1_000_000, fd_bitrate=1_000_000)
    link.open()
    with can.Bus(interface="local", channel=channel, fd=True) as bus:
        assert link.send(ANSWER)
        found = bus.recv(PATIENCE_S)
    link.close()
    assert found is not None
    assert (found.is_fd, found.bitrate_switch) == (True, False)


@pytest.mark.parametrize("make", [make_can_link, make_python_can_link])
def test_what_was_opened_for_classic_frames_takes_and_sends_no_others(link: Link, channel: str, make: Any) -> None:
    classic = make("local", channel, 1_000_000)
    classic.open()
    assert link.send(COMMAND)
    assert link.send(CLASSIC)
    assert received(classic) == [CLASSIC]
    assert not classic.send(ANSWER)
    assert classic.send(CLASSIC)
    assert received(link) == [CLASSIC]
    classic.close()


def test_python_can_s_bus_for_classic_frames_takes_and_sends_no_others(link: Link, channel: str) -> None:
    with can.Bus(interface="local", channel=channel) as bus:
        assert link.send(COMMAND)
        assert link.send(CLASSIC)
        found = bus.recv(PATIENCE_S)
        assert found is not None
        assert bytes(found.data) == CLASSIC.data
        with pytest.raises(can.CanOperationError, match="was opened for classic CAN frames only"):
            bus.send(can.Message(arbitration_id=1, is_fd=True, data=bytes(12)))


def test_a_link_through_python_can_carries_can_fd_too(link: Link, channel: str) -> None:
    other = make_python_can_link("local", channel, 1_000_000, fd_bitrate=FAST)
    other.open()
    assert link.send(COMMAND)
    assert link.send(CLASSIC)
    assert received(other) == [COMMAND, CLASSIC]
    assert other.send(ANSWER)
    assert received(link) == [ANSWER]
    other.close()


def test_a_length_that_no_frame_has_is_not_sent(link: Link) -> None:
    assert not link.send(replace(ANSWER, data=bytes(13)))
    assert link.counters.send_dropped == 1


def test_a_datagram_that_is_no_frame_is_none() -> None:
    whole = encode(7, 0x100 | FD, 12, bytes(12))
    assert decode(whole) is not None
    assert decode(b"X" + whole[1:]) is None
    assert decode(encode(7, 0x100 | FD, 13, bytes(13))) is None


class FakeSocket:
    """The kernel's side of a raw CAN socket."""

    def __init__(self) -> None:
        self.options: dict[tuple[int, int], int] = {}
        self.arriving: deque[bytes] = deque()
        self.sent: list[bytes] = []

    def setblocking(self, flag: bool) -> None: ...  # noqa: FBT001 - the standard library's signature

    def setsockopt(self, level: int, option: int, value: int) -> None:
        self.options[level, option] = value

    def bind(self, address: object) -> None: ...

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def recvmsg(self, size: int, _ancillary: int) -> tuple[bytes, list[Any], int, Any]:
        assert size == 72, "CANFD_MTU of linux/can.h"
        if not self.arriving:
            raise BlockingIOError
        return self.arriving.popleft(), [], 0, None

    def close(self) -> None: ...


@pytest.fixture
def sock(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeSocket:
    fake = FakeSocket()
    (tmp_path / "can0").mkdir()
    for name, text in (("type", "280"), ("flags", "0x40081"), ("mtu", "72")):
        (tmp_path / "can0" / name).write_text(f"{text}\n")
    monkeypatch.setattr(can_interfaces, "NETWORK_DEVICES", tmp_path)
    monkeypatch.setattr(can_interfaces, "read_interface_state", lambda _: UNKNOWN)
    monkeypatch.setattr(socket, "socket", lambda *_: fake)
    monkeypatch.setattr("segway_ecc.firmware_io.links.can_ports.readiness", lambda _: lambda: True)
    return fake


def test_a_raw_socket_sends_and_takes_frames_as_linux_has_them(sock: FakeSocket) -> None:
    link = make_can_link("socketcan", "can0", 1_000_000, fd_bitrate=FAST)
    link.open()
    assert sock.options[101, 5] == 1, "CAN_RAW_FD_FRAMES of linux/can/raw.h"
    assert link.send(COMMAND)
    assert link.send(CLASSIC)
    command = struct.pack("=IBB2x64s", 0x8001 | EXTENDED, 48, 1, COMMAND.data)
    classic = struct.pack("=IB3x8s", 0x123, 7, CLASSIC.data)
    assert sock.sent == [command, classic]

    sock.arriving += [command, classic]
    assert received(link) == [COMMAND, CLASSIC]


def test_an_interface_of_classic_can_is_refused_with_the_command_that_sets_it_up(
    sock: FakeSocket, tmp_path: Path
) -> None:
    (tmp_path / "can0" / "mtu").write_text("16\n")
    with pytest.raises(BusNotFoundError, match="carries classic frames only") as caught:
        make_can_link("socketcan", "can0", 1_000_000, fd_bitrate=FAST).open()
    assert "sudo ip link set can0 up type can bitrate 1000000 dbitrate 5000000 fd on" in str(caught.value)
    assert not sock.sent


@pytest.mark.parametrize(
    ("settings", "refusal"),
    [
        ({"data_bitrate": FAST}, "add fd: true"),
        ({"fd": True, "bitrate": 1_000_000, "data_bitrate": 500_000}, "must be 1000000 bit/s"),
    ],
)
def test_settings_that_no_bus_has_are_refused(settings: dict[str, Any], refusal: str) -> None:
    with pytest.raises(ValueError, match=refusal):
        CanSettings(**settings)


def test_the_rate_of_the_data_is_that_of_the_rest_where_it_is_not_given() -> None:
    assert CanSettings().fd_bitrate is None
    assert CanSettings(fd=True).fd_bitrate == 500_000
    assert CanSettings(fd=True, data_bitrate=2_000_000).fd_bitrate == 2_000_000


def test_the_simulated_bus_takes_the_time_of_both_rates() -> None:
    now_ns = 0
    bus = SimulatedBus(1_000_000, lambda: now_ns, FAST)
    sender, receiver = bus.attach("a"), bus.attach("b")
    assert sender.send(COMMAND)
    slow, fast = worst_case_fd_bits(48, is_extended=True)
    now_ns = slow * 1_000 + fast * 200
    assert receiver.receive() == [replace(COMMAND, received_ns=now_ns)]


def test_a_simulated_bus_of_classic_can_carries_no_can_fd() -> None:
    sender = SimulatedBus(1_000_000, lambda: 0).attach("a")
    assert not sender.send(ANSWER)
    assert (sender.counters.sent, sender.counters.send_dropped) == (0, 1)
    assert isinstance(sender.counters, LinkCounters)
