# SPDX-License-Identifier: MIT
"""Cycles compared to the last bit."""

import math
import struct
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.replay.replay import Difference, differences, same
from segway_ecc.node.safety.modes import Mode

LAYOUT = CycleLayout(
    robot="r",
    published=("odometry.x",),
    sensors=(),
    inputs=("In",),
    outputs=("A", "B"),
    commands=("left.voltage", "right.voltage"),
    odometry_frame="",
    base_frame="",
    imu_frame="",
    joints=("l", "r"),
)
RECORD = CycleRecord(
    3, 0, Mode.ARMED, 0, Sensors(), Setpoint(0.5, 0.0), (1.0,), (2.0, 3.0), (4.0, 5.0), (6.0,), (0,) * 5
)
OTHER_NAN = struct.unpack("d", struct.pack("Q", 0x7FF8000000000001))[0]


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ((), (), True),
        ((1.0, 2.0), (1.0, 2.0), True),
        ((1.0,), (math.nextafter(1.0, 2.0),), False),
        ((0.0,), (-0.0,), False),
        ((math.nan,), (OTHER_NAN,), True),
        ((math.nan, 1.0), (OTHER_NAN, 1.5), False),
        ((math.nan,), (1.0,), False),
        ((math.inf,), (-math.inf,), False),
        ((1.0,), (1.0, 2.0), False),
    ],
)
def test_numbers_are_the_same_bit_for_bit(a: tuple[float, ...], b: tuple[float, ...], expected: bool) -> None:  # noqa: FBT001 - a column of the table
    assert same(a, b) is expected
    assert same(b, a) is expected


def test_identical_cycles_have_no_differences() -> None:
    assert list(differences(LAYOUT, RECORD, replace(RECORD, durations_ns=(9,) * 5))) == []


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda r: replace(r, commands=(4.0, 5.25)), ("command right.voltage", "5.0", "5.25")),
        (lambda r: replace(r, u=(1.5,)), ("model input In", "1.0", "1.5")),
        (lambda r: replace(r, y=(math.nan, 3.0)), ("model output A", "2.0", "nan")),
        (lambda r: replace(r, setpoint=Setpoint(0.5, 0.1)), ("set-point angular_velocity", "0.0", "0.1")),
        (lambda r: replace(r, published=(7.0,)), ("published odometry.x", "6.0", "7.0")),
        (lambda r: replace(r, mode=Mode.HOLD), ("mode", "ARMED", "HOLD")),
    ],
)
def test_every_part_is_compared(change: Callable[[CycleRecord], CycleRecord], expected: tuple[str, str, str]) -> None:
    assert list(differences(LAYOUT, RECORD, change(RECORD))) == [expected]


def test_commands_come_first_and_every_difference_is_reported() -> None:
    other = replace(RECORD, y=(0.0, 0.0), commands=(0.0, 5.0), mode=Mode.FAULT)

    assert [port for port, _, _ in differences(LAYOUT, RECORD, other)] == [
        "command left.voltage",
        "model output A",
        "model output B",
        "mode",
    ]


def test_a_difference_is_reported_in_one_line() -> None:
    assert str(Difference(12, 0.06, "command left.voltage", "1.25", "1.26")) == (
        "cycle 12 (t = 0.060 s): command left.voltage 1.25 was recorded, 1.26 is computed"
    )
