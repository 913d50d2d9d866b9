# SPDX-License-Identifier: MIT
"""Reading settings of 0.6 by endpoint, in the loop, and what a serial line hands on of 0.5."""

import math
import struct
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.odrive.messages import Version
from segway_ecc.firmware_io.drives.odrive.own_settings import OwnSettings
from segway_ecc.firmware_io.drives.odrive.sdo import SdoReading, SerialReading, serial_answer, settings_reading
from segway_ecc.firmware_io.drives.odrive.setting_names import OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

Configure = Callable[..., OdriveSettings]
MS = 1_000_000
IDS = {"axis0.controller.config.vel_limit": 388, "axis0.config.enable_watchdog": 201}
ENDPOINTS = {"firmware": "0.6.10", "hardware": "4.4.58", "ids": IDS}
VERSION = Version(2, 4, 4, 58, 0, 6, 10, 0)
ASK_LIMIT, ASK_WATCHDOG = Frame(0x004, bytes.fromhex("00840100")), Frame(0x004, bytes.fromhex("00c90000"))
LIMIT, WATCHDOG = bytes.fromhex("0084010000002041"), bytes.fromhex("00c9000001")


class Bench:
    def __init__(self, configure: Configure) -> None:
        settings = configure(firmware="0.6", endpoints=ENDPOINTS)
        self.own = OwnSettings("left", settings)
        reading = settings_reading("left", settings, self.own)
        assert isinstance(reading, SdoReading)
        self.reading = reading


@pytest.fixture
def bench(configure: Configure) -> Bench:
    return Bench(configure)


def test_one_is_asked_for_after_the_other_once_the_drive_is_what_the_numbers_are_of(bench: Bench) -> None:
    reading = bench.reading
    assert reading.next_request(0) is None
    assert reading.waits(0)
    reading.note_version(VERSION)
    assert reading.next_request(0) == ASK_LIMIT
    assert reading.next_request(10 * MS) is None
    reading.take(LIMIT)
    assert reading.waits(10 * MS)
    assert reading.next_request(10 * MS) == ASK_WATCHDOG
    reading.take(WATCHDOG)
    assert not reading.waits(20 * MS)
    assert reading.arming_failures() == []
    assert bench.own.values == {OwnSetting.VELOCITY_LIMIT: 10.0, OwnSetting.WATCHDOG: 1.0}


def test_all_are_read_again_after_two_seconds(bench: Bench) -> None:
    bench.reading.note_version(VERSION)
    for data in (LIMIT, WATCHDOG):
        assert bench.reading.next_request(0) is not None
        bench.reading.take(data)
    asked = [moment for moment in range(0, 3_000, 10) if bench.reading.next_request(moment * MS) is not None]
    assert asked[0] == 2_000


def test_what_is_not_answered_is_asked_for_three_times_and_refuses_arming(bench: Bench) -> None:
    bench.reading.note_version(VERSION)
    asked = [(at, frame) for at in range(0, 400, 10) if (frame := bench.reading.next_request(at * MS)) is not None]
    assert asked[:3] == [(0, ASK_LIMIT), (50, ASK_LIMIT), (100, ASK_LIMIT)]
    assert [frame for _, frame in asked[3:]] == [ASK_WATCHDOG] * 3
    assert not bench.reading.waits(400 * MS)
    first, second = bench.reading.arming_failures()
    assert "does not answer for axis0.controller.config.vel_limit at endpoint 388" in first
    assert "axis0.config.enable_watchdog at endpoint 201" in second


@pytest.mark.parametrize("version", [VERSION._replace(firmware_revision=11), VERSION._replace(hardware_variant=50)])
def test_numbers_of_another_release_or_hardware_are_not_used(bench: Bench, version: Version) -> None:
    bench.reading.note_version(version)
    assert bench.reading.next_request(0) is None
    assert not bench.reading.waits(0)
    (failure,) = bench.reading.arming_failures()
    assert "the endpoints in the robot file are of 0.6.10 on hardware 4.4.58" in failure


def test_after_a_restart_all_begins_anew(bench: Bench) -> None:
    bench.reading.note_version(VERSION)
    bench.reading.next_request(0)
    bench.reading.take(LIMIT)
    bench.reading.reset()
    assert bench.own.values == {}
    assert bench.reading.next_request(10**9) is None
    bench.reading.note_version(VERSION)
    assert bench.reading.next_request(10**9) == ASK_LIMIT


@pytest.mark.parametrize(
    "data", ["", "00840100", "00840100002041", "0184010000002041", "0084010100002041", "00c9000001"]
)
def test_what_is_no_answer_to_the_question_is_refused(bench: Bench, data: str) -> None:
    bench.reading.note_version(VERSION)
    bench.reading.next_request(0)
    with pytest.raises(FrameRefusedError):
        bench.reading.take(bytes.fromhex(data))
    assert bench.own.values == {}
    bench.reading.take(LIMIT)


def test_an_answer_that_nobody_asked_for_is_refused(bench: Bench) -> None:
    bench.reading.note_version(VERSION)
    with pytest.raises(FrameRefusedError):
        bench.reading.take(LIMIT)


@given(st.binary(max_size=8))
def test_whatever_comes_is_taken_or_refused(configure: Configure, data: bytes) -> None:
    settings = configure(serial={"port": "/dev/x", "baudrate": 921_600})
    for reading in (Bench(configure).reading, SerialReading(OwnSettings("left", settings))):
        reading.note_version(VERSION)
        reading.next_request(0)
        try:
            reading.take(data)
        except FrameRefusedError:
            continue


def test_settings_of_a_serial_line_are_taken_by_their_number(configure: Configure) -> None:
    settings = configure(serial={"port": "/dev/x", "baudrate": 921_600})
    own = OwnSettings("left", settings)
    reading = settings_reading("left", settings, own)
    assert isinstance(reading, SerialReading)
    for setting in OwnSetting:
        assert reading.waits(0)
        reading.take(serial_answer(0, setting, math.nan if setting is OwnSetting.BRAKE_RESISTOR else 1.5).data)
    assert not reading.waits(0)
    assert own.unread == {OwnSetting.BRAKE_RESISTOR}
    assert set(own.values) == set(OwnSetting) - own.unread
    reading.reset()
    assert reading.waits(0)
    with pytest.raises(FrameRefusedError):
        reading.take(struct.pack("<BHBf", 0, len(OwnSetting), 0, 1.0))


def test_a_serial_line_that_does_not_answer_is_not_waited_for_longer_than_five_seconds(configure: Configure) -> None:
    reading = SerialReading(OwnSettings("left", configure()))
    assert reading.next_request(10**9) is None
    assert reading.waits(10**9 + 4_999 * MS)
    assert not reading.waits(10**9 + 5_000 * MS)
    assert reading.arming_failures() == []


def test_without_a_line_that_allows_it_nothing_is_read(configure: Configure) -> None:
    settings = configure()
    assert settings_reading("left", settings, OwnSettings("left", settings)) is None
