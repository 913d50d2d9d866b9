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


@pytest.mark.parametrize("text", ["{}", "{type: xsens_mti, bears_fd: false}"])
def test_on_a_bus_of_can_fd_it_is_refused_in_a_line_that_has_the_remedies(text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        imu(f"  can: {{fd: true}}\n  external_imu: {text}")
    assert str(caught.value) == (
        "bench.yaml: hardware.external_imu: an MTi 600 is on classic CAN, and destroys the frames of CAN FD on the "
        "drives' bus; take an IMU on a line of its own (type: icm42688_bridge), or keep those frames from it by a "
        "gateway or transceiver and add bears_fd: true"
    )


def test_it_is_taken_there_where_those_frames_are_kept_from_it_and_on_classic_can() -> None:
    found = imu("  can: {fd: true}\n  external_imu: {bears_fd: true}")
    assert found is not None
    assert found.bears_fd
    assert imu("  can: {fd: false}\n  external_imu: {}") is not None


def test_an_imu_on_a_line_of_its_own_does_not_mind_can_fd() -> None:
    own = "{type: icm42688_bridge, serial: {port: /dev/imu}}"
    assert imu(f"  can: {{fd: true}}\n  external_imu: {own}") is not None


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
