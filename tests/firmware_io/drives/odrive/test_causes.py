# SPDX-License-Identifier: MIT
import contextlib
import struct
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.causes import (
    CONTROLLER_ERRORS,
    ENCODER_ERRORS,
    MOTOR_ERRORS,
    ErrorCauses,
    causes_of,
)
from segway_ecc.firmware_io.drives.odrive.frames import Firmware, Message, decode
from segway_ecc.firmware_io.integrity import FrameRefusedError
from tests.fuzzing import fuzzed

MS = 1_000_000


@pytest.mark.parametrize(
    ("message", "start"),
    [
        (m.MotorError(0x80), "motor MODULATION_MAGNITUDE (the supply's voltage"),
        (m.MotorError(0x800000000), "motor UNBALANCED_PHASES"),
        (m.MotorError(0x4000), "motor DC_BUS_OVER_REGEN_CURRENT (set config.dc_max_negative_current"),
        (m.EncoderError(0x4), "encoder NO_RESPONSE (see the encoder's cable)"),
        (m.EncoderError(0x400), "encoder 0x400"),
        (m.ControllerError(0x1), "controller OVERSPEED (set controller.config.vel_limit"),
        (m.Errors(0x8000, 0), "VELOCITY_LIMIT_VIOLATION (set controller.config.vel_limit"),
        (m.Errors(0, 0x800), "DC_BUS_OVER_REGEN_CURRENT (set config.dc_max_negative_current"),
    ],
)
def test_cause_is_named_with_its_remedy(message: Message, start: str) -> None:
    (cause,) = causes_of(message)
    assert cause.startswith(start)


def test_there_is_no_cause_without_an_error_or_in_another_message() -> None:
    assert [causes_of(each) for each in (m.MotorError(0), m.Errors(0, 0), m.EncoderEstimates(1.0, 2.0))] == [[]] * 3


@pytest.mark.parametrize("names", [MOTOR_ERRORS, ENCODER_ERRORS, CONTROLLER_ERRORS])
def test_each_error_is_one_bit_and_has_a_name_of_its_own(names: Mapping[int, str]) -> None:
    assert all(bit.bit_count() == 1 for bit in names)
    assert len(set(names.values())) == len(names)


def test_parts_that_failed_are_asked_one_after_another_and_again_where_they_do_not_answer() -> None:
    causes = ErrorCauses()
    assert causes.next_request(0) is None
    causes.note_errors(Firmware.V0_5, 0xB40)
    assert causes.next_request(0) == 0x03
    assert causes.next_request(49 * MS) is None
    asked = [causes.next_request(moment * MS) for moment in range(50, 500, 50)]
    assert asked == [0x03, 0x03, 0x04, 0x04, 0x04, 0x1D, 0x1D, 0x1D, None]


def test_an_answer_is_an_event_once_and_is_kept_until_there_are_new_errors() -> None:
    causes = ErrorCauses()
    causes.note_errors(Firmware.V0_5, 0x200)
    assert causes.next_request(0) == 0x1D
    events = []
    for error in (0x20, 0x20, 0):
        causes.take(m.ControllerError(error))
        events.append(causes.event)
        causes.event = None
    assert events == ["controller INVALID_ESTIMATE", None, None]
    assert causes.next_request(10**12) is None

    causes.note_errors(Firmware.V0_5, 0)
    assert causes.found == ("controller INVALID_ESTIMATE",)
    causes.note_errors(Firmware.V0_5, 0x40)
    assert not causes.found


def test_errors_that_name_themselves_and_the_watchdogs_of_0_6_are_not_asked_about() -> None:
    causes = ErrorCauses()
    causes.note_errors(Firmware.V0_5, 0x4800)
    causes.note_errors(Firmware.V0_6, 0x1000000)
    assert causes.next_request(0) is None
    causes.note_errors(Firmware.V0_6, 0x1000800)
    assert causes.next_request(0) == 0x03


@fuzzed
@given(st.sampled_from([0x03, 0x04, 0x1D]), st.binary(max_size=8), st.sampled_from(Firmware))
def test_whatever_an_axis_answers_is_named_or_refused(command: int, data: bytes, firmware: Firmware) -> None:
    with contextlib.suppress(FrameRefusedError):
        message = decode(firmware, command, data)
        names = causes_of(message)
        if isinstance(message, m.MotorError):
            assert len(names) == struct.unpack("<Q", data)[0].bit_count()
