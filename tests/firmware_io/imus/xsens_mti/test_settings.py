# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.imus.xsens_mti.frames import Message
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.node.config import decode_robot
from segway_ecc.node.errors import ConfigurationError

ROBOT = """
name: bench
model: {source: "segway_ecc.node.models.cart:CartController"}
wiring: {}
hardware:
  type: wheel_board
"""


def imu(text: str) -> XsensMtiSettings | None:
    hardware = decode_robot(f"{ROBOT}{text}", "bench.yaml").hardware
    return getattr(hardware, "external_imu", None)


def test_robot_has_no_imu_by_default() -> None:
    assert imu("") is None


def test_imu_settings_default_to_the_factory_ones() -> None:
    found = imu("  external_imu: {}")
    assert found is not None
    assert (found.period_s, found.mounting, found.sample_time_tick_s) == (0.005, ("+x", "+y", "+z"), 1e-4)
    assert found.key(Message.RATE_OF_TURN) == FrameKey(0x032, is_extended=False)
    assert found.rotation.to_robot((1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)


def test_everything_can_be_set() -> None:
    found = imu("""
  external_imu:
    period_s: 0.0025
    ids: {rate_of_turn: 0x12345, acceleration: 0x1FFFFFFF}
    extended_ids: true
    mounting: [+y, -x, +z]
    sample_time_unit: us
""")
    assert found is not None
    assert (found.period_s, found.sample_time_tick_s) == (0.0025, 1e-6)
    assert found.key(Message.RATE_OF_TURN) == FrameKey(0x12345, is_extended=True)
    assert found.key(Message.ACCELERATION) == FrameKey(0x1FFFFFFF, is_extended=True)
    assert found.key(Message.GROUP_COUNTER) == FrameKey(0x006, is_extended=True)
    assert found.rotation.to_robot((1.0, 2.0, 3.0)) == (2.0, -1.0, 3.0)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{period_s: 0.0009}", "0.001"),
        ("{period_s: 0.11}", "0.1"),
        ("{period_s: .nan}", "hardware.external_imu.period_s"),
        ("{mounting: [+x, +y]}", "length 3"),
        ("{mounting: [+x, +y, up]}", "hardware.external_imu.mounting.2"),
        ("{mounting: [+x, +y, -z]}", "mounting +x, +y, -z is not right-handed"),
        ("{mounting: [+x, +x, +z]}", "mounting +x, +x, +z is not right-handed"),
        ("{ids: {rate_of_turn: 0x800}}", "id 0x800 of rate_of_turn needs extended_ids: true"),
        ("{ids: {rate_of_turn: -1}}", "hardware.external_imu.ids"),
        ("{extended_ids: true, ids: {rate_of_turn: 0x20000000}}", "hardware.external_imu.ids"),
        ("{ids: {rate_of_turn: 0x034}}", "rate_of_turn and acceleration both have id 0x34"),
        ("{ids: {gyro: 0x100}}", "gyro"),
        ("{sample_time_unit: ms}", "100us, us"),
        ("{serial: /dev/ttyS0}", "serial"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(text: str, problem: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        imu(f"  external_imu: {text}")
    assert problem in str(caught.value)
    assert "hardware.external_imu" in str(caught.value)
