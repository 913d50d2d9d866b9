# SPDX-License-Identifier: MIT
import errno
import importlib.metadata
import os
import select
import socket
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator

import can
import can.bus
import pytest

from segway_ecc.firmware_io.links.can_ports import PORT, multicast_group
from segway_ecc.firmware_io.links.local_bus import LocalBus
from tests.patience import PATIENCE_S

INET_ATON = socket.inet_aton
DATAGRAM = struct.Struct("<4sQQIBx8s")

ECHO = """
import sys
import can
with can.Bus(interface="local", channel=sys.argv[1]) as bus:
    print("joined", flush=True)
    while (message := bus.recv()).arbitration_id != 0:
        message.arbitration_id += 1
        bus.send(message)
"""


@pytest.fixture
def near(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface="local", channel=channel) as bus:
        yield bus


@pytest.fixture
def far(channel: str) -> Iterator[can.BusABC]:
    with can.Bus(interface="local", channel=channel) as bus:
        yield bus


@pytest.fixture
def stranger() -> Iterator[socket.socket]:
    """A program that sends to the bus whatever it likes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        yield sock


def _message(identifier: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


def _receive(bus: can.BusABC) -> can.Message:
    message = bus.recv(PATIENCE_S)
    assert message is not None, "a frame that was sent did not arrive"
    return message


def _datagram(identifier: int, dlc: int, magic: bytes = b"ECC1", sender: int = 1) -> bytes:
    return DATAGRAM.pack(magic, sender, 0, identifier, dlc, bytes(8))


def test_python_can_finds_the_interface_by_its_entry_point(near: can.BusABC) -> None:
    (entry,) = importlib.metadata.entry_points(group="can.interface", name="local")
    assert entry.load() is LocalBus
    assert type(near) is LocalBus


def test_participants_receive_frames_in_order(near: can.BusABC, far: can.BusABC) -> None:
    for identifier in range(20):
        near.send(_message(identifier, bytes((identifier,))))
    arrived = [_receive(far) for _ in range(20)]
    assert [(m.arbitration_id, bytes(m.data)) for m in arrived] == [(n, bytes((n,))) for n in range(20)]

    far.send(_message(0x7FF))
    assert _receive(near).arbitration_id == 0x7FF


def test_own_frames_are_not_echoed(near: can.BusABC, far: can.BusABC) -> None:
    near.send(_message(1))
    near.send(_message(2))
    far.send(_message(3))
    assert _receive(near).arbitration_id == 3, "the first to arrive is the other's"
    assert near.recv(0) is None


def test_every_other_participant_receives_a_frame(near: can.BusABC, far: can.BusABC, channel: str) -> None:
    with can.Bus(interface="local", channel=channel) as third:
        near.send(_message(5))
        assert [_receive(bus).arbitration_id for bus in (far, third)] == [5, 5]


def test_channels_are_buses_of_their_own(near: can.BusABC, far: can.BusABC, channel: str) -> None:
    with can.Bus(interface="local", channel=f"{channel} next door") as elsewhere:
        elsewhere.send(_message(1))
        near.send(_message(2))
        assert _receive(far).arbitration_id == 2, "the first to arrive is its own channel's"
        assert elsewhere.recv(0) is None


@pytest.mark.parametrize(
    "sent",
    [
        can.Message(arbitration_id=0x7FF, data=b"12345678", is_extended_id=False),
        can.Message(arbitration_id=0x1FFFFFFF, data=b"x", is_extended_id=True),
        can.Message(arbitration_id=0x12, data=b"", is_extended_id=True),
        can.Message(arbitration_id=0x123, dlc=5, is_remote_frame=True, is_extended_id=False),
        can.Message(arbitration_id=0x20, data=bytes(8), dlc=8, is_error_frame=True, is_extended_id=False),
    ],
    ids=["standard", "extended", "extended with a short identifier", "remote", "error"],
)
def test_every_kind_of_frame_survives(near: can.BusABC, far: can.BusABC, sent: can.Message) -> None:
    near.send(sent)
    assert _receive(far).equals(sent, timestamp_delta=None, check_channel=False)


def test_a_frame_carries_the_wall_clock_of_its_sending(
    near: can.BusABC, far: can.BusABC, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as stopped:
        stopped.setattr(time, "clock_gettime_ns", lambda _: 1_234_567_890_500_000_000)
        near.send(_message(1))
    assert _receive(far).timestamp == pytest.approx(1_234_567_890.5, abs=1e-6)


def test_junk_is_counted_and_passed_over(
    near: LocalBus, far: can.BusABC, channel: str, stranger: socket.socket
) -> None:
    junk = [b"", b"junk", bytes(200), _datagram(1, 1)[:-1], _datagram(1, 1) + b"!", _datagram(1, 1, magic=b"ECC2")]
    for datagram in junk:
        stranger.sendto(datagram, (multicast_group(channel), PORT))
    far.send(_message(7))

    assert _receive(near).arbitration_id == 7
    assert near.undecodable == len(junk)


@pytest.mark.parametrize("dlc", [9, 15, 255])
def test_a_length_that_no_classic_frame_has_is_counted_and_passed_over(
    near: LocalBus, channel: str, stranger: socket.socket, dlc: int
) -> None:
    stranger.sendto(_datagram(1, dlc), (multicast_group(channel), PORT))
    stranger.sendto(_datagram(2, 8), (multicast_group(channel), PORT))

    message = _receive(near)
    assert (message.arbitration_id, message.dlc) == (2, 8)
    assert near.undecodable == 1


def test_filters_are_honoured(near: can.BusABC, far: can.BusABC) -> None:
    near.set_filters([{"can_id": 0x120, "can_mask": 0x7FF, "extended": False}])
    far.send(_message(0x121))
    far.send(_message(0x120))
    assert _receive(near).arbitration_id == 0x120


def test_receiving_without_time_does_not_wait(near: can.BusABC, monkeypatch: pytest.MonkeyPatch) -> None:
    def wait(*_: object) -> None:
        pytest.fail("waited")

    monkeypatch.setattr(select, "select", wait)
    near.send(_message(1))
    assert near.recv(0) is None


class _Datagrams:
    """A socket that holds certain datagrams, which a real one cannot be made to at a known moment."""

    def __init__(self, *datagrams: bytes) -> None:
        self._datagrams = deque(datagrams)

    def recv(self, _size: int) -> bytes:
        if not self._datagrams:
            raise BlockingIOError
        return self._datagrams.popleft()


def test_receiving_without_time_reads_past_own_frames_and_junk(near: LocalBus, monkeypatch: pytest.MonkeyPatch) -> None:
    own = _datagram(1, 8, sender=near._sender)
    waiting = _Datagrams(own, b"junk", own, _datagram(2, 8), own, _datagram(3, 8), b"junk", own)
    monkeypatch.setattr(near, "_socket", waiting)
    arrived = [near.recv(0) for _ in range(3)]
    monkeypatch.undo()
    assert [message and message.arbitration_id for message in arrived] == [2, 3, None]


def test_receiving_with_time_gives_up_in_the_end(near: can.BusABC) -> None:
    assert near.recv(0.01) is None


def test_own_frames_do_not_make_a_wait_longer(near: can.BusABC, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []

    def wait(_readers: object, _writers: object, _others: object, seconds: float) -> tuple[list[object], ...]:
        waits.append(seconds)
        near.send(_message(1))
        return [near], [], []

    # Each look at python-can's clock finds one second gone; every wait is ended by a frame of our own.
    seconds = iter(range(100))
    monkeypatch.setattr(can.bus, "time", lambda: float(next(seconds)))
    monkeypatch.setattr(select, "select", wait)

    assert near.recv(3.0) is None
    assert waits == [3.0, 2.0, 1.0]


def test_a_closed_bus_raises_python_cans_error(channel: str) -> None:
    bus = can.Bus(interface="local", channel=channel)
    bus.shutdown()
    bus.shutdown()

    with pytest.raises(can.CanOperationError, match="is closed") as receiving:
        bus.recv(0)
    with pytest.raises(
        can.CanOperationError, match=r"cannot send on virtual bus '.*' on this machine: Bad file descriptor"
    ) as sending:
        bus.send(_message(1))
    assert receiving.value.error_code == sending.value.error_code == errno.EBADF


def test_error_of_a_bus_that_cannot_be_joined_names_the_remedy(channel: str, monkeypatch: pytest.MonkeyPatch) -> None:
    elsewhere = socket.inet_aton("192.0.2.1")  # for documentation, on no machine's device
    monkeypatch.setattr(socket, "inet_aton", lambda text: elsewhere if text == "127.0.0.1" else INET_ATON(text))
    with pytest.raises(can.CanInitializationError, match="No such device; bring the loopback device up: ip link set"):
        can.Bus(interface="local", channel=channel)


def test_frames_cannot_leave_the_machine(near: can.BusABC, channel: str) -> None:
    with socket.socket(fileno=os.dup(near.fileno())) as sock:
        assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
        assert socket.inet_ntoa(sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)) == "127.0.0.1"
        assert sock.getsockname() == (multicast_group(channel), PORT)


@pytest.mark.parametrize("name", ["", "robot", "can0", "größe 5"])
def test_groups_are_of_the_range_for_local_use_and_their_own(name: str) -> None:
    group = multicast_group(name)
    assert group.startswith("239.255.")
    assert multicast_group(name) == group
    assert multicast_group(f"{name}2") != group


def test_two_processes_exchange_frames(near: can.BusABC, channel: str) -> None:
    with subprocess.Popen([sys.executable, "-c", ECHO, channel], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "joined\n"
        near.send(_message(0x10, b"there"))
        answer = _receive(near)
        near.send(_message(0))
    assert process.returncode == 0
    assert (answer.arbitration_id, bytes(answer.data), answer.is_extended_id) == (0x11, b"there", False)
