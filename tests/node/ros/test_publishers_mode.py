# SPDX-License-Identifier: MIT
"""What is published on the topic `mode`: message by message, in a node that only remembers."""

from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from segway_ecc.deploy.station.robot_messages import decode_mode
from segway_ecc.node.cycle.interfaces import Heartbeat, Report
from segway_ecc.node.ros.publishers import make_mode_publisher
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture

pytestmark = pytest.mark.ros

STAMP_NS = 1_700_000_000_000_000_000
MS = 1_000_000
ARMED = Report(
    STAMP_NS,
    Mode.ARMED,
    (),
    None,
    reason="asked to arm",
    cycle=7,
    drives="on",
    is_zero=False,
    heartbeat_age_ns=10**18,
    set_values=(7.0, 1.0),
)


class Listener:
    """Receives a robot's mode, as plain values."""

    def __init__(self, *, stand: int | None = 1) -> None:
        self.topics: list[tuple[str, str, int]] = []
        self.received: list[dict[str, str]] = []
        self.messages: list[Any] = []
        self.publish = make_mode_publisher(self, "alice", stand=stand).publish

    def create_publisher(self, kind: type, topic: str, depth: int) -> SimpleNamespace:
        self.topics.append((kind.__name__, topic, depth))
        return SimpleNamespace(publish=self.receive)

    def receive(self, message: Any) -> None:
        self.messages.append(message)
        self.received.append({pair.key: pair.value for pair in message.values})
        self.head = (message.level, message.name, message.message, message.hardware_id)


@pytest.fixture
def listener() -> Listener:
    return Listener()


def test_every_field_is_published_as_text(listener: Listener) -> None:
    listener.publish(ARMED)
    assert listener.topics == [("DiagnosticStatus", "mode", 10)]
    assert listener.head == (b"\0", "alice: mode", "ARMED: asked to arm", "alice")
    assert listener.received == [
        {
            "mode": "ARMED",
            "reason": "asked to arm",
            "cycle": "7",
            "drives": "on",
            "zero": "false",
            "heartbeat": "",
            "heartbeat_age_ms": "",
            "introduced": "",
            "stand": "1.0",
            "posture": "",
        }
    ]


def test_a_heartbeat_is_echoed_with_its_age(listener: Listener) -> None:
    listener.publish(replace(ARMED, heartbeat=Heartbeat("base 1", 123_456_789_012), heartbeat_age_ns=12_345_678))
    assert listener.received[0]["heartbeat"] == "base 1 123456789012"
    assert listener.received[0]["heartbeat_age_ms"] == "12.346"


@pytest.mark.parametrize(
    ("mode", "level"), [(Mode.DISARMED, b"\0"), (Mode.ARMED, b"\0"), (Mode.HOLD, b"\1"), (Mode.FAULT, b"\2")]
)
def test_the_level_is_that_of_the_diagnostics(listener: Listener, mode: Mode, level: bytes) -> None:
    listener.publish(replace(ARMED, mode=mode))
    assert listener.head[0] == level


def test_a_robot_that_cannot_stand_publishes_no_stand_value() -> None:
    listener = Listener(stand=None)
    listener.publish(ARMED)
    assert listener.received[0]["stand"] == ""


def test_the_posture_is_published_beside_the_mode(listener: Listener) -> None:
    listener.publish(replace(ARMED, mode=Mode.FAULT, posture=Posture.FALLEN, reason="it leans"))
    assert listener.received[0]["posture"] == "FALLEN"
    assert listener.head[2] == "FAULT, FALLEN: it leans"
    received = decode_mode(listener.head[1], listener.received[0])
    assert received is not None
    assert received.posture is Posture.FALLEN


@pytest.mark.parametrize(
    "change",
    [
        {"mode": Mode.HOLD},
        {"reason": "set-points arrive again"},
        {"drives": "off"},
        {"drives": "unconfirmed"},
        {"is_zero": True},
        {"set_values": (7.0, 0.0)},
        {"posture": Posture.BALANCING},
    ],
)
def test_a_change_is_published_at_once_and_once(listener: Listener, change: dict[str, Any]) -> None:
    listener.publish(ARMED)
    for cycle in (1, 2, 3):
        listener.publish(replace(ARMED, stamp_ns=STAMP_NS + cycle * 5 * MS, **change))
    assert len(listener.received) == 2
    listener.publish(replace(ARMED, stamp_ns=STAMP_NS + 20 * MS))
    assert len(listener.received) == 3, "and back"


def test_values_that_change_every_cycle_are_published_ten_times_a_second(listener: Listener) -> None:
    for cycle in range(600):
        listener.publish(
            replace(
                ARMED,
                stamp_ns=STAMP_NS + cycle * 5 * MS,
                cycle=cycle,
                values=(float(cycle),),
                set_values=(float(cycle), 1.0),
                heartbeat=Heartbeat("base", cycle),
                heartbeat_age_ns=cycle,
            )
        )
    assert [status["cycle"] for status in listener.received] == [str(cycle) for cycle in range(0, 600, 20)]


def test_a_clock_that_was_set_back_delays_nothing(listener: Listener) -> None:
    listener.publish(ARMED)
    for cycle in range(40):
        listener.publish(replace(ARMED, stamp_ns=STAMP_NS - 3600 * 10**9 + cycle * 5 * MS))
    assert len(listener.received) == 3


def test_one_message_is_made(listener: Listener) -> None:
    for cycle in range(5):
        listener.publish(replace(ARMED, stamp_ns=STAMP_NS + cycle * 100 * MS, cycle=cycle))
    assert len(listener.messages) == 5
    assert len({id(message) for message in listener.messages}) == 1


def test_the_base_station_decodes_the_robots_mode(listener: Listener) -> None:
    fault = replace(
        ARMED,
        mode=Mode.FAULT,
        reason="stop was pressed",
        drives="off",
        is_zero=True,
        heartbeat=Heartbeat("base 1", 42),
        heartbeat_age_ns=5 * MS,
        is_introduced=True,
    )
    listener.publish(fault)
    received = decode_mode(listener.head[1], listener.received[0])
    assert received is not None
    assert received.is_stopped
    listener.publish(replace(fault, drives="unconfirmed"))
    unconfirmed = decode_mode(listener.head[1], listener.received[1])
    assert unconfirmed == received._replace(drives="unconfirmed")
    assert not unconfirmed.is_stopped
    assert received == ("alice", Mode.FAULT, "stop was pressed", "off", True, "base 1", 42, 5 * MS, True, None, False)
