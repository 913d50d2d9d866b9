# SPDX-License-Identifier: MIT
"""What a person sees."""

import io
import socket

import msgspec
import pytest
from rich.console import Console

from segway_ecc.hil.play.channel import Key, Snapshot
from segway_ecc.hil.play.terminal import picture, pressed

WELL = Snapshot(
    robot="segway",
    mode="ARMED",
    reason="asked to arm",
    linear=0.25,
    angular=-0.5,
    wanted_linear=0.3,
    wanted_angular=-0.6,
    pitch=0.1,
    battery={"board.bus_voltage_v": "35.900"},
    posture="balancing",
    links={"can": "active", "serial": "active"},
    line="can",
    timing={"rate_hz": "200.0000", "late": "0"},
    messages=["one", "two"],
    has_ros=True,
    guard_runs=True,
    can_be_pushed=True,
    is_bus_broken=False,
)


def shown(snapshot: Snapshot | None) -> list[str]:
    console = Console(file=io.StringIO(), width=120, record=True)
    console.print(picture(snapshot))
    return [line.strip("│ ") for line in console.export_text().splitlines()]


def test_everything_is_reported_in_the_units_that_people_use() -> None:
    lines = shown(WELL)

    assert "segway-ecc play segway" in lines[0]
    assert lines[1:-1] == [
        "mode       ARMED  asked to arm",
        "tilt         +5.73 deg",  # 0.1 rad
        "posture    balancing",
        "velocity    +0.250 m/s   -0.500 rad/s",
        "set-point   +0.300 m/s   -0.600 rad/s",
        "battery    board 35.900 V",
        "links      can active   serial active   commands go over can",
        "loop       rate_hz 200.0000   late 0",
        "ROS        cmd_vel drives too",
        "guard      runs",
        "",
        "one",
        "two",
        "",
        "up, w ahead   down, s back   left, a left   right, d right   x rest   Esc, Space STOP",
        "m arm   n disarm   c clear fault   u stand up   j sit down   p push   b cut the bus   q quit",
    ]


def test_what_is_absent_is_not_shown() -> None:
    bare = msgspec.structs.replace(
        WELL,
        pitch=None,
        posture=None,
        line=None,
        linear=None,
        battery={},
        has_ros=False,
        guard_runs=False,
        can_be_pushed=False,
    )
    lines = shown(bare)

    assert not any(line.startswith("tilt") for line in lines)
    assert "velocity         - m/s   -0.500 rad/s" in lines
    assert "battery    -" in lines
    assert "ROS        not here" in lines
    assert "guard      has ended" in lines
    assert not any("p push" in line or "posture" in line or "u stand" in line or "j sit" in line for line in lines)
    assert "links      can active   serial active" in lines


def test_a_bus_broken_by_hand_can_be_mended() -> None:
    lines = shown(msgspec.structs.replace(WELL, is_bus_broken=True))

    assert "links      can active   serial active   commands go over can   (bus broken by hand)" in lines
    assert "r repair" in lines[-2]
    assert "b cut the bus" not in lines[-2]


def test_before_the_first_snapshot_it_waits() -> None:
    assert "the robot starts ..." in shown(None)


@pytest.mark.parametrize(
    ("pieces", "keys"),
    [
        ([b"\x1b[A"], [Key.UP]),
        ([b"\x1b", b"[A"], [Key.UP]),  # a slow line
        ([b"\x1bO", b"A"], [Key.UP]),
        ([b"\x1b"], [Key.STOP]),
        ([b" "], [Key.STOP]),
        ([b"w", b"\x1b"], [Key.UP]),  # the next is read the next time
    ],
)
def test_a_key_that_comes_in_two_pieces_is_one(pieces: list[bytes], keys: list[Key]) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)  # a read takes one piece
    with ours, theirs:
        for piece in pieces:
            theirs.send(piece)
        assert pressed(ours.fileno()) == keys


def test_a_terminal_that_is_gone_has_no_keys() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        theirs.close()
        assert pressed(ours.fileno()) is None
