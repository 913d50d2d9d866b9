# SPDX-License-Identifier: MIT
"""Keys and snapshots between two ends that never wait."""

import socket
from collections.abc import Iterator

import msgspec
import pytest

from segway_ecc.hil.play.channel import Key, LoopEnd, Snapshot, TerminalEnd, channel

SNAPSHOT = Snapshot(
    robot="cart",
    mode="ARMED",
    reason="asked to arm",
    linear=0.1,
    angular=None,
    wanted_linear=0.2,
    wanted_angular=0.0,
    posture=None,
    line=None,
    pitch=None,
    battery={"board.bus_voltage_v": "36.000"},
    links={"link.state": "active"},
    timing={"rate_hz": "100"},
    messages=["hello"],
    has_ros=False,
    guard_runs=True,
    can_be_pushed=False,
    is_bus_broken=False,
)


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = channel()
    with ours, theirs:
        yield ours, theirs


def test_keys_come_in_order_and_nothing_is_not_waited_for(ends: tuple[socket.socket, socket.socket]) -> None:
    loop, terminal = LoopEnd(ends[0]), TerminalEnd(ends[1])
    assert list(loop.pressed()) == []
    for key in (Key.UP, Key.STOP, Key.ALIVE):
        terminal.press(key)

    assert list(loop.pressed()) == [Key.UP, Key.STOP, Key.ALIVE]
    assert list(loop.pressed()) == []
    assert not loop.is_gone


def test_the_newest_snapshot_is_shown(ends: tuple[socket.socket, socket.socket]) -> None:
    loop, terminal = LoopEnd(ends[0]), TerminalEnd(ends[1])
    assert terminal.newest() is None
    loop.show(SNAPSHOT)
    loop.show(msgspec.structs.replace(SNAPSHOT, mode="FAULT"))

    assert terminal.newest() == msgspec.structs.replace(SNAPSHOT, mode="FAULT")
    assert terminal.newest() is None
    assert not terminal.is_gone


def test_a_key_held_down_is_taken_a_few_at_a_time(ends: tuple[socket.socket, socket.socket]) -> None:
    loop, terminal = LoopEnd(ends[0]), TerminalEnd(ends[1])
    for _ in range(40):
        terminal.press(Key.UP)

    assert [len(list(loop.pressed())) for _ in range(3)] == [32, 8, 0]


def test_a_terminal_that_hangs_holds_up_nobody(ends: tuple[socket.socket, socket.socket]) -> None:
    loop = LoopEnd(ends[0])
    for _ in range(10_000):
        loop.show(SNAPSHOT)

    assert 0 < loop.dropped < 10_000


def test_a_loop_that_hangs_holds_up_no_terminal(ends: tuple[socket.socket, socket.socket]) -> None:
    terminal = TerminalEnd(ends[1])
    for _ in range(10_000):
        terminal.press(Key.UP)


def test_each_end_notices_that_the_other_is_gone(ends: tuple[socket.socket, socket.socket]) -> None:
    loop = LoopEnd(ends[0])
    ends[1].close()
    assert list(loop.pressed()) == []
    assert loop.is_gone
    loop.show(SNAPSHOT)
    assert loop.dropped == 1

    ours, theirs = channel()
    with theirs:
        ours.close()
        terminal = TerminalEnd(theirs)
        assert terminal.newest() is None
        assert terminal.is_gone
        terminal.press(Key.UP)


def test_what_is_no_key_is_passed_over(ends: tuple[socket.socket, socket.socket]) -> None:
    for message in (b"x", b"\xff", b"backback", b"back"):
        ends[1].send(message)
    assert list(LoopEnd(ends[0]).pressed()) == [Key.DOWN]
