# SPDX-License-Identifier: MIT
"""A port that is written to beside another program: on a real terminal of the kernel, and with a port of our own."""

import contextlib
import os
import termios
import time
import tty
from collections import Counter
from collections.abc import Callable, Iterator

import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links.link import Frame, LinkState
from segway_ecc.firmware_io.links.serial_link import SerialLink, open_serial_port
from segway_ecc.firmware_io.links.serial_writer import SerialWriter, TerminalPort
from segway_ecc.firmware_io.links.settings import PortSettings
from tests.patience import PATIENCE_S

MS = 1_000_000


class PlainLine:
    """Frames as they are."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()

    def encode(self, frame: Frame) -> bytes | None:
        return None if frame.is_extended else frame.data

    def request(self) -> bytes:
        return b""

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        return [Frame(1, data, now_ns)] if data else []

    def reset(self) -> None: ...


class Clock:
    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def terminal() -> Iterator[tuple[int, PortSettings]]:
    """The other end of a pseudo-terminal, and the port."""
    ours, theirs = os.openpty()
    os.set_blocking(ours, False)
    yield ours, PortSettings(port=os.ttyname(theirs))
    for each in (ours, theirs):
        os.close(each)


def collect(read: Callable[[], bytes], count: int) -> bytes:
    """What arrives, at least so many bytes: the kernel hands them on in its own time, and in pieces."""
    received, until_s = b"", time.monotonic() + PATIENCE_S
    while len(received) < count and time.monotonic() < until_s:
        with contextlib.suppress(BlockingIOError):
            received += read()
    return received


def test_it_writes_beside_a_program_that_has_the_port_and_takes_nothing_from_it(
    terminal: tuple[int, PortSettings],
) -> None:
    ours, settings = terminal
    node = SerialLink(settings, PlainLine(), Clock(), open_serial_port)
    guard = SerialWriter(settings, PlainLine(), Clock())
    guard.open()
    node.open()
    try:
        os.write(ours, b"feedback\r\n")
        assert guard.receive() == []
        assert collect(lambda: b"".join(frame.data for frame in node.receive()), 10) == b"feedback\r\n"
        assert node.send(Frame(1, b"node\r\n"))
        assert guard.send(Frame(1, b"guard\r\n"))
        assert collect(lambda: os.read(ours, 100), 13) == b"node\r\nguard\r\n"
        assert (guard.counters.sent, guard.counters.bits, guard.state) == (1, 70, LinkState.ACTIVE)
        assert guard.health["sent"] == "1"
    finally:
        node.close()
        guard.close()
    assert guard.state is LinkState.GONE


def test_alone_it_makes_the_port_raw_at_its_rate(terminal: tuple[int, PortSettings]) -> None:
    ours, settings = terminal
    guard = SerialWriter(settings, PlainLine(), Clock())
    guard.open()
    try:
        guard.send(Frame(1, b"\n\x04\xff"))
        assert collect(lambda: os.read(ours, 100), 3) == b"\n\x04\xff"
        modes = termios.tcgetattr(ours)
        assert modes[4:6] == [termios.B115200] * 2
        assert not modes[3] & (termios.ECHO | termios.ICANON)
    finally:
        guard.close()


def test_what_another_program_has_set_is_left_alone(terminal: tuple[int, PortSettings]) -> None:
    ours, settings = terminal
    tty.setraw(ours)
    modes = termios.tcgetattr(ours)
    modes[4:6] = [termios.B115200] * 2
    modes[2] |= termios.HUPCL
    termios.tcsetattr(ours, termios.TCSANOW, modes)
    port = TerminalPort(settings)
    assert termios.tcgetattr(ours)[2] & termios.HUPCL
    port.close()
    port.close()


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (PortSettings(port="/dev/nothing-here"), "No such file"),
        (PortSettings(port="socket://127.0.0.1:1"), "only a port of this machine"),
        (PortSettings(port="/dev/null"), "ioctl"),
        (PortSettings(port="/dev/tty0", baudrate=123_456), "at one of its rates"),
    ],
)
def test_a_port_that_cannot_be_written_to_is_named(settings: PortSettings, text: str) -> None:
    with pytest.raises(BusNotFoundError, match=settings.port) as caught:
        SerialWriter(settings, PlainLine(), Clock()).open()
    assert text in str(caught.value)


class FakePort:
    """A port that can be pulled out."""

    def __init__(self) -> None:
        self.written = b""
        self.is_there = True
        self.is_closed = False

    def write(self, data: bytes, /) -> int:
        if not self.is_there:
            raise OSError(5, "gone")
        self.written += data
        return len(data)

    def close(self) -> None:
        self.is_closed = True


def test_a_port_that_was_pulled_out_is_lost_and_opened_again() -> None:
    clock, ports = Clock(), [FakePort(), FakePort()]
    opened = iter(ports)
    guard = SerialWriter(PortSettings(port="test"), PlainLine(), clock, lambda _: next(opened))
    guard.open()
    assert not guard.send(Frame(1, b"", is_extended=True)), "what the protocol cannot carry is not sent"
    ports[0].is_there = False
    assert not guard.send(Frame(1, b"zero"))
    assert guard.counters.send_dropped == 2
    with pytest.raises(LinkLostError, match="it was unplugged"):
        guard.receive()
    assert guard.state is LinkState.GONE
    assert not guard.send(Frame(1, b"zero"))
    for _ in range(1_000_000):
        clock.now_ns += 100 * MS
        try:
            assert guard.receive() == []
        except LinkLostError:
            continue
        break
    assert ports[0].is_closed
    assert guard.counters.reopened == 1
    assert guard.send(Frame(1, b"zero"))
    assert ports[1].written == b"zero"
    guard.close()
    assert ports[1].is_closed
