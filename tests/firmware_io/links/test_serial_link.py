# SPDX-License-Identifier: MIT
import threading
import time
from collections import Counter, deque
from collections.abc import Callable

import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link, LinkState
from segway_ecc.firmware_io.links.redundant_link import StandbyLink
from segway_ecc.firmware_io.links.serial_link import LOST, Port, SerialLink
from segway_ecc.firmware_io.links.settings import PortSettings, SerialSettings

MS = 1_000_000
SETTINGS = SerialSettings(port="/dev/test", baudrate=100_000)


class Clock:
    now_ns = 5_000 * MS

    def __call__(self) -> int:
        return self.now_ns


class EchoLine:
    """Frames as `<data>`, requests as `?`."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.asks = b"?"
        self._begun = b""

    def encode(self, frame: Frame) -> bytes | None:
        return None if frame.is_extended else b"<" + frame.data + b">"

    def request(self) -> bytes:
        return self.asks

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        *ended, self._begun = (self._begun + data).split(b">")
        frames = [Frame(1, words.removeprefix(b"<"), now_ns) for words in ended]
        self.refused["crc"] += sum(frame.data == b"bad" for frame in frames)
        self.refused[LOST] += sum(frame.data == b"late" for frame in frames)
        return [frame for frame in frames if frame.data not in (b"bad", b"late")]

    def reset(self) -> None:
        self._begun = b""


class FakePort:
    def __init__(self) -> None:
        self.arriving: deque[bytes] = deque()
        self.written = b""
        self.rooms: deque[int | None] = deque()
        self.out_waiting = 0
        self.error: OSError | None = None
        self.is_closed = False

    @property
    def in_waiting(self) -> int:
        return sum(map(len, self.arriving))

    def read(self, size: int, /) -> bytes:
        self._fail()
        if not self.arriving:
            return b""
        piece = self.arriving.popleft()
        if piece[size:]:
            self.arriving.appendleft(piece[size:])
        return piece[:size]

    def write(self, data: bytes, /) -> int | None:
        self._fail()
        room = self.rooms.popleft() if self.rooms else len(data)
        self.written += data[:room]
        return room if room is None else min(room, len(data))

    def close(self) -> None:
        self.is_closed = True

    def _fail(self) -> None:
        if self.error is not None:
            raise self.error

    def take(self) -> bytes:
        written, self.written = self.written, b""
        return written


class Opener:
    """Opens the ports that it is given, one after the other; waits where it is told to."""

    def __init__(self, *results: Port | OSError) -> None:
        self.results = deque(results)
        self.may_go = threading.Event()
        self.may_go.set()
        self.calls: list[tuple[PortSettings, int]] = []

    def __call__(self, settings: PortSettings) -> Port:
        self.calls.append((settings, threading.get_ident()))
        self.may_go.wait(30.0)
        result = self.results.popleft()
        if isinstance(result, OSError):
            raise result
        return result


def eventually(condition: Callable[[], object]) -> None:
    for _ in range(10_000):
        if condition():
            return
        time.sleep(0.001)
    pytest.fail("it did not happen")


@pytest.fixture
def clock() -> Clock:
    """A clock that stands until it is set."""
    return Clock()


@pytest.fixture
def port() -> FakePort:
    """The port that is opened first."""
    return FakePort()


@pytest.fixture
def line() -> EchoLine:
    """A line that is easy to read."""
    return EchoLine()


@pytest.fixture
def opener(port: FakePort) -> Opener:
    """Opens the port."""
    return Opener(port)


@pytest.fixture
def link(line: EchoLine, clock: Clock, opener: Opener) -> SerialLink:
    """A link that is open, on standby, and has not asked yet."""
    link = SerialLink(SETTINGS, line, clock, opener)
    link.open()
    return link


def test_it_is_a_link_that_can_stand_by(link: SerialLink, opener: Opener) -> None:
    one: Link = link
    other: StandbyLink = link
    assert one.description == other.description == "serial /dev/test at 100000 bit/s"
    assert link.state is LinkState.ACTIVE
    assert not link.is_active
    assert [settings for settings, _ in opener.calls] == [SETTINGS]


def test_frames_go_out_and_come_in(link: SerialLink, port: FakePort, clock: Clock) -> None:
    assert link.send(Frame(1, b"a"))
    assert port.take() == b"<a>"
    port.arriving += [b"<b><", b"c", b"", b">"]
    assert link.receive() == [Frame(1, b"b", clock.now_ns)]
    clock.now_ns += MS
    assert link.receive() == [Frame(1, b"c", clock.now_ns)]
    assert (link.counters.sent, link.counters.received) == (1, 2)
    assert link.counters.bits == 10 * len(b"<a>?<b><c>")


def test_in_standby_it_asks_ten_times_a_second(link: SerialLink, port: FakePort, clock: Clock) -> None:
    asked = []
    for millisecond in range(1000):
        link.receive()
        if port.take():
            asked.append(millisecond)
        clock.now_ns += MS
    assert asked == list(range(0, 1000, 100))
    assert link.health["requests"] == "10"


def test_as_the_owner_it_asks_once_in_every_cycle(link: SerialLink, port: FakePort, clock: Clock) -> None:
    link.receive()
    port.take()
    link.is_active = True
    for _ in range(20):
        clock.now_ns += MS
        link.receive()
        link.receive()
        assert port.take() == b"?"


def test_a_line_that_needs_no_asking_is_not_asked(link: SerialLink, line: EchoLine, port: FakePort) -> None:
    line.asks = b""
    link.receive()
    assert port.written == b""
    assert link.health["requests"] == "0"


def test_it_reads_before_it_asks(link: SerialLink, port: FakePort) -> None:
    port.arriving.append(b"<first>")
    port.rooms.append(0)
    assert link.receive()[0].data == b"first"


def test_frame_the_codec_cannot_carry_is_no_failure(link: SerialLink, port: FakePort) -> None:
    assert link.send(Frame(1, b"a", is_extended=True))
    assert port.written == b""
    assert link.health["not_carried"] == "1"
    assert (link.counters.sent, link.counters.send_dropped) == (0, 0)


def test_bytes_read_at_once_are_bounded(link: SerialLink, port: FakePort) -> None:
    port.arriving.append(b"<1234>" * 2000)
    assert len(link.receive()) == 4096 // 6
    assert port.in_waiting == 12_000 - 4096
    assert link.health["full_reads"] == "1"
    assert len(link.receive()) == 8192 // 6 - 4096 // 6
    assert len(link.receive()) == 2000 - 8192 // 6
    assert link.health["full_reads"] == "2"


@pytest.mark.parametrize(("baudrate", "most"), [(9_600, 64), (100_000, 100), (921_600, 922), (12_000_000, 1024)])
def test_behind_a_backlog_a_command_is_dropped(
    line: EchoLine, clock: Clock, port: FakePort, baudrate: int, most: int
) -> None:
    link = SerialLink(SerialSettings(port="/dev/test", baudrate=baudrate), line, clock, Opener(port))
    link.open()
    port.out_waiting = most
    assert link.send(Frame(1, b"a"))
    port.out_waiting = most + 1
    assert not link.send(Frame(1, b"b"))
    assert link.receive() == []
    port.out_waiting = 0
    assert link.send(Frame(1, b"c"))
    assert port.written == b"<a><c>"
    assert (link.counters.sent, link.counters.send_dropped, link.health["requests"]) == (2, 1, "0")


def test_port_without_a_write_count_has_taken_all(link: SerialLink, port: FakePort) -> None:
    port.rooms.append(None)
    assert link.send(Frame(1, b"a"))
    assert link.send(Frame(1, b"b"))
    assert port.written == b"<a><b>"


def test_without_room_a_command_is_dropped(link: SerialLink, port: FakePort) -> None:
    port.rooms.append(0)
    assert not link.send(Frame(1, b"a"))
    assert link.send(Frame(1, b"b"))
    assert port.written == b"<b>"
    assert link.counters.send_dropped == 1


def test_what_is_left_of_a_packet_goes_first(link: SerialLink, port: FakePort, clock: Clock) -> None:
    port.rooms += [2, 1, 0, 6]
    assert link.send(Frame(1, b"first"))
    assert not link.send(Frame(1, b"dropped"))
    assert not link.send(Frame(1, b"dropped"))
    clock.now_ns += 20 * MS
    assert link.send(Frame(1, b"last"))
    assert link.send(Frame(1, b"more"))
    assert port.written == b"<first><last><more>"
    assert (link.counters.sent, link.counters.send_dropped) == (3, 2)
    assert link.counters.bits == 10 * len(port.written)


def test_what_is_left_and_no_more_is_not_the_new_command(link: SerialLink, port: FakePort) -> None:
    port.rooms += [2, 5]
    assert link.send(Frame(1, b"first"))
    assert not link.send(Frame(1, b"dropped"))
    assert link.send(Frame(1, b"last"))
    assert port.written == b"<first><last>"


def test_an_old_command_is_not_finished(link: SerialLink, port: FakePort, clock: Clock) -> None:
    port.rooms.append(2)
    link.send(Frame(1, b"first"))
    clock.now_ns += 20 * MS + 1
    assert link.send(Frame(1, b"last"))
    assert port.written == b"<f<last>"


def test_a_dropped_command_does_not_keep_an_old_one_young(link: SerialLink, port: FakePort, clock: Clock) -> None:
    port.rooms += [2, 1]
    link.send(Frame(1, b"first"))
    clock.now_ns += 15 * MS
    assert not link.send(Frame(1, b"dropped"))
    clock.now_ns += 15 * MS
    assert link.send(Frame(1, b"last"))
    assert port.written == b"<fi<last>"


def test_health_has_refusals_and_rates(link: SerialLink, port: FakePort, clock: Clock) -> None:
    port.arriving.append(b"<a><bad><late>")
    link.receive()
    link.send(Frame(1, b"abcdef"))
    clock.now_ns += 500 * MS
    health = link.health
    assert health["state"] == "active"
    assert "lost" not in health
    assert (health["refused.crc"], health["refused.lost"], health["undecodable"]) == ("1", "1", "1")
    assert (health["sent_per_s"], health["received_per_s"]) == ("2.0", "2.0")
    assert health["load_percent"] == "0.5"  # 23 bytes, 230 bits, of 100 kbit/s in half a second
    assert all(isinstance(text, str) for text in health.values())


def test_missing_port_is_named_with_a_remedy(line: EchoLine, clock: Clock) -> None:
    link = SerialLink(SETTINGS, line, clock, Opener(PermissionError(13, "Permission denied")))
    with pytest.raises(BusNotFoundError, match=r"serial /dev/test at 100000 bit/s: Permission denied; .*usermod -aG"):
        link.open()
    assert link.state is LinkState.GONE


def test_receiving_on_a_closed_link_raises(line: EchoLine, clock: Clock, opener: Opener) -> None:
    link = SerialLink(SETTINGS, line, clock, opener)
    assert link.state is LinkState.GONE
    with pytest.raises(LinkLostError, match="/dev/test at 100000 bit/s is not open"):
        link.receive()
    assert not link.send(Frame(1, b"a"))
    assert link.counters.send_dropped == 1
    assert not opener.calls


def test_closing_closes_the_port_and_may_be_repeated(link: SerialLink, port: FakePort) -> None:
    link.close()
    link.close()
    assert port.is_closed
    assert link.state is LinkState.GONE
    with pytest.raises(LinkLostError, match="is not open"):
        link.receive()


def test_opening_again_closes_the_port_before(link: SerialLink, opener: Opener, port: FakePort) -> None:
    opener.results.append(FakePort())
    link.open()
    assert port.is_closed
    assert link.state is LinkState.ACTIVE


def _fail(link: SerialLink, port: FakePort, by: str, error: OSError) -> None:
    port.error = error
    if by == "send":
        assert not link.send(Frame(1, b"a"))
    else:
        with pytest.raises(LinkLostError):
            link.receive()


@pytest.mark.parametrize("by", ["send", "receive"])
@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), OSError("read failed"), OSError(), OSError("")])
def test_lost_port_is_reported_without_blocking(link: SerialLink, port: FakePort, by: str, error: OSError) -> None:
    _fail(link, port, by, error)
    assert link.state is LinkState.GONE
    assert link.health["state"] == "gone"
    assert link.health["lost"]
    assert not link.send(Frame(1, b"a"))
    with pytest.raises(LinkLostError, match=r"^serial /dev/test at 100000 bit/s is gone: .+; plug it in again$"):
        link.receive()


@pytest.mark.parametrize("by", ["send", "receive"])
def test_a_lost_port_comes_back_by_itself(
    link: SerialLink, opener: Opener, port: FakePort, clock: Clock, by: str
) -> None:
    again = FakePort()
    opener.results += [FileNotFoundError(2, "No such file"), again]
    port.arriving.append(b"<half")
    link.receive()
    _fail(link, port, by, OSError(5, "Input/output error"))
    eventually(lambda: _came_back(link, clock))
    assert port.is_closed
    assert link.counters.reopened == 1
    assert "lost" not in link.health
    assert again.take() == b"?"
    again.arriving.append(b"<whole>")
    assert [frame.data for frame in link.receive()] == [b"whole"]


def test_a_port_is_opened_again_off_the_loop_and_not_waited_for(
    link: SerialLink, opener: Opener, port: FakePort, clock: Clock
) -> None:
    opener.results.append(FakePort())
    _fail(link, port, "receive", OSError(5, "Input/output error"))
    opener.may_go.clear()
    for _ in range(5):
        assert not _came_back(link, clock)
    eventually(lambda: len(opener.calls) == 2)
    assert port.is_closed
    assert opener.calls[0][1] == threading.get_ident() != opener.calls[1][1]
    opener.may_go.set()
    eventually(lambda: _came_back(link, clock))
    assert len(opener.calls) == 2


def _came_back(link: SerialLink, clock: Clock) -> bool:
    clock.now_ns += 150 * MS
    try:
        link.receive()
    except LinkLostError:
        return False
    return True


def test_nothing_of_before_is_sent_to_a_port_that_came_back(
    link: SerialLink, opener: Opener, port: FakePort, clock: Clock
) -> None:
    again = FakePort()
    opener.results.append(again)
    port.rooms.append(2)
    link.send(Frame(1, b"first"))
    _fail(link, port, "send", OSError(5, "Input/output error"))
    standing = Clock()
    standing.now_ns = clock.now_ns
    eventually(lambda: _came_back(link, standing))
    assert link.send(Frame(1, b"last"))
    assert again.written == b"?<last>"


def test_what_opens_after_closing_is_closed(link: SerialLink, opener: Opener, port: FakePort) -> None:
    again = FakePort()
    opener.results.append(again)
    _fail(link, port, "receive", OSError(5, "Input/output error"))
    opener.may_go.clear()
    with pytest.raises(LinkLostError):
        link.receive()
    eventually(lambda: len(opener.calls) == 2)
    link.close()
    opener.may_go.set()
    eventually(lambda: again.is_closed)
    assert link.state is LinkState.GONE


def test_closing_a_lost_link_closes_what_was_lost(link: SerialLink, port: FakePort) -> None:
    _fail(link, port, "send", OSError(5, "Input/output error"))
    link.close()
    assert port.is_closed
