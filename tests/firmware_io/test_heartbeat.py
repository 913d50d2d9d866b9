# SPDX-License-Identifier: MIT
"""Heartbeats from the loop to the guard."""

import os
from collections.abc import Iterator

import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.build import build_hardware
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.heartbeat import GuardRunsError, HeartbeatListener, HeartbeatSender, address_of
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.rig.simulation import LockstepRig

CAN = CanSettings(interface="local", channel=f"heartbeat_{os.getpid()}")
ZERO = (0.0, 0.0)


@pytest.fixture
def listener() -> Iterator[HeartbeatListener]:
    listener = HeartbeatListener(CAN)
    listener.open()
    yield listener
    listener.close()


@pytest.fixture
def sender() -> Iterator[HeartbeatSender]:
    sender = HeartbeatSender(CAN)
    yield sender
    sender.close()


def test_neither_side_ever_waits(listener: HeartbeatListener, sender: HeartbeatSender) -> None:
    sender.beat(is_on=True)
    assert sender._socket is not None
    assert listener._socket is not None

    assert not sender._socket.getblocking()
    assert not listener._socket.getblocking()


def test_heartbeats_arrive_in_their_order(listener: HeartbeatListener, sender: HeartbeatSender) -> None:
    for is_on in (True, False, True):
        sender.beat(is_on=is_on)

    assert list(listener.take_heartbeats()) == [True, False, True]
    assert list(listener.take_heartbeats()) == []


def test_heartbeat_without_a_guard_is_dropped_and_a_later_guard_receives_the_tenth(
    sender: HeartbeatSender,
) -> None:
    sender.beat(is_on=True)
    listener = HeartbeatListener(CAN)
    listener.open()
    try:
        for _ in range(9):
            sender.beat(is_on=True)
        assert list(listener.take_heartbeats()) == []
        for _ in range(3):
            sender.beat(is_on=True)
        assert list(listener.take_heartbeats()) == [True] * 3
    finally:
        listener.close()
    sender.beat(is_on=True)


def test_a_guard_that_does_not_keep_up_holds_nobody_up(listener: HeartbeatListener, sender: HeartbeatSender) -> None:
    for _ in range(10_000):
        sender.beat(is_on=True)
    taken = len(list(listener.take_heartbeats()))

    # The kernel queues as many as net.unix.max_dgram_qlen says, and one that is on its way.
    assert 1 <= taken <= 64
    sender.beat(is_on=False)
    rest = list(listener.take_heartbeats())
    assert rest[-1] is False


def test_a_node_that_beats_without_end_does_not_hold_the_guard_up(
    listener: HeartbeatListener, sender: HeartbeatSender
) -> None:
    sender.beat(is_on=True)
    taken = 0
    for _ in listener.take_heartbeats():
        taken += 1
        sender.beat(is_on=True)
        assert taken <= 64

    assert taken == 64


def test_a_sender_opens_one_socket_and_gives_it_back(listener: HeartbeatListener, sender: HeartbeatSender) -> None:
    sender.beat(is_on=True)
    first = sender._socket
    sender.beat(is_on=True)
    assert first is not None
    assert sender._socket is first
    sender.close()
    assert first.fileno() == -1
    sender.close()
    sender.beat(is_on=False)

    assert list(listener.take_heartbeats()) == [True, True, False]


def test_a_listener_gives_its_socket_back(listener: HeartbeatListener) -> None:
    first = listener._socket
    assert first is not None
    listener.close()
    listener.close()

    assert first.fileno() == -1


def test_unknown_datagrams_are_skipped(listener: HeartbeatListener, sender: HeartbeatSender) -> None:
    sender.beat(is_on=True)
    assert sender._socket is not None
    for word in (b"", b"\x02", b"\x01\x01", b"x" * 100):
        sender._socket.sendto(word, address_of(CAN))
    sender.beat(is_on=False)

    assert list(listener.take_heartbeats()) == [True, False]


def test_a_bus_has_one_guard(listener: HeartbeatListener) -> None:
    second = HeartbeatListener(CAN)
    with pytest.raises(GuardRunsError, match=r"^a guard of this bus already runs \(\w.*\); stop that one first$"):
        second.open()
    listener.close()
    second.open()
    second.close()
    assert list(second.take_heartbeats()) == []


def test_a_guard_may_open_again(listener: HeartbeatListener, sender: HeartbeatSender) -> None:
    sender.beat(is_on=True)
    listener.open()
    sender.beat(is_on=False)

    assert list(listener.take_heartbeats()) == [False]


def test_each_bus_has_an_address_of_its_own_that_its_name_gives() -> None:
    same = CanSettings(interface="local", channel="robot", bitrate=125_000)

    assert address_of(CanSettings(interface="local")) == address_of(same)
    assert address_of(same) != address_of(CAN)
    # A guard and a node of different releases must find each other: printf 'socketcan can0' | sha256sum
    can0 = CanSettings(interface="socketcan", channel="can0")
    assert address_of(can0) == "\0segway-ecc-guard-90541c4965ee54b0"


class Beats:
    def __init__(self) -> None:
        self.told: list[bool | str] = []

    def beat(self, *, is_on: bool) -> None:
        self.told.append(is_on)

    def close(self) -> None:
        self.told.append("close")


def test_heartbeat_after_each_exchange_with_commands_carries_armed_state() -> None:
    rig, beats = LockstepRig(500_000), Beats()
    built = build_hardware(WheelBoardSettings(), 0.01, rig, rig.bus.attach("node"))
    assert isinstance(built, Assembly)
    assert built._heartbeat is None
    robot = Assembly(rig.bus.attach("robot"), built._drives, now_ns=rig.now_ns, heartbeat=beats)
    robot.open()
    assert beats.told == []
    robot.exchange(ZERO)
    robot.exchange(None)
    assert beats.told == [False]
    robot._armed = True
    robot.exchange(ZERO)
    robot.exchange(ZERO)
    robot.disarm()
    assert beats.told == [False, True, True, False]
    robot.close()
    assert beats.told == [False, True, True, False, False, "close"]


def test_robot_on_its_own_bus_sends_heartbeats_to_the_guard_of_that_bus(listener: HeartbeatListener) -> None:
    robot = build_hardware(WheelBoardSettings(can=CAN), 0.01, RealClock())
    robot.open()
    robot.exchange(ZERO)
    robot.close()

    assert list(listener.take_heartbeats()) == [False, False]
