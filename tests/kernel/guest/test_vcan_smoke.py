# SPDX-License-Identifier: MIT
"""The kernel's own CAN works in the guest: every other test here stands on that."""

import socket
from collections.abc import Iterator

import can
import pytest

FRAME = can.Message(arbitration_id=0x123, data=bytes(range(8)), is_extended_id=False)
QUIET_S = 0.2


@pytest.fixture
def sender() -> Iterator[can.BusABC]:
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        yield bus


def test_both_interfaces_are_there() -> None:
    names = {name for _, name in socket.if_nameindex()}

    assert {"vcan0", "vcan1"} <= names


def test_a_frame_arrives_as_it_was_sent(sender: can.BusABC) -> None:
    with can.Bus(interface="socketcan", channel="vcan0") as receiver:
        sender.send(FRAME)
        received = receiver.recv(timeout=2.0)

    assert received is not None
    assert received.equals(FRAME, timestamp_delta=None, check_channel=False, check_direction=False)
    assert not received.is_error_frame


def test_the_sender_does_not_hear_itself(sender: can.BusABC) -> None:
    with can.Bus(interface="socketcan", channel="vcan0") as witness:
        sender.send(FRAME)

        assert witness.recv(timeout=2.0) is not None
        assert sender.recv(timeout=QUIET_S) is None


def test_the_interfaces_are_separate(sender: can.BusABC) -> None:
    with can.Bus(interface="socketcan", channel="vcan1") as elsewhere:
        sender.send(FRAME)

        assert elsewhere.recv(timeout=QUIET_S) is None
