# SPDX-License-Identifier: MIT
"""Who owns a bus, and heartbeats from the owner's loop to the guard."""

import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.firmware_io.build import build_hardware
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.drives.wheel_board.session import CommandId
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.heartbeat import (
    BusOwnedError,
    BusOwner,
    GuardRunsError,
    HeartbeatListener,
    address_of,
    code_of,
    name_of,
)
from segway_ecc.firmware_io.links.can_ports import make_can_link
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings

CAN = CanSettings(interface="local", channel=f"heartbeat_{os.getpid()}")
MS = 1_000_000


class Now:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.ns = 1_000 * MS

    def __call__(self) -> int:
        self.ns += 1  # no two heartbeats are of the same time
        return self.ns


@pytest.fixture
def now() -> Now:
    return Now()


@pytest.fixture
def listener() -> Iterator[HeartbeatListener]:
    listener = HeartbeatListener(CAN)
    listener.open()
    yield listener
    listener.close()


@pytest.fixture
def owner(now: Now) -> Iterator[BusOwner]:
    owner = BusOwner(CAN, now)
    owner.open()
    yield owner
    owner.close()


def introduce(owner: BusOwner, listener: HeartbeatListener) -> None:
    """The owner's first heartbeat has no key, and the guard's answer brings it."""
    owner.beat(is_on=False)
    assert list(listener.take_heartbeats()) == []
    listener.answer("")


def test_neither_side_ever_waits(listener: HeartbeatListener, owner: BusOwner) -> None:
    assert owner._socket is not None
    assert listener._socket is not None

    assert not owner._socket.getblocking()
    assert not listener._socket.getblocking()


def test_heartbeats_arrive_in_their_order(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    for is_on in (True, False, True):
        owner.beat(is_on=is_on)

    assert list(listener.take_heartbeats()) == [True, False, True]
    assert list(listener.take_heartbeats()) == []
    assert listener.refused == 1


def test_a_guard_that_starts_beside_a_node_that_runs_has_its_next_heartbeat(owner: BusOwner) -> None:
    for _ in range(5):
        owner.beat(is_on=True)  # nobody is there, so the next ones are left out
    listener = HeartbeatListener(CAN)
    listener.open()
    owner.beat(is_on=True)

    assert list(listener.take_heartbeats()) == [True]
    assert (listener.refused, owner.stops) == (0, "")
    listener.close()


def test_a_guard_that_starts_again_has_another_key_and_the_next_heartbeat(
    listener: HeartbeatListener, owner: BusOwner
) -> None:
    introduce(owner, listener)
    key = listener._key
    listener.open()
    owner.beat(is_on=True)

    assert listener._key != key
    assert list(listener.take_heartbeats()) == [True]


def test_a_heartbeat_that_is_played_again_is_refused(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    assert listener._socket is not None
    recording = []
    for _ in range(3):
        owner.beat(is_on=True)
        recording.append(listener._socket.recv(100))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as player:
        for beat in (*recording, *recording, recording[1]):
            player.sendto(beat, address_of(CAN))
        assert list(listener.take_heartbeats()) == [True] * 3
        assert listener.refused == 1 + 4
        # To a guard that was started since, none of them means anything.
        listener.open()
        for beat in recording:
            player.sendto(beat, address_of(CAN))
        assert list(listener.take_heartbeats()) == []


def test_what_has_no_code_of_this_key_is_refused(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    assert listener._socket is not None
    owner.beat(is_on=True)
    beat = listener._socket.recv(100)
    wrong = [b"", b"\x01", beat[:-1], beat + b"\0"]
    wrong += [beat[:place] + bytes([beat[place] ^ 1]) + beat[place + 1 :] for place in range(len(beat))]
    wrong += [beat[:9] + code_of(bytes(16), beat[:9])]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger:
        for each in wrong:
            stranger.sendto(each, address_of(CAN))
            assert list(listener.take_heartbeats()) == []

    assert listener.refused == 1 + len(wrong)


def test_only_the_owner_learns_the_key(listener: HeartbeatListener, owner: BusOwner) -> None:
    """Whoever sends anything, the answer goes to the name that the owner holds."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger:
        stranger.bind("")
        stranger.setblocking(False)  # noqa: FBT003 - the standard library's signature
        stranger.sendto(b"who is there", address_of(CAN))
        list(listener.take_heartbeats())
        listener.answer("")
        with pytest.raises(BlockingIOError):
            stranger.recv(100)
    owner.beat(is_on=True)

    assert list(listener.take_heartbeats()) == [True]


def test_heartbeats_without_a_guard_cost_a_system_call_every_tenth_time(owner: BusOwner) -> None:
    owner.beat(is_on=True)
    listener = HeartbeatListener(CAN)
    listener.open()
    assert owner._socket is not None
    owner._socket.recv(100)  # as if the guard's announcement had been lost
    for _ in range(9):
        owner.beat(is_on=True)
    list(listener.take_heartbeats())
    assert listener.refused == 0
    owner.beat(is_on=True)
    list(listener.take_heartbeats())

    assert listener.refused == 1
    listener.close()


def test_a_guard_that_does_not_keep_up_holds_nobody_up(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    for _ in range(10_000):
        owner.beat(is_on=True)
    taken = len(list(listener.take_heartbeats()))

    # The kernel queues as many as net.unix.max_dgram_qlen says, and one that is on its way.
    assert 1 <= taken <= 64


def test_a_node_that_beats_without_end_does_not_hold_the_guard_up(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    owner.beat(is_on=True)
    taken = 0
    for _ in listener.take_heartbeats():
        taken += 1
        owner.beat(is_on=True)
        assert taken <= 64

    assert taken == 64


def test_the_owner_knows_whether_a_guard_answers(listener: HeartbeatListener, owner: BusOwner, now: Now) -> None:
    found = [owner.has_guard]
    introduce(owner, listener)
    owner.beat(is_on=False)
    found.append(owner.has_guard)
    now.ns += 100 * MS
    found.append(owner.has_guard)

    assert found == [False, True, False]


def test_a_guard_answers_for_a_tenth_of_a_second(listener: HeartbeatListener) -> None:
    times = [1_000 * MS]
    owner = BusOwner(CAN, lambda: times[-1])
    owner.open()
    introduce(owner, listener)
    owner.beat(is_on=False)
    found = []
    for later_ns in (0, 100 * MS, 100 * MS + 1):
        times.append(1_000 * MS + later_ns)
        found.append(owner.has_guard)
    owner.close()

    assert found == [True, True, False]


def test_nothing_is_known_of_a_guard_before_the_bus_is_owned_and_after(
    listener: HeartbeatListener, owner: BusOwner
) -> None:
    before = BusOwner(CAN)
    assert (before.needs_guard, before.has_guard, before.stops) == (False, False, "")
    assert BusOwner(CAN, needs_guard=True).needs_guard
    introduce(owner, listener)
    listener.answer("something")
    owner.beat(is_on=True)
    assert (owner.has_guard, owner.stops) == (True, "something")
    owner.close()

    assert (owner.has_guard, owner.stops) == (False, "")


def test_a_long_reason_is_cut_also_within_a_letter(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    found = []
    for text in ("x" * 300, "x" + "\u00e9" * 150):
        listener.answer(text)
        owner.beat(is_on=True)
        found.append(owner.stops)

    assert found == ["x" * 200, "x" + "\u00e9" * 99 + "\ufffd"]


def test_a_pause_is_a_hundredth_of_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr(time, "sleep", slept.append)
    BusOwner(CAN).pause()

    assert slept == [0.01]


def test_a_guard_that_answers_again_is_there_again(listener: HeartbeatListener, owner: BusOwner, now: Now) -> None:
    introduce(owner, listener)
    now.ns += 1_000 * MS
    owner.beat(is_on=False)
    now.ns += 1_000 * MS
    list(listener.take_heartbeats())
    listener.answer("")
    owner.beat(is_on=False)

    assert owner.has_guard


def test_a_guard_that_has_ended_is_known_at_the_next_heartbeat(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    listener.answer("something")
    owner.beat(is_on=True)
    assert (owner.has_guard, owner.stops) == (True, "something")
    listener.close()
    owner.beat(is_on=True)

    assert (owner.has_guard, owner.stops) == (False, "")


def test_the_owner_learns_why_the_guard_stops_the_drives_also_when_it_has_ended_that(
    listener: HeartbeatListener, owner: BusOwner
) -> None:
    introduce(owner, listener)
    owner.beat(is_on=True)
    list(listener.take_heartbeats())
    for text in ("", "silence", "silence", ""):
        listener.answer(text)
    owner.beat(is_on=True)
    assert owner.stops == "silence"
    list(listener.take_heartbeats())
    listener.answer("")
    owner.beat(is_on=True)

    assert owner.stops == ""


def test_the_guard_answers_once_unless_something_has_changed(listener: HeartbeatListener, owner: BusOwner) -> None:
    introduce(owner, listener)
    owner.beat(is_on=True)
    list(listener.take_heartbeats())
    listener.answer("")
    assert owner._socket is not None
    owner._socket.recv(100)
    for text in ("", "x", "x", ""):
        listener.answer(text)
    found = [owner._socket.recv(1000)[16:] for _ in range(2)]

    assert found == [b"x", b""]
    with pytest.raises(BlockingIOError):
        owner._socket.recv(1000)


def test_answers_of_others_than_the_guard_are_skipped(listener: HeartbeatListener, owner: BusOwner) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger:
        for answer in (b"", b"short", bytes(16) + b"stop"):
            stranger.sendto(answer, address_of(CAN, "node"))
        owner.beat(is_on=True)
        assert (owner.has_guard, owner.stops) == (False, "")
        introduce(owner, listener)
        stranger.sendto(bytes(16) + b"stop", address_of(CAN, "node"))
    owner.beat(is_on=True)

    assert owner.stops == ""
    assert list(listener.take_heartbeats()) == [True]


def test_a_bus_has_one_owner_who_is_named(owner: BusOwner) -> None:
    second = BusOwner(CAN)
    with pytest.raises(BusOwnedError) as error:
        second.open()
    text = str(error.value)

    assert text.startswith(f"bus 'local {CAN.channel}' is controlled by process {os.getpid()} (")
    assert text.endswith("): a bus has one controller; stop that one first")
    second.beat(is_on=True)
    second.close()
    owner.close()
    second.open()
    second.close()


@pytest.mark.usefixtures("owner")
def test_an_owner_whose_command_may_not_be_read_is_named_by_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_path: Path) -> bytes:
        raise PermissionError

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(BusOwnedError, match=rf"is controlled by process {os.getpid()}: a bus has one controller"):
        BusOwner(CAN).open()


def test_an_owner_is_named_as_often_as_anybody_asks_and_also_while_it_is_stopped() -> None:
    words = (
        "import sys; from segway_ecc.firmware_io.heartbeat import BusOwner; from segway_ecc.firmware_io.links.settings "
        f"import CanSettings; it = BusOwner(CanSettings(interface='local', channel='{CAN.channel}')); it.open(); "
        "print('open', flush=True); sys.stdin.read()"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-c", words, "one", "two\udcff"], stdin=pipe, stdout=pipe, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        shown = re.escape(f"{sys.executable} -c {words} one two\ufffd"[-80:])
        for _ in range(300):
            with pytest.raises(BusOwnedError, match=rf"controlled by process {other.pid} \({shown}\): a bus"):
                BusOwner(CAN).open()
        other.kill()
    again = BusOwner(CAN)
    again.open()
    again.close()


def test_half_a_name_is_not_enough() -> None:
    """Somebody holds the one of its two sockets and not the other."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as squatter:
        squatter.bind(address_of(CAN, "node"))
        with pytest.raises(BusOwnedError, match=re.escape("is controlled by another process: ")):
            BusOwner(CAN).open()


def test_an_owner_gives_its_sockets_back_and_may_open_again(owner: BusOwner, listener: HeartbeatListener) -> None:
    first = owner._lock, owner._socket
    owner.open()
    assert [each.fileno() for each in first if each is not None] == [-1, -1]
    introduce(owner, listener)
    owner.beat(is_on=True)
    assert list(listener.take_heartbeats()) == [True]
    owner.close()
    owner.close()
    owner.beat(is_on=True)

    assert list(listener.take_heartbeats()) == []


def test_a_listener_gives_its_socket_back(listener: HeartbeatListener) -> None:
    first = listener._socket
    assert first is not None
    listener.close()
    listener.close()
    listener.answer("x")

    assert first.fileno() == -1


def test_a_bus_has_one_guard(listener: HeartbeatListener) -> None:
    second = HeartbeatListener(CAN)
    with pytest.raises(GuardRunsError, match=r"^a guard of this bus already runs \(\w.*\); stop that one first$"):
        second.open()
    listener.close()
    second.open()
    second.close()
    assert list(second.take_heartbeats()) == []


def test_each_bus_has_addresses_of_its_own_that_its_name_gives() -> None:
    same = CanSettings(interface="local", channel="robot", bitrate=125_000)

    assert address_of(CanSettings(interface="local")) == address_of(same)
    assert address_of(same) != address_of(CAN)
    # A guard and a node of different releases must find each other: printf 'socketcan can0' | sha256sum
    can0 = CanSettings(interface="socketcan", channel="can0")
    assert address_of(can0) == "\0segway-ecc-guard-90541c4965ee54b0"
    assert address_of(can0, "node") == "\0segway-ecc-node-90541c4965ee54b0"


def test_a_serial_line_is_known_by_its_name_and_not_by_what_the_name_leads_to(tmp_path: Path) -> None:
    """An adapter that is found again has another number under the same name."""
    (tmp_path / "adapter").symlink_to("/dev/null")
    (tmp_path / "folder").symlink_to(tmp_path)
    line = PortSettings(port=str(tmp_path / "adapter"))
    before = address_of(line)
    (tmp_path / "adapter").unlink()
    (tmp_path / "adapter").symlink_to("/dev/zero")
    assert address_of(line) == before
    assert address_of(PortSettings(port=str(tmp_path / "folder" / "adapter"), baudrate=9_600)) == before
    assert address_of(PortSettings(port=str(tmp_path / "other"))) != before
    assert name_of(PortSettings(port="socket://bench:1")) == "serial socket://bench:1"
    assert name_of(line) == f"serial {tmp_path.resolve() / 'adapter'}"


def test_the_code_is_keyed_blake2s() -> None:
    """Computed by b2sum's reference implementation in C for this key and message, truncated to 8 bytes by parameter."""
    assert len(code_of(bytes(range(16)), b"head")) == 8
    assert code_of(bytes(range(16)), b"head") != code_of(bytes(16), b"head")


def test_a_second_controller_of_a_bus_sends_nothing() -> None:
    first, second = (build_hardware(WheelBoardSettings(can=CAN), 0.01, RealClock()) for _ in range(2))
    witness = make_can_link(CAN.interface, CAN.channel, 500_000)
    first.open()
    witness.open()
    with pytest.raises(BusOwnedError, match=rf"controlled by process {os.getpid()} "):
        second.open()
    second.close()

    assert witness.receive() == []
    first.close()
    witness.close()


def test_a_controller_elsewhere_is_known_by_its_frames_before_anything_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """It holds no name of this machine's kernel."""
    other = make_can_link(CAN.interface, CAN.channel, 500_000)
    other.open()
    monkeypatch.setattr(BusOwner, "pause", lambda _owner: other.send(Frame(CommandId.LEFT_COMMAND, bytes(8))))
    robot = build_hardware(WheelBoardSettings(can=CAN), 0.01, RealClock())
    with pytest.raises(BusOwnedError, match=r"command frames that this node did not send, 0x113 "):
        robot.open()
    robot.close()

    assert other.receive() == []
    other.close()


def test_a_robot_alone_on_its_bus_sends_heartbeats_to_its_guard(listener: HeartbeatListener) -> None:
    robot = build_hardware(WheelBoardSettings(can=CAN), 0.01, RealClock())
    robot.open()
    list(listener.take_heartbeats())
    listener.answer("")
    robot.exchange((0.0, 0.0))
    robot.close()

    assert list(listener.take_heartbeats()) == [False, False]


def test_answers_without_end_do_not_hold_the_node_up(listener: HeartbeatListener, owner: BusOwner) -> None:
    class Endless:
        def __init__(self) -> None:
            self.taken = 0

        def recvfrom(self, _size: int) -> tuple[bytes, bytes]:
            self.taken += 1
            return listener._key, address_of(CAN).encode()

    endless = Endless()
    sock: Any = endless
    owner._receive(sock)

    assert endless.taken == 64
    assert owner.has_guard
