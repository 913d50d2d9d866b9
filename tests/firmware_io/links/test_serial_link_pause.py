# SPDX-License-Identifier: MIT
"""Packets on a line whose other end needs a pause after each."""

from collections import Counter

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import PacketPause, SerialLink
from segway_ecc.firmware_io.links.settings import PortSettings

US = 1_000


class PlainLine:
    """Frames as they are."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()

    def encode(self, frame: Frame) -> bytes | None:
        return frame.data

    def request(self) -> bytes:
        return b""

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        return [Frame(1, data, now_ns)] if data else []

    def reset(self) -> None: ...


class Bench:
    """A line at 100,000 bit/s: a byte takes 100 us, and the pause is that of two."""

    in_waiting = 0

    def __init__(self) -> None:
        self.time_ns = 0
        self.written: list[tuple[int, bytes]] = []
        pause = PacketPause(2, self.sleep_until_ns)
        settings = PortSettings(port="test", baudrate=100_000)
        self.link = SerialLink(settings, PlainLine(), lambda: self.time_ns, lambda _: self, pause)
        self.link.open()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.time_ns = max(self.time_ns, deadline_ns)

    def read(self, _size: int, /) -> bytes:
        return b""

    def write(self, data: bytes, /) -> int:
        self.written.append((self.time_ns // US, data))
        return len(data)

    def close(self) -> None: ...

    def send(self, data: bytes, at_us: int) -> None:
        self.time_ns = at_us * US
        assert self.link.send(Frame(1, data))


def test_a_packet_that_comes_before_the_pause_is_over_waits_for_the_next_which_replaces_it() -> None:
    bench = Bench()
    bench.send(b"12345678", 0)
    bench.send(b"early", 999)
    bench.send(b"12345678", 1_000)
    bench.send(b"12345678", 2_000)
    assert bench.written == [(0, b"12345678"), (1_000, b"12345678"), (2_000, b"12345678")]
    assert bench.link.health["held_back"] == "1"


def test_the_last_packet_goes_out_a_few_times_when_the_line_is_closed() -> None:
    """With the pause between each two: nothing follows that would make up for one that is lost."""
    bench = Bench()
    bench.send(b"12345678", 0)
    bench.send(b"torque", 200)
    bench.send(b"zero", 300)
    bench.link.close()
    assert bench.written == [(0, b"12345678"), (1_000, b"zero"), (1_600, b"zero"), (2_200, b"zero")]
    bench.link.close()
    assert len(bench.written) == 4


def test_what_was_held_back_for_a_line_that_is_opened_again_is_not_sent() -> None:
    bench = Bench()
    bench.send(b"12345678", 0)
    bench.send(b"torque", 200)
    bench.link.open()
    written = len(bench.written)
    bench.link.close()
    assert len(bench.written) == written
