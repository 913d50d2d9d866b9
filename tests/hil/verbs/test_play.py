# SPDX-License-Identifier: MIT
"""`segway-ecc play`: a person at a pseudo-terminal, and what reaches the bus."""

import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.links.local_bus import LocalBus
from tests.patience import PATIENCE_S
from tests.ros_domains import next_domain

pytestmark = pytest.mark.real_time

Run = Callable[..., Any]
COMMAND, LEFT_WHEEL = 0x114, 0x120
UP, LEFT = b"\x1b[A", b"\x1b[D"


def test_without_a_terminal_it_fails_with_one_line(segway_ecc: Run) -> None:
    outcome = segway_ecc("play", "cart-can")

    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.errors == [
        "segway-ecc: play is for a person at a terminal, and this is none: use run and plant instead"
    ]


class Player:
    """The command on a terminal of its own, and what passes on its bus.

    The layouts are those of wheel_board.dbc: commands in mV with the enabling flag in the fourth byte, velocities in
    0.01 rad/s from the fifth byte on.
    """

    def __init__(self, channel: str, folder: Path, *options: str, **environment: str) -> None:
        self.screen = b""
        self._has_ended = False
        self._bus = LocalBus(channel)
        self._ours, self._theirs = pty.openpty()
        self.before = termios.tcgetattr(self._theirs)
        words = ["play", "cart-can", "--interface", "local", "--channel", channel, *options]
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words],
            stdin=self._theirs,
            stdout=self._theirs,
            stderr=self._theirs,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm", "TMPDIR": str(folder), **environment},
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def press(self, keys: bytes) -> None:
        os.write(self._ours, keys)

    def settings(self) -> list[Any]:
        return termios.tcgetattr(self._theirs)

    def wait_for(self, arbitration_id: int, is_wanted: Callable[[bytes], bool]) -> None:
        """Wait for a frame on the bus."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            message = self._bus.recv(1.0)
            if message is not None and message.arbitration_id == arbitration_id and is_wanted(bytes(message.data)):
                return
            assert self.process.poll() is None, self.screen.decode(errors="replace")
        pytest.fail("the frame never came; the terminal shows " + self.screen.decode(errors="replace")[-2000:])

    def frames(self, arbitration_id: int) -> list[bytes]:
        """All frames of an identifier that have passed since they were last looked at."""
        found = []
        while (message := self._bus.recv(0.0)) is not None:
            if message.arbitration_id == arbitration_id:
                found.append(bytes(message.data))
        return found

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
        self.process.wait(PATIENCE_S)
        if self._has_ended:
            return
        self._has_ended = True
        os.close(self._theirs)
        self._reader.join(PATIENCE_S)
        os.close(self._ours)
        self._bus.shutdown()

    def _read(self) -> None:
        while True:
            try:
                self.screen += os.read(self._ours, 4096)
            except OSError:
                return


@pytest.fixture
def player(tmp_path: Path) -> Iterator[Player]:
    found = Player(f"play_test_{os.getpid()}", tmp_path, "--no-ros")
    yield found
    found.end()


def armed(player: Player) -> None:
    """Wait until the person sees a robot that is armed; keys from before are thrown away by design."""
    deadline = time.monotonic() + PATIENCE_S
    while b"ARMED" not in player.screen.replace(b"DISARMED", b""):
        assert time.monotonic() < deadline, player.screen
        time.sleep(0.05)
    player.wait_for(COMMAND, is_enabled)


def lives(pid: int) -> bool:
    """Whether a process runs; one whose new parent has not noticed its end does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def velocity(data: bytes) -> float:
    return float(struct.unpack_from("<h", data, 4)[0]) * 0.01


def is_enabled(data: bytes) -> bool:
    return bool(data[3] & 0x80)


def test_a_person_drives_rests_and_leaves_with_the_motors_off(player: Player) -> None:
    armed(player)
    player.press(UP)
    player.press(UP)
    player.wait_for(LEFT_WHEEL, lambda data: velocity(data) > 0.5)
    time.sleep(1.0)  # set-points that are not renewed have run out by then
    player.frames(LEFT_WHEEL)
    player.wait_for(LEFT_WHEEL, lambda data: velocity(data) > 0.5)
    player.press(b"x")
    player.wait_for(LEFT_WHEEL, lambda data: abs(velocity(data)) < 0.05)
    player.frames(COMMAND)
    player.press(b"q")

    assert player.process.wait(PATIENCE_S) == 0
    last = player.frames(COMMAND)[-1]
    assert not is_enabled(last)
    assert last[:2] == bytes(2)
    assert player.settings() == player.before, "the terminal is as it was"
    player.end()
    assert b"\x1b[?1049l" in player.screen, "the screen of before is back"
    assert b"stopped: q was pressed" in player.screen


def test_disarm_arm_stop_and_clear_are_obeyed(player: Player) -> None:
    armed(player)
    for off, on in ((b"n", b"m"), (b" ", b"cm"), (b"\x1b", b"cm")):
        player.press(off)
        player.wait_for(COMMAND, lambda data: not is_enabled(data))
        player.press(on)
        player.wait_for(COMMAND, is_enabled)


def test_a_terminal_that_goes_away_ends_the_robot(player: Player) -> None:
    armed(player)
    # Its own process is the child that was started for the terminal.
    children = [
        int(pid)
        for pid in Path(f"/proc/{player.process.pid}/task/{player.process.pid}/children").read_text().split()
        if b"segway_ecc.hil.play.terminal" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    os.kill(children[0], signal.SIGKILL)

    assert player.process.wait(PATIENCE_S) == 0
    assert not is_enabled(player.frames(COMMAND)[-1])
    assert b"stopped: the terminal is gone" in player.screen
    assert player.settings() == player.before


def test_a_player_that_is_killed_leaves_nothing_behind_and_the_terminal_as_it_was(player: Player) -> None:
    armed(player)
    path = Path(f"/proc/{player.process.pid}/task/{player.process.pid}/children")
    children = [int(pid) for pid in path.read_text().split()]
    assert len(children) == 3, "the plant, the guard and the terminal"
    os.kill(player.process.pid, signal.SIGKILL)
    player.process.wait(PATIENCE_S)

    deadline = time.monotonic() + PATIENCE_S
    while any(lives(pid) for pid in children):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert player.settings() == player.before


def test_what_it_shows(player: Player) -> None:
    deadline = time.monotonic() + PATIENCE_S
    wanted = (b"cart-can", b"ARMED", b"velocity", b"set-point", b"battery", b"links", b"loop", b"q quit", b"36.000 V")
    while not all(word in player.screen for word in wanted):
        assert time.monotonic() < deadline, [word for word in wanted if word not in player.screen]
        time.sleep(0.05)


@pytest.mark.ros
def test_with_ros_anyone_can_drive(tmp_path: Path) -> None:
    graph = {"ROS_DOMAIN_ID": next_domain(), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    player = Player(f"play_ros_{os.getpid()}", tmp_path, "--ros", "--namespace", f"/play_{os.getpid()}", **graph)
    try:
        armed(player)
        words = ["sequence", "0.5", "0", "1", "--namespace", f"/play_{os.getpid()}", "--wait", "20"]
        fastest = 0.0
        command = [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ, **graph}) as driven:
            while driven.poll() is None:
                # Read all the while: the bus keeps a few thousand frames, and then loses the newest.
                fastest = max([fastest, *map(velocity, player.frames(LEFT_WHEEL))])
                time.sleep(0.05)
            errors = driven.communicate()[1]
        assert driven.returncode == 0, errors
        assert fastest > 0.5
        assert b"cmd_vel drives too" in player.screen
    finally:
        player.end()
