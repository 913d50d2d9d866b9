# SPDX-License-Identifier: MIT
"""The kernel's serial-line CAN on a pseudo-terminal: what a frame is on the line, byte for byte, both ways."""

import contextlib
import fcntl
import json
import os
import pty
import struct
import subprocess
import termios
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.can_interfaces import read_interface_state
from segway_ecc.firmware_io.links.can_link import CanLink
from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.link import Frame, LinkState

N_SLCAN = 17
SIOCGIFNAME = 0x8910
PATIENCE_S = 60.0
BITRATE = 500_000
DATA = bytes.fromhex("00 7F 80 FF 0D 07 41 5A")
"""With the bytes that end an answer of the adapter, which in hexadecimal are nothing special."""

# The Lawicel protocol's words: t and T for data, r and R for remote frames, 3 or 8 digits, the length, the data.
# The kernel writes identifiers in capitals and data too.
FRAMES = [
    *((Frame(0x123, DATA[:length]), f"t123{length}{DATA[:length].hex().upper()}\r".encode()) for length in range(9)),
    *(
        (
            Frame(0x1ABCDEF0, DATA[:length], is_extended=True),
            f"T1ABCDEF0{length}{DATA[:length].hex().upper()}\r".encode(),
        )
        for length in range(9)
    ),
    (Frame(0x000, b""), b"t0000\r"),
    (Frame(0x7FF, b""), b"t7FF0\r"),
    (Frame(0x7FF, b"", is_extended=True), b"T000007FF0\r"),
    (Frame(0x1FFFFFFF, b"\x01", is_extended=True), b"T1FFFFFFF101\r"),
]
REMOTE = [
    *((Frame(0x049, bytes(length), is_remote=True), f"r049{length}\r".encode()) for length in range(1, 9)),
    (Frame(0x049, b"", is_remote=True), b"r0498\r"),
    (Frame(0x1ABCDEF0, b"", is_extended=True, is_remote=True), b"R1ABCDEF08\r"),
    (Frame(0x1ABCDEF0, b"123", is_extended=True, is_remote=True), b"R1ABCDEF03\r"),
]


@dataclass
class Adapter:
    """The far end of the serial line, and the network interface that the kernel made of the near one."""

    line: int
    interface: str
    heard: bytearray

    def hear(self) -> int:
        """Take what is on the line; how much has been heard so far."""
        with contextlib.suppress(BlockingIOError):
            self.heard += os.read(self.line, 4096)
        return len(self.heard)

    def expect(self, words: bytes) -> None:
        until(lambda: self.hear() >= len(words))
        assert bytes(self.heard) == words
        self.heard.clear()

    def say(self, words: bytes) -> None:
        assert os.write(self.line, words) == len(words)

    def ip_link(self, *words: str) -> None:
        """Set the interface; the kernel waits until the adapter has heard what that takes."""
        with subprocess.Popen(["ip", "link", "set", self.interface, *words]) as process:  # noqa: S607 - our PATH
            until(lambda: self.hear() >= 0 and process.poll() is not None)
        assert process.returncode == 0


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s, "it did not come to pass"
        time.sleep(0.001)


def receive(link: CanLink, count: int) -> list[Frame]:
    frames: list[Frame] = []

    def are_there() -> bool:
        frames.extend(link.receive())
        return len(frames) >= count

    until(are_there)
    return [replace(frame, received_ns=0) for frame in frames]


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    far, near = pty.openpty()
    try:
        tty.setraw(far)
        tty.setraw(near)
        os.set_blocking(far, False)
        fcntl.ioctl(near, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        name = fcntl.ioctl(near, SIOCGIFNAME, bytes(64)).split(b"\0")[0].decode()
        yield Adapter(far, name, bytearray())
    finally:
        os.close(far)
        os.close(near)


@pytest.fixture
def link(adapter: Adapter) -> Iterator[CanLink]:
    adapter.ip_link("type", "can", "bitrate", str(BITRATE))
    adapter.ip_link("up")
    # Close what may be open, 500 kbit/s, open.
    adapter.expect(b"C\rS6\rO\r")
    link = make_can_link("socketcan", adapter.interface, BITRATE)
    link.open()
    yield link
    link.close()


def test_what_is_sent_is_on_the_line_byte_for_byte(adapter: Adapter, link: CanLink) -> None:
    for frame, words in FRAMES + REMOTE:
        assert link.send(frame)
        adapter.expect(words)
    assert link.counters.sent == len(FRAMES) + len(REMOTE)


def test_what_is_on_the_line_is_received(adapter: Adapter, link: CanLink) -> None:
    for frame, words in FRAMES:
        adapter.say(words)
        assert receive(link, 1) == [frame]
    for _, words in REMOTE:
        adapter.say(words.lower() if words[:1] == b"r" else words)
    until(lambda: link.receive() == [] and link.counters.remote_frames == len(REMOTE))
    assert link.counters.received == len(FRAMES)


def test_frames_that_come_in_pieces_or_many_at_once_are_received(adapter: Adapter, link: CanLink) -> None:
    stream = b"".join(words for _, words in FRAMES)
    adapter.say(stream)
    assert receive(link, len(FRAMES)) == [frame for frame, _ in FRAMES]
    for start in range(0, len(stream), 7):
        adapter.say(stream[start : start + 7])
    assert receive(link, len(FRAMES)) == [frame for frame, _ in FRAMES]


def test_after_garbage_the_next_frame_is_received(adapter: Adapter, link: CanLink) -> None:
    for garbage in (b"\r", b"\x07", b"t12\r", b"t1239\r", b"tXYZ0\r", b"t12320\r", b"z\r", b"\xff\xfe\r"):
        adapter.say(garbage + b"t7770\r")
        assert [frame.arbitration_id for frame in receive(link, 1)] == [0x777]
    assert link.receive() == []


def test_what_the_adapter_tells_of_the_bus_makes_the_state(adapter: Adapter, link: CanLink) -> None:
    # State reports of the kernel's driver: s, the state, receive and transmit error counters in three digits each.
    for words, state in (
        (b"sw096001\r", LinkState.WARNING),
        (b"sp001130\r", LinkState.PASSIVE),
        (b"sb000250\r", LinkState.BUS_OFF),
    ):
        adapter.say(words)
        until(lambda state=state: link.receive() == [] and link.state is state)  # type: ignore[misc]
    assert not link.send(Frame(0x100, b""))
    adapter.say(b"sa000000\r")
    until(lambda: link.receive() == [] and link.state is LinkState.ACTIVE)
    assert link.send(Frame(0x100, b""))
    adapter.expect(b"t1000\r")
    assert link.counters.send_dropped == 1


def test_the_error_counters_are_those_that_the_adapter_told(adapter: Adapter, link: CanLink) -> None:
    adapter.say(b"sw097012\r")
    until(lambda: link.receive() == [] and link.state is LinkState.WARNING)
    assert (link.health["rec"], link.health["tec"]) == ("97", "12")


def test_a_bus_that_is_off_already_is_known_when_it_is_opened(adapter: Adapter, link: CanLink) -> None:
    adapter.say(b"sb000250\r")
    until(lambda: link.receive() == [] and link.state is LinkState.BUS_OFF)
    late = make_can_link("socketcan", adapter.interface, BITRATE)
    late.open()
    assert late.state is LinkState.BUS_OFF
    assert late.health["interface"] == "bus-off, 500000 bit/s, not restarted after bus-off"
    late.close()


@pytest.mark.usefixtures("link")
def test_what_we_read_over_netlink_is_what_ip_says(adapter: Adapter) -> None:
    command = ["ip", "-json", "-details", "link", "show", adapter.interface]
    (said,) = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    info = said["linkinfo"]
    state = read_interface_state(adapter.interface)
    assert (state.kind, state.is_up) == (info["info_kind"], "UP" in said["flags"])
    assert (info["info_data"]["state"], state.state) == ("ERROR-ACTIVE", LinkState.ACTIVE)
    assert state.bitrate == info["info_data"]["bittiming_bitrate"]
    assert state.restart_ms == info["info_data"]["restart_ms"]


def test_an_adapter_that_is_pulled_is_a_lost_link(adapter: Adapter, link: CanLink) -> None:
    adapter.ip_link("down")
    with pytest.raises(LinkLostError, match=f"^CAN bus socketcan {adapter.interface} is gone: Network is down$"):
        link.receive()
    assert link.state is LinkState.GONE
    adapter.expect(b"C\r")
    adapter.ip_link("up")

    def is_back() -> bool:
        with contextlib.suppress(LinkLostError):
            link.receive()
            return True
        return False

    until(is_back)
    adapter.expect(b"C\rS6\rO\r")
    adapter.say(b"t7770\r")
    assert [frame.arbitration_id for frame in receive(link, 1)] == [0x777]
    assert link.counters.reopened == 1
