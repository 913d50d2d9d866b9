# SPDX-License-Identifier: MIT
"""The first arming after power-on, of firmware that sends zeros in place of estimates until closed loop."""

import math

import pytest

from segway_ecc.firmware_io.drives.odrive.frames import motor_motion
from segway_ecc.firmware_io.drives.odrive.listener import WheelOrigin
from segway_ecc.firmware_io.drives.odrive.messages import EncoderEstimates

ZEROS = EncoderEstimates(0.0, 0.0)


def origin_after(*estimates: EncoderEstimates) -> WheelOrigin:
    origin = WheelOrigin()
    for each in estimates:
        origin.take(each, zeros_measure=False)
    return origin


def test_zeros_of_an_axis_that_was_not_in_closed_loop_measure_nothing() -> None:
    assert origin_after(ZEROS, ZEROS).is_blind
    assert not origin_after(EncoderEstimates(0.0, 0.5)).is_blind
    assert not origin_after(EncoderEstimates(-0.25, 0.0)).is_blind


def test_zeros_are_measured_after_closed_loop_and_by_a_firmware_that_sends_nothing_else() -> None:
    connected = origin_after(ZEROS)
    connected.is_connected = True
    connected.take(ZEROS, zeros_measure=False)
    assert not connected.is_blind

    other = WheelOrigin()
    other.take(ZEROS, zeros_measure=True)
    assert not other.is_blind


@pytest.mark.parametrize("position", [-3.5, -0.26, 0.26, 1000.0])
def test_jump_at_closed_loop_is_the_origin_and_no_motion(position: float) -> None:
    origin = origin_after(ZEROS, EncoderEstimates(position, 0.5))
    assert origin.estimates == EncoderEstimates(0.0, 0.5)
    origin.take(EncoderEstimates(position + 0.25, 0.5), zeros_measure=False)
    assert motor_motion(origin.estimates)[0] == pytest.approx(0.5 * math.pi)


def test_angle_goes_on_from_where_it_was_after_the_drive_restarted() -> None:
    origin = origin_after(EncoderEstimates(2.0, 0.0), ZEROS)
    assert origin.is_blind
    assert origin.estimates.position_rev == 2.0
    origin.take(EncoderEstimates(-7.0, 0.0), zeros_measure=False)
    assert origin.estimates.position_rev == 2.0


def test_an_angle_that_was_always_measured_is_the_drives_own() -> None:
    assert origin_after(EncoderEstimates(2.0, 0.0), EncoderEstimates(2.5, 0.1)).estimates == (2.5, 0.1)
