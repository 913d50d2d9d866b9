# SPDX-License-Identifier: MIT
"""The link on ports of every kind: pseudo-terminals, sockets, RFC 2217, a loop, and none."""

import contextlib
import errno
import grp
import io
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial
from msgspec.structs import replace
from serial import rfc2217
from serial.tools import list_ports

from segway_ecc.firmware_io.drives.wheel_board.serial_codec import BoardSerialCodec
from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.links import serial_link
from segway_ecc.firmware_io.links.link import Frame, LinkState
from segway_ecc.firmware_io.links.serial_link import LOST, SerialLink
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.rig.simulated_serial import PtyPort

COMMAND = Frame(0x110, b"\x00\x01\x02\xff\x00\xfe\x11\x13")
LAST_ID = 0x7FF
TELEMETRY = Frame(0x120, b"\x00\r\n\x03\x04\x11\x13\x1a")


def _link(url: str) -> SerialLink:
    return SerialLink(SerialSettings(port=url), BoardSerialCodec(), time.monotonic_ns)


def _frames(receive: Callable[[], list[Frame]], count: int = 1) -> list[Frame]:
    """What is received until `count` frames are there, without their stamps; the link may be lost meanwhile."""
    frames: list[Frame] = []
    for _ in range(20_000):
        with contextlib.suppress(LinkLostError):
            frames += receive()
        if len(frames) >= count:
            return [replace(frame, received_ns=0) for frame in frames]
        time.sleep(0.001)
    pytest.fail(f"only {frames} arrived")


def _until_lost(link: SerialLink) -> None:
    _eventually(lambda: not _is_there(link))


def _until_back(link: SerialLink) -> None:
    _eventually(lambda: _is_there(link))


def _is_there(link: SerialLink) -> bool:
    try:
        link.receive()
    except LinkLostError:
        return False
    return True


def _eventually(condition: Callable[[], object]) -> None:
    for _ in range(20_000):
        if condition():
            return
        time.sleep(0.001)
    pytest.fail("it did not happen")


class Board:
    """What answers at the other end."""

    def __init__(self, read: Callable[[], bytes], write: Callable[[bytes], object]) -> None:
        self.line = BoardSerialCodec()
        self._read, self._write = read, write

    def receive(self) -> list[Frame]:
        return self.line.decode(self._read(), 0)

    def send(self, frame: Frame) -> None:
        packet = self.line.encode(frame)
        assert packet is not None
        self._write(packet)


def _converse(link: SerialLink, board: Board) -> None:
    """Frames pass both ways, and a request reaches the board."""
    assert link.send(COMMAND)
    assert _frames(board.receive) == [COMMAND]
    board.send(TELEMETRY)
    assert _frames(link.receive) == [TELEMETRY]
    asked = board.line.requests
    link.is_active = True
    for _ in range(20_000):
        assert link.receive() == board.receive() == []
        if board.line.requests > asked:
            return
        time.sleep(0.001)
    pytest.fail("the board was not asked")


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[PtyPort]:
    """A pseudo-terminal that the robot opens as `robot`."""
    port = PtyPort(tmp_path / "robot")
    yield port
    port.close()


@pytest.fixture
def link(pty: PtyPort) -> Iterator[SerialLink]:
    """A link on the pseudo-terminal."""
    link = _link(str(pty.path))
    link.open()
    yield link
    link.close()


def _board(pty: PtyPort) -> Board:
    return Board(lambda: pty.read(4096), pty.write)


def test_a_device_carries_frames_both_ways(link: SerialLink, pty: PtyPort) -> None:
    _converse(link, _board(pty))
    assert link.health["undecodable"] == "0"


def test_a_device_that_is_pulled_out_and_put_in_works_again_without_a_restart(link: SerialLink, pty: PtyPort) -> None:
    for times in range(1, 3):
        pty.unplug()
        _until_lost(link)
        assert link.state is LinkState.GONE
        assert not link.send(COMMAND)
        pty.plug()
        board = _board(pty)
        _until_back(link)
        _converse(link, board)
        assert link.counters.reopened == times


def test_what_arrived_before_it_was_opened_is_forgotten(pty: PtyPort) -> None:
    board = _board(pty)
    board.send(TELEMETRY)
    link = _link(str(pty.path))
    link.open()
    board.send(replace(TELEMETRY, data=b"new"))
    assert _frames(link.receive) == [replace(TELEMETRY, data=b"new")]
    link.close()


def test_a_full_device_drops_commands_and_does_not_wait(link: SerialLink, pty: PtyPort) -> None:
    count = 0
    while link.send(COMMAND):
        count += 1
    assert not link.send(COMMAND)
    assert link.counters.send_dropped == 2
    assert link.receive() == []
    board = _board(pty)
    assert _frames(board.receive, count) == [COMMAND] * count
    assert link.send(TELEMETRY)
    assert _frames(board.receive) == [TELEMETRY]
    assert set(board.line.refused) == {LOST}


def test_a_device_is_not_shared(link: SerialLink, pty: PtyPort) -> None:
    other = _link(str(pty.path))
    with pytest.raises(BusNotFoundError, match=r"another program has it open: sudo fuser -v"):
        other.open()
    link.close()
    other.open()
    other.close()


def test_a_spy_is_a_device(pty: PtyPort, capsys: pytest.CaptureFixture[str]) -> None:
    link = _link(f"spy://{pty.path}")
    link.open()
    _converse(link, _board(pty))
    link.close()
    assert "TX" in capsys.readouterr().err


def test_a_loop_brings_back_frames_but_no_requests() -> None:
    link = _link("loop://")
    link.open()
    assert link.send(COMMAND)
    assert _frames(link.receive) == [COMMAND]
    link.is_active = True
    for _ in range(5):
        time.sleep(0.001)
        assert link.receive() == []
    assert link.health["undecodable"] == "0"
    link.close()


def test_a_loop_that_nobody_reads_drops_and_does_not_wait() -> None:
    link = _link("loop://")
    link.open()
    count = 0
    while link.send(COMMAND):
        count += 1
    assert 922 / 16 <= count < 4096 / 16
    assert _frames(link.receive, count) == [COMMAND] * count
    link.close()


class Server:
    """A serial server on TCP: one client after the other."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = "{}:{}".format(*self._listener.getsockname())
        self.client: socket.socket | None = None

    def accept(self) -> Board:
        self.drop()
        self.client, _ = self._listener.accept()
        self.client.settimeout(0)
        return Board(self._read, self.client.sendall)

    def _read(self) -> bytes:
        assert self.client is not None
        try:
            return self.client.recv(4096)
        except BlockingIOError:
            return b""

    def drop(self) -> None:
        if self.client is not None:
            self.client.close()
            self.client = None

    def close(self) -> None:
        self.drop()
        self._listener.close()


@pytest.fixture
def server() -> Iterator[Server]:
    """A server that waits for a client."""
    server = Server()
    yield server
    server.close()


def test_a_socket_carries_frames_both_ways(server: Server) -> None:
    link = _link(f"socket://{server.address}")
    link.open()
    board = server.accept()
    board.send(TELEMETRY)
    assert _frames(link.receive) == [TELEMETRY]
    _converse(link, board)
    link.close()


def test_a_socket_sends_at_once(server: Server) -> None:
    port = serial_link.open_serial_port(SerialSettings(port=f"socket://{server.address}"))
    with socket.socket(fileno=os.dup(port._port.fileno())) as connection:
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    port.close()


def test_a_socket_that_is_closed_comes_back_without_a_restart(server: Server) -> None:
    link = _link(f"socket://{server.address}")
    link.open()
    _converse(link, server.accept())
    server.drop()
    _until_lost(link)
    with contextlib.suppress(LinkLostError):
        link.receive()
    board = server.accept()
    _until_back(link)
    _converse(link, board)
    assert link.counters.reopened == 1
    link.close()


def test_a_socket_that_nobody_reads_drops_commands_and_does_not_wait(server: Server) -> None:
    link = _link(f"socket://{server.address}")
    link.open()
    server.accept()
    count = 0
    while link.send(COMMAND):
        count += 1
        assert count < 10_000_000
    assert link.counters.send_dropped == 1
    link.close()


@pytest.mark.filterwarnings("ignore:set(Daemon|Name)")  # pyserial's own
def test_rfc2217_carries_frames_and_can_be_lost(server: Server) -> None:
    """Through pyserial's own server, in front of a port that sends everything back."""
    serving = threading.Thread(target=_serve_rfc2217, args=(server,))
    serving.start()
    link = _link(f"rfc2217://{server.address}")
    link.open()
    for _ in range(3):
        assert link.send(COMMAND)
    assert _frames(link.receive, 3) == [COMMAND] * 3
    assert link.send(Frame(LAST_ID, b""))
    serving.join()
    _until_lost(link)
    link.close()


def _serve_rfc2217(server: Server) -> None:
    server.accept()
    connection = server.client
    assert connection is not None
    connection.settimeout(30.0)
    line = BoardSerialCodec()
    with serial.serial_for_url("loop://", timeout=0) as port:
        manager = rfc2217.PortManager(port, SimpleNamespace(write=connection.sendall))
        frames: list[Frame] = []
        while all(frame.arbitration_id != LAST_ID for frame in frames):
            port.write(b"".join(manager.filter(connection.recv(4096))))
            data = port.read(4096)
            connection.sendall(b"".join(manager.escape(data)))
            frames = line.decode(data, 0)
    server.drop()


@pytest.mark.parametrize(
    ("present", "text"),
    [
        ([], "this machine has no serial port"),
        (["/dev/ttyUSB1", "/dev/ttyACM0"], "there is /dev/ttyACM0, /dev/ttyUSB1"),
    ],
)
def test_a_device_that_is_not_there_is_named_with_those_that_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, present: list[str], text: str
) -> None:
    link = _link(str(tmp_path / "ttyUSB7"))
    monkeypatch.setattr(list_ports, "comports", lambda: [SimpleNamespace(device=name) for name in present])
    with pytest.raises(BusNotFoundError, match=rf"ttyUSB7 at 921600 bit/s: .*; {text}; plug it in, or correct"):
        link.open()
    assert link.state is LinkState.GONE


@pytest.mark.parametrize(
    "url",
    [
        "nonsense://x",
        "socket://127.0.0.1:1",
        "socket://127.0.0.1",
        "rfc2217://127.0.0.1:1",
        "loop://?nonsense=1",
        "loop://?logging=nonsense",
        "/dev/null",
        "/",
        "",
    ],
)
def test_port_errors_are_reported_uniformly(url: str) -> None:
    with pytest.raises(BusNotFoundError, match=r"^cannot open serial .* at 921600 bit/s: .+; .+"):
        _link(url).open()


@pytest.mark.parametrize("code", [errno.EACCES, errno.EPERM])
def test_missing_permission_names_the_group(pty: PtyPort, tmp_path: Path, code: int) -> None:
    group = grp.getgrgid(pty.path.stat().st_gid).gr_name
    error = OSError(code, "Permission denied")
    assert f"usermod -aG {group} $USER" in serial_link.open_remedy(SerialSettings(port=str(pty.path)), error)
    assert "usermod -aG dialout $USER" in serial_link.open_remedy(SerialSettings(port=str(tmp_path / "gone")), error)


def test_a_group_without_a_name_is_the_usual_one(pty: PtyPort, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grp, "getgrgid", {}.__getitem__)
    assert "-aG dialout" in serial_link.open_remedy(SerialSettings(port=str(pty.path)), OSError(errno.EACCES, "no"))


def test_a_port_that_knows_less_can_still_be_used() -> None:
    """Other kinds of port have neither a descriptor nor a count of what is queued."""

    class Bare(io.RawIOBase):
        in_waiting = 3

        def reset_input_buffer(self) -> None:
            self.in_waiting = 0

    port = serial_link.PySerialPort(Bare())
    assert (port.in_waiting, port.out_waiting) == (0, 0)
    port.close()


def test_low_latency_is_asked_for_where_there_is_such_a_thing(monkeypatch: pytest.MonkeyPatch, pty: PtyPort) -> None:
    asked = []
    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", lambda _, is_low: asked.append(is_low))
    serial_link.open_serial_port(SerialSettings(port=str(pty.path))).close()
    assert asked == [True]
