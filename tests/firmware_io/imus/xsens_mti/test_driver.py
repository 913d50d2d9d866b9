# SPDX-License-Identifier: MIT
import math
from types import SimpleNamespace
from typing import Any

import pytest

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.imus.xsens_mti.driver import GroupCounter, XsensMti
from segway_ecc.firmware_io.imus.xsens_mti.frames import Message
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.firmware_io.links.link import Frame

PERIOD_NS = 5_000_000
LOOP_PERIOD_S = 0.010
FRESH_NS = 30_000_000
"""Three periods of the loop, the longer one."""

COUNTER, RATE, FORCE, ERROR = 0x006, 0x032, 0x034, 0x001
LISTED = {0x001: 1, 0x002: 1, 0x005: 4, COUNTER: 2, 0x011: 4, RATE: 6, FORCE: 6, 0x051: 2}
"""What it listens to, with the length of each."""

GYRO = bytes.fromhex("0200FC000100")  # 1, -2, 0.5 rad/s at 512 counts
UPRIGHT = bytes.fromhex("0000000009CF")  # 2511 counts of 1/256 m/s2
RATES = (1.0, -2.0, 0.5)
GRAVITY = (0.0, 0.0, 9.80859375)


class Bench:
    """A driver on a link that can do nothing: whatever it tried to send would fail."""

    def __init__(self, **options: Any) -> None:
        self.now_ns = 1_000_000_000
        self.imu = XsensMti(
            SimpleNamespace(description="can0"),
            XsensMtiSettings(**options),
            LOOP_PERIOD_S,
            lambda: self.now_ns,
        )
        self.imu.start()
        self.count = 0

    def take(self, arbitration_id: int, data: bytes, *, is_extended: bool = False) -> bool:
        return self.imu.take_frame(Frame(arbitration_id, data, self.now_ns, is_extended))

    def set(self, *, counter: int | None = None, after_ns: int = PERIOD_NS) -> None:
        """A set of measurements as it comes, one period later."""
        self.now_ns += after_ns
        self.count = self.count + 1 if counter is None else counter
        assert self.take(COUNTER, (self.count % 65536).to_bytes(2, "big"))
        assert self.take(RATE, GYRO)
        assert self.take(FORCE, UPRIGHT)

    def valid(self) -> tuple[bool, bool]:
        """Of angular velocity and of acceleration."""
        valid = self.imu.read().valid
        assert valid == (valid[0],) * 3 + (valid[3],) * 3
        return valid[0], valid[3]

    def ages_ms(self) -> tuple[float, float]:
        ages = self.imu.read().ages
        assert ages == (ages[0],) * 3 + (ages[3],) * 3
        return round(ages[0] * 1e3, 6), round(ages[3] * 1e3, 6)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_its_signals_are_six_with_units(bench: Bench) -> None:
    assert bench.imu.name == "imu"
    assert dict(bench.imu.signals) == {
        **{f"imu.angular_velocity_{axis}": "rad/s" for axis in "xyz"},
        **{f"imu.linear_acceleration_{axis}": "m/s2" for axis in "xyz"},
    }


def test_before_anything_came_nothing_is_valid(bench: Bench) -> None:
    readings = bench.imu.read()
    assert readings.values == (0.0,) * 6
    assert readings.ages == (math.inf,) * 6
    assert readings.valid == (False,) * 6


def test_a_set_of_measurements_is_read(bench: Bench) -> None:
    bench.set()
    bench.now_ns += 2_000_000
    assert bench.imu.read().values == (*RATES, *GRAVITY)
    assert bench.valid() == (True, True)
    assert bench.ages_ms() == (2.0, 2.0)
    assert bench.imu.arming_failures() == []


def test_values_are_turned_into_the_axes_of_the_robot() -> None:
    bench = Bench(mounting=("+z", "-y", "+x"))
    bench.set()
    assert bench.imu.read().values == (0.5, 2.0, 1.0, 9.80859375, 0.0, 0.0)


def test_each_message_has_an_age_of_its_own(bench: Bench) -> None:
    bench.set()
    bench.now_ns += 3_000_000
    bench.take(COUNTER, b"\0\2")
    bench.take(FORCE, UPRIGHT)
    bench.now_ns += 1_000_000
    assert bench.ages_ms() == (4.0, 1.0)


@pytest.mark.parametrize(
    ("silent", "valid"), [(RATE, (False, True)), (FORCE, (True, False)), (COUNTER, (False, False))]
)
def test_what_is_missing_is_not_valid_after_five_periods(bench: Bench, silent: int, valid: tuple[bool, bool]) -> None:
    bench.set()
    sent = {COUNTER: b"\0\2", RATE: GYRO, FORCE: UPRIGHT}
    bench.now_ns += FRESH_NS * 5 // 3
    for arbitration_id, data in sent.items():
        if arbitration_id != silent:
            bench.take(arbitration_id, data)
    assert bench.valid() == (True, True)
    bench.now_ns += 1
    assert bench.valid() == valid


def test_the_period_of_a_slow_sensor_counts_instead_of_the_loops() -> None:
    bench = Bench(period_s=0.05)
    bench.set()
    bench.now_ns += 150_000_000
    assert bench.valid() == (True, True)
    bench.now_ns += 1
    assert bench.valid() == (False, False)


def test_a_group_counter_that_is_stalled_is_no_measurement(bench: Bench) -> None:
    bench.set(counter=7)
    for _ in range(10):
        bench.set(counter=7)
    assert bench.ages_ms() == (50.0, 50.0)
    assert bench.valid() == (True, True)
    bench.set(counter=7)
    assert bench.ages_ms() == (55.0, 55.0)
    assert bench.valid() == (False, False)
    assert bench.imu.arming_failures() == [
        "the IMU sends but measures nothing new: its group counter does not advance; switch it off and on"
    ]
    assert bench.imu.health["repeated"] == "11"
    bench.set(counter=8)
    assert bench.valid() == (True, True)
    assert bench.imu.arming_failures() == []
    assert (bench.imu.health["lost"], bench.imu.health["restarts"]) == ("0", "0")


def test_sets_that_are_missing_are_counted(bench: Bench) -> None:
    bench.set(counter=65534)
    bench.set(counter=65535)
    bench.set(counter=0)
    assert bench.imu.health["lost"] == "0"
    bench.set(counter=3)
    assert bench.imu.health["lost"] == "2"
    bench.set(counter=4)
    assert bench.imu.health["lost"] == "2"
    assert bench.valid() == (True, True)


def test_a_sensor_that_begins_anew_has_lost_nothing(bench: Bench) -> None:
    bench.set(counter=50_000)
    bench.set(counter=0, after_ns=2_000_000_000)
    health = bench.imu.health
    assert (health["lost"], health["restarts"]) == ("0", "1")
    assert bench.valid() == (True, True)


@pytest.mark.parametrize(
    ("ahead", "elapsed_ns", "lost", "restarts"),
    [
        (16, 0, 15, 0),
        (17, 0, 0, 1),
        (216, 100 * PERIOD_NS, 215, 0),
        (217, 100 * PERIOD_NS, 0, 1),
        (65535, PERIOD_NS, 0, 1),
    ],
)
def test_a_count_can_run_ahead_no_further_than_time_allows(
    ahead: int, elapsed_ns: int, lost: int, restarts: int
) -> None:
    counter = GroupCounter(PERIOD_NS)
    assert counter.follow(100, 1_000)
    assert counter.follow((100 + ahead) % 65536, 1_000 + elapsed_ns)
    assert (counter.lost, counter.restarts, counter.repeated) == (lost, restarts, 0)


def test_time_at_a_standstill_counts_for_the_sets_missed_meanwhile() -> None:
    counter = GroupCounter(PERIOD_NS)
    found = [
        (counter.follow(count, now_ns), counter.is_stalled)
        for count, now_ns in ((1, 0), (1, 99 * PERIOD_NS), (101, 100 * PERIOD_NS))
    ]
    assert found == [(True, False), (False, True), (True, False)]
    assert (counter.lost, counter.restarts) == (99, 0)


@pytest.mark.parametrize(
    ("sent", "text"),
    [
        ((), "group counter and no rate of turn and no acceleration"),
        ((COUNTER,), "rate of turn and no acceleration"),
        ((COUNTER, FORCE), "rate of turn"),
        ((RATE, FORCE), "group counter"),
    ],
)
def test_missing_messages_are_named(bench: Bench, sent: tuple[int, ...], text: str) -> None:
    for arbitration_id in sent:
        bench.take(arbitration_id, bytes(LISTED[arbitration_id]))
    assert bench.imu.arming_failures() == [
        f"the IMU sends no {text} on can0; is it powered, on this bus at its bit rate, and set to send them on CAN?"
    ]


def test_an_error_stays_an_arming_failure_until_the_sensor_began_anew(bench: Bench) -> None:
    bench.set(counter=1000)
    assert bench.take(ERROR, b"\1")
    for _ in range(20):
        bench.set()
    overflow = (
        "the IMU reported error 1, its output buffer was full: let it send less, or make the bus faster; "
        "switch it off and on to clear it"
    )
    assert bench.imu.arming_failures() == [overflow]
    assert bench.imu.health["error"] == "1"
    assert bench.valid() == (True, True)
    bench.set(counter=0, after_ns=1_000_000_000)
    assert bench.imu.arming_failures() == []
    assert bench.imu.health["error"] == "none"


def test_error_without_a_name_is_reported_by_number(bench: Bench) -> None:
    bench.set()
    bench.take(ERROR, b"\x2a")
    assert bench.imu.arming_failures() == ["the IMU reported error 42; switch it off and on to clear it"]


def test_a_warning_is_counted_and_is_no_arming_failure(bench: Bench) -> None:
    bench.set()
    assert bench.take(0x002, b"\1")
    assert bench.imu.arming_failures() == []
    assert bench.imu.health["warnings"] == "1"


@pytest.mark.parametrize(("unit", "period"), [("100us", "0.005000"), ("us", "0.000050")])
def test_health_has_the_sample_period_by_the_sensor_clock(unit: str, period: str) -> None:
    bench = Bench(sample_time_unit=unit)
    bench.take(0x005, (2**32 - 20).to_bytes(4, "big"))
    assert bench.imu.health["sample_period_s"] == "0.000000"
    bench.take(0x005, (30).to_bytes(4, "big"))
    assert bench.imu.health["sample_period_s"] == period


def test_health_has_status_and_temperature_once_received(bench: Bench) -> None:
    assert not {"status_word", "temperature_c"} & set(bench.imu.health)
    bench.take(0x011, bytes.fromhex("00C00003"))
    bench.take(0x051, bytes.fromhex("1980"))
    assert bench.imu.health["status_word"] == "0x00C00003"
    assert bench.imu.health["temperature_c"] == "25.5"


def test_what_is_refused_is_counted_by_cause_and_changes_nothing(bench: Bench) -> None:
    bench.set()
    bench.now_ns += PERIOD_NS
    before = bench.imu.read()
    assert not bench.take(RATE, GYRO[:5])
    assert not bench.take(RATE, bytes.fromhex("7FFF00000000"))
    assert not bench.take(COUNTER, b"\0\2\0")
    assert bench.imu.read() == before
    assert (bench.imu.health["refused.length"], bench.imu.health["refused.range"]) == ("2", "1")


def test_it_listens_to_its_own_messages_only(bench: Bench) -> None:
    assert set(bench.imu.listens_to) == {FrameKey(arbitration_id) for arbitration_id in LISTED}
    bench.set()
    before, health = bench.imu.read(), dict(bench.imu.health)
    for arbitration_id in range(2048):
        for length in range(9):
            if LISTED.get(arbitration_id) != length:
                assert not bench.take(arbitration_id, bytes(length))
    for arbitration_id, length in LISTED.items():
        assert not bench.take(arbitration_id, bytes(length), is_extended=True)
    assert bench.imu.read() == before
    refused = {"refused.length": str(8 * len(LISTED))}
    assert dict(bench.imu.health) == health | refused


def test_other_ids_are_listened_to_where_the_sensor_is_set_so() -> None:
    bench = Bench(ids={Message.RATE_OF_TURN: 0x12332}, extended_ids=True)
    assert FrameKey(0x12332, is_extended=True) in bench.imu.listens_to
    assert FrameKey(FORCE, is_extended=True) in bench.imu.listens_to
    assert not bench.take(RATE, GYRO, is_extended=True)
    assert not bench.take(0x12332, GYRO)
    assert bench.take(0x12332, GYRO, is_extended=True)
    assert bench.imu.read().values[:3] == RATES
