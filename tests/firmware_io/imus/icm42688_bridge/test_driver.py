# SPDX-License-Identifier: MIT
"""The codec and the driver of the bridge, against packets put together by hand."""

import math
import random
import struct

import pytest

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.imus.family import imu_family
from segway_ecc.firmware_io.imus.icm42688_bridge.driver import Icm42688
from segway_ecc.firmware_io.imus.icm42688_bridge.frames import BridgeCodec, read_measurement
from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal, crc16_xmodem
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import LOST, SerialCodec
from segway_ecc.firmware_io.links.settings import PortSettings

MS = 1_000_000
SETTINGS = Icm42688BridgeSettings(serial=PortSettings(port="/dev/imu", baudrate=460_800))


def packet(count: int, *values: int) -> bytes:
    body = struct.pack("<H7h", count, *values)
    return b"\xa5\x5a" + body + crc16_xmodem(body).to_bytes(2, "big")


class Clock(RealClock):
    """Stands still."""

    time_ns = 1_000 * MS

    def now_ns(self) -> int:
        return self.time_ns


class Bench:
    """A driver behind the codec."""

    def __init__(self, settings: Icm42688BridgeSettings = SETTINGS) -> None:
        self.clock = Clock()
        self.codec = BridgeCodec()
        self.imu = Icm42688(settings, 0.01, self.clock)

    def feed(self, data: bytes) -> list[bool]:
        return [self.imu.take_frame(frame) for frame in self.codec.decode(data, self.clock.time_ns)]


def test_a_packet_by_hand() -> None:
    """1 deg/s is 16.384 and 1 g 2048 of the sensor's counts; 132.48 is one degree above 25."""
    bench = Bench()
    assert bench.feed(packet(7, 1_638, -164, 0, 0, 1_024, 2_048, 265)) == [True]
    readings = bench.imu.read()
    rates, forces = readings.values[:3], readings.values[3:]
    assert rates == pytest.approx((math.radians(100), math.radians(-10), 0.0), rel=1e-3)
    assert forces == pytest.approx((0.0, 4.903325, 9.80665))
    assert readings.valid == (True,) * 6
    assert bench.imu.health["temperature_c"] == "27.0"
    assert next(iter(bench.imu.signals)) == "imu.angular_velocity_x"


def test_the_mounting_turns_both() -> None:
    settings = Icm42688BridgeSettings(serial=PortSettings(port="/dev/imu"), mounting=("+y", "-x", "+z"))
    bench = Bench(settings)
    bench.feed(packet(0, 100, 200, 300, 1, 2, 3, 0))
    values = bench.imu.read().values
    assert values[0] == pytest.approx(2 * -values[1])
    assert values[3] == pytest.approx(2 * -values[4])


def test_silence_is_stale_after_three_periods_of_the_loop_and_refuses_arming() -> None:
    bench = Bench()
    (failure,) = bench.imu.arming_failures()
    assert failure.startswith("the IMU sends nothing intact on serial /dev/imu; is its bridge powered")
    bench.feed(packet(0, 0, 0, 0, 0, 0, 2_048, 0))
    assert bench.imu.arming_failures() == []
    bench.clock.time_ns += 30 * MS
    assert all(bench.imu.read().valid)
    bench.clock.time_ns += 1 * MS
    assert not any(bench.imu.read().valid)


def test_what_is_no_new_measurement_is_refused_and_counted() -> None:
    bench = Bench()
    good = packet(3, 1, 2, 3, 4, 5, 6, 0)
    assert bench.feed(good + good) == [True, False]
    assert bench.feed(packet(4, 32_767, 0, 0, 0, 0, 0, 0)) == [False]
    assert bench.feed(packet(5, 0, 0, 0, 0, -32_768, 0, 0)) == [False]
    health = bench.imu.health
    assert (health["refused.counter"], health["refused.range"]) == ("1", "2")
    with pytest.raises(FrameRefusedError) as caught:
        read_measurement(bytes(5))
    assert caught.value.refusal is Refusal.LENGTH
    assert not bench.imu.take_frame(Frame(0, bytes(3)))


def test_packets_are_found_in_pieces_after_garbage_and_what_is_missing_is_counted() -> None:
    codec, chance = BridgeCodec(), random.Random(5)  # noqa: S311 - repeatable, and no secret
    data = b"".join(chance.randbytes(chance.randrange(9)) + packet(n, 1, 2, 3, 4, 5, 6, n) for n in range(0, 40, 2))
    frames = [frame for at in range(0, len(data), 7) for frame in codec.decode(data[at : at + 7], 0)]
    assert [struct.unpack("<H", frame.data[:2])[0] for frame in frames] == list(range(0, 40, 2))
    assert codec.refused[LOST] == 19
    assert codec.refused["garbage"] > 0
    broken = bytearray(packet(40, 1, 2, 3, 4, 5, 6, 7))
    broken[5] ^= 1
    assert codec.decode(bytes(broken), 0) == []
    assert codec.refused[Refusal.CRC] == 1
    codec.decode(bytes(broken[:10]), 0)
    codec.reset()
    assert len(codec.decode(packet(9_000, 1, 2, 3, 4, 5, 6, 7), 0)) == 1
    assert codec.refused[LOST] == 19, "after an opening the first count is the first"


def test_nothing_is_sent_to_it() -> None:
    bench = Bench()
    bench.imu.start()
    codec: SerialCodec = bench.codec
    assert codec.encode(Frame(1, b"")) is None
    assert codec.request() == b""


def test_it_is_found_by_its_name() -> None:
    family = imu_family("icm42688_bridge")
    assert family.settings is Icm42688BridgeSettings
    assert family.serial_codec is not None
    assert isinstance(family.serial_codec(), BridgeCodec)
