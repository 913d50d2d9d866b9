# SPDX-License-Identifier: MIT
import fcntl
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.rig.simulated_serial import PtyPort

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


def test_a_name_left_by_a_rig_that_died_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    path.symlink_to(tmp_path / "gone")
    first = PtyPort(path)
    second = PtyPort(path)
    first.close()
    assert path.is_symlink()
    second.close()
    second.close()
    assert not path.is_symlink()


def test_a_file_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "robot"
    path.write_text("precious")
    before = sum(1 for _ in Path("/dev/fd").iterdir())
    with pytest.raises(FileExistsError):
        PtyPort(path)
    assert path.read_text() == "precious"
    assert sum(1 for _ in Path("/dev/fd").iterdir()) == before


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
