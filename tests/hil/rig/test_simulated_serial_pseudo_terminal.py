# SPDX-License-Identifier: MIT
import contextlib
import fcntl
import os
import socket
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.errors import SerialNameError
from segway_ecc.hil.rig.simulated_serial import PtyPort, serve_serial

ALL_BYTES = bytes(range(256))


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[PtyPort]:
    """A pseudo-terminal that the robot opens as `robot`."""
    port = PtyPort(tmp_path / "robot")
    yield port
    port.close()


@pytest.fixture
def robot(pty: PtyPort) -> Iterator[serial.Serial]:
    """The robot's end."""
    with serial.Serial(str(pty.path), timeout=0) as port:
        yield port


def _collect(read: Callable[[int], bytes], size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += read(size)
        time.sleep(0.001)
    return data


def test_every_byte_passes_as_it_is_both_ways(pty: PtyPort, robot: serial.Serial) -> None:
    device: Port = pty
    assert device.write(ALL_BYTES) == 256
    assert _collect(robot.read, 256) == ALL_BYTES
    assert robot.write(ALL_BYTES) == 256
    assert _collect(device.read, 256) == ALL_BYTES
    assert device.read(9) == b""


def test_what_waits_is_counted_and_nothing_is_echoed(pty: PtyPort, robot: serial.Serial) -> None:
    pty.write(b"to the robot")
    assert _collect(robot.read, 12) == b"to the robot"
    robot.write(b"abc")
    while pty.in_waiting < 3:
        time.sleep(0.001)
    assert pty.in_waiting == 3
    assert pty.read(2) == b"ab"
    assert pty.in_waiting == 1


def test_it_is_raw_before_the_robot_opens_it(pty: PtyPort) -> None:
    pty.write(b"\x03\r\n\x04")
    robots = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    try:
        assert _collect(lambda size: os.read(robots, size), 4) == b"\x03\r\n\x04"
    finally:
        os.close(robots)
    assert pty.read(9) == b""


def test_a_full_one_takes_no_more_and_does_not_wait(pty: PtyPort, robot: serial.Serial) -> None:
    # The kernel moves what was written to the robot's end when it comes to it, which makes room: never without bound.
    taken = sum(pty.write(bytes(1024)) for _ in range(10_000))
    assert 0 < taken < 1_000_000
    assert robot.is_open


def test_the_robot_may_come_and_go(pty: PtyPort) -> None:
    for _ in range(2):
        with serial.Serial(str(pty.path), timeout=0) as robot:
            robot.write(b"x")
            assert _collect(pty.read, 1) == b"x"
        assert pty.read(9) == b""


def test_unplugged_the_robot_has_an_error_and_the_name_is_gone(pty: PtyPort, robot: serial.Serial) -> None:
    pty.unplug()
    with pytest.raises(OSError, match=r"returned no data|Input/output error"):
        robot.read(1)
    with pytest.raises(OSError, match="Input/output error"):
        robot.write(b"x")
    assert not os.path.lexists(pty.path)
    assert (pty.in_waiting, pty.read(9), pty.write(b"into the air")) == (0, b"", 12)


def test_plugged_in_again_it_works_under_the_same_name(pty: PtyPort, robot: serial.Serial) -> None:
    assert robot.is_open
    pty.unplug()
    pty.unplug()
    pty.plug()
    before = pty.path.readlink()
    pty.plug()
    assert pty.path.readlink() == before
    with serial.Serial(str(pty.path), timeout=0) as again:
        pty.write(b"back")
        assert _collect(again.read, 4) == b"back"


def _killed(path: Path) -> None:
    """Leave behind what a rig does that is killed: its link, and nobody who serves it."""
    living = PtyPort(path)
    text = living.path.readlink()
    living.close()
    path.symlink_to(text)


def test_link_left_by_a_rig_that_was_killed_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    _killed(path)
    port = PtyPort(path)
    with serial.Serial(str(path), timeout=0) as robot:
        port.write(b"new")
        assert _collect(robot.read, 3) == b"new"
    port.close()
    port.close()
    assert not os.path.lexists(path)


def test_left_link_is_replaced_where_its_terminal_is_somebody_else_s_by_now(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    path = tmp_path / "robot"
    path.symlink_to(os.ttyname(theirs).replace("/dev/pts/", "/dev/pts/../pts/"))
    port = serve_serial(SerialSettings(port=str(path)))
    try:
        port.write(b"to the robot")
        os.set_blocking(ours, False)
        with pytest.raises(BlockingIOError):
            os.read(ours, 1)
    finally:
        port.close()
        os.close(theirs)
        os.close(ours)


def test_path_that_a_living_rig_serves_is_refused(pty: PtyPort, tmp_path: Path) -> None:
    before = pty.path.readlink()
    for same in (pty.path, tmp_path / "x" / ".." / "robot"):
        (tmp_path / "x").mkdir(exist_ok=True)
        with pytest.raises(SerialNameError, match="another plant serves it; stop that one first"):
            serve_serial(SerialSettings(port=str(same)))
    assert pty.path.readlink() == before
    pty.unplug()
    with pytest.raises(SerialNameError, match="another plant serves it"):
        PtyPort(pty.path)


def _file(path: Path) -> None:
    path.write_text("precious")


def _link_to_file(path: Path) -> None:
    _file(path.with_name("precious"))
    path.symlink_to(path.with_name("precious"))


def _link_to_absent_adapter(path: Path) -> None:
    path.symlink_to("../../ttyUSB99")


def _link_to_absent_terminal(path: Path) -> None:
    path.symlink_to("/dev/pts/999999")


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize(
    "make", [_file, _link_to_file, _link_to_absent_adapter, _link_to_absent_terminal, Path.mkdir, os.mkfifo, _socket]
)
def test_what_no_rig_made_is_refused_and_left_as_it_is(tmp_path: Path, make: Callable[[Path], None]) -> None:
    path = tmp_path / "robot"
    make(path)
    before, descriptors = os.lstat(path), sum(1 for _ in Path("/dev/fd").iterdir())
    with pytest.raises(SerialNameError, match="it exists and is not a link that a plant made"):
        serve_serial(SerialSettings(port=str(path)))
    assert os.lstat(path) == before
    assert sum(1 for _ in Path("/dev/fd").iterdir()) == descriptors


def test_name_can_be_used_once_what_was_there_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    path.touch()
    with pytest.raises(SerialNameError):
        PtyPort(path)
    path.unlink()
    PtyPort(path).close()


def test_folder_that_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SerialNameError, match=r"cannot make a serial line at .*: No such file or directory$"):
        serve_serial(SerialSettings(port=str(tmp_path / "no" / "robot")))


@pytest.fixture
def cable() -> Iterator[tuple[int, str]]:
    """A terminal that stands in for a serial adapter: the robot's end of its cable, and the device's name."""
    robot, device = os.openpty()
    try:
        yield robot, os.ttyname(device)
    finally:
        os.close(device)
        with contextlib.suppress(OSError):
            os.close(robot)


@pytest.mark.parametrize("by_link", [False, True], ids=["device", "link as of udev"])
def test_real_port_is_served_at_its_rate_and_its_name_kept(
    cable: tuple[int, str], tmp_path: Path, *, by_link: bool
) -> None:
    robot, name = cable
    link = tmp_path / "usb-FTDI-if00-port0"
    link.symlink_to(name)
    port = serve_serial(SerialSettings(port=str(link) if by_link else name, baudrate=115_200))
    try:
        assert termios.tcgetattr(robot)[4:6] == [termios.B115200, termios.B115200]
        assert port.write(ALL_BYTES) == 256
        assert _collect(lambda size: os.read(robot, size), 256) == ALL_BYTES
        os.write(robot, b"abc")
        assert _collect(port.read, 3) == b"abc"
        assert port.in_waiting == 0
    finally:
        port.close()
    assert str(link.readlink()) == name


def test_real_port_that_another_program_has_is_refused_with_the_remedy(cable: tuple[int, str]) -> None:
    with (
        serial.Serial(cable[1], exclusive=True),
        pytest.raises(SerialNameError, match=f"cannot serve {cable[1]}: .*another program has it open"),
    ):
        serve_serial(SerialSettings(port=cable[1]))


def test_device_that_is_no_terminal_is_refused() -> None:
    with pytest.raises(SerialNameError, match=r"cannot serve /dev/null: .*check the port"):
        serve_serial(SerialSettings(port="/dev/null"))


def test_url_is_served() -> None:
    port = serve_serial(SerialSettings(port="loop://"))
    port.write(b"round")
    assert port.read(5) == b"round"
    port.close()


def test_real_port_that_is_pulled_out_is_reported(cable: tuple[int, str]) -> None:
    port = serve_serial(SerialSettings(port=cable[1]))
    os.close(cable[0])
    with pytest.raises(LinkLostError, match=f"^serial port {cable[1]} is gone: .*plug it in, and start again$"):
        port.read(port.in_waiting + 1)
    port.close()


def test_closing_after_somebody_removed_the_name_is_no_error(pty: PtyPort) -> None:
    pty.path.unlink()
    pty.close()


def test_the_robots_lock_is_its_own(pty: PtyPort) -> None:
    with (
        serial.Serial(str(pty.path), exclusive=True),
        pty.path.open("rb", buffering=0) as other,
        pytest.raises(BlockingIOError),
    ):
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
