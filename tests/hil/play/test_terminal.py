# SPDX-License-Identifier: MIT
"""What a person sees."""

import io

import msgspec
from rich.console import Console

from segway_ecc.hil.play.channel import Snapshot
from segway_ecc.hil.play.terminal import picture

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
        "arrows drive   space rest   a arm   d disarm   s STOP   c clear fault",
        "u stand up, sit down   p push   b break the bus   q quit",
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
    assert not any("p push" in line or "posture" in line or "u stand" in line for line in lines)
    assert "links      can active   serial active" in lines


def test_a_bus_broken_by_hand_can_be_mended() -> None:
    lines = shown(msgspec.structs.replace(WELL, is_bus_broken=True))

    assert "links      can active   serial active   commands go over can   (bus broken by hand)" in lines
    assert "b restore the bus" in lines[-2]


def test_before_the_first_snapshot_it_waits() -> None:
    assert "the robot starts ..." in shown(None)
