# SPDX-License-Identifier: MIT
"""The simulated ODrives against what is known of their firmware, with raw frames and lines."""

import math
import struct
from typing import Any

import pytest

from segway_ecc.firmware_io.drives.odrive.frames import Firmware
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.devices.odrive import Release
from tests.hil.devices.odrive_bench import CLOSED, IDLE, MS, Bench, clear, mode, of, state, torque

EXPIRED = {"0.5": 0x800, "0.6": 0x01000000}
ESTOP = {"0.5": 0x4000, "0.6": 0x02000000}
BOTH = pytest.mark.parametrize("firmware", ["0.5", "0.6"])


def test_is_a_device_for_both_wheels() -> None:
    device: Device = Bench().device
    assert tuple(device.inputs) == ("left.torque", "right.torque")


def test_what_is_asked_for_decides_the_firmware_and_auto_is_the_old_one() -> None:
    assert Bench("auto").device.firmware is Firmware.V0_5
    assert Bench("0.6").device.firmware is Firmware.V0_6


@BOTH
def test_heartbeats_and_estimates_come_at_their_periods(firmware: str) -> None:
    frames = Bench(firmware).tick(times=100)
    for node in (0, 0x20):
        assert len(of(frames, node | 0x01)) == 5
        assert len(of(frames, node | 0x09)) == 20
        assert len(of(frames, node | (0x14 if firmware == "0.5" else 0x1C))) == 10
        assert len(of(frames, node | 0x17)) == 1
    assert of(frames, 0x01)[0].data == bytes((0, 0, 0, 0, 1, 0, 0, 0))


def test_a_message_whose_period_is_zero_is_never_sent() -> None:
    bench = Bench()
    bench.device.cycles[0][0].period_ns = 0
    assert of(bench.tick(times=100), 0x01) == []


@BOTH
def test_the_watchdog_expires_in_idle_too_and_its_error_stays(firmware: str) -> None:
    bench = Bench(firmware)
    bench.tick(times=51)
    assert bench.left.error == 0
    bench.tick()
    assert bench.left.error == bench.right.error == EXPIRED[firmware]
    bench.tick(torque(0, 0.0), times=5)
    assert bench.left.error == EXPIRED[firmware]


@BOTH
def test_a_watchdog_that_is_off_never_expires(firmware: str) -> None:
    bench = Bench(firmware)
    bench.left.watchdog_s = None
    bench.tick(times=500)
    assert (bench.left.error, bench.right.error) == (0, EXPIRED[firmware])


def test_clearing_clears_the_whole_board_in_0_5_and_without_a_feed_the_error_is_back_at_once() -> None:
    bench = Bench()
    bench.tick(times=60)
    bench.left.latch(0x100)
    bench.tick(clear("0.5", 1))
    assert bench.left.error == 0x800, "not fed, so it expired again in the same tick; the rest is gone"
    assert bench.right.error == 0, "the frame itself fed this one"


def test_clearing_clears_one_axis_in_0_6_and_feeds_nothing() -> None:
    bench = Bench("0.6")
    bench.tick(times=60)
    bench.tick(clear("0.6", 0))
    assert bench.left.error == EXPIRED["0.6"]
    bench.tick(torque(0, 0.0), clear("0.6", 0))
    assert (bench.left.error, bench.right.error) == (0, EXPIRED["0.6"])


FEEDS = [
    (torque(0, 0.0), True, True),
    (Frame(0x0D, bytes(8)), True, True),
    (Frame(0x0C, bytes(8)), True, True),
    (Frame(0x09, b"", is_remote=True), True, False),
    (Frame(0x1E, b"\1\2"), True, False),  # no such command
    (Frame(0x01, bytes(8)), True, False),
    (state(0, IDLE), True, False),
    (Frame(0x29, b"", is_remote=True), False, False),  # to the other axis
    (Frame(0x0E, bytes(8), is_extended=True), False, False),
    (Frame(0x4E, bytes(8)), False, False),
]


@pytest.mark.parametrize(("frame", "old", "new"), FEEDS)
@BOTH
def test_what_feeds_the_watchdog(firmware: str, frame: Frame, *, old: bool, new: bool) -> None:
    bench = Bench(firmware)
    for _ in range(10):
        bench.tick(frame, times=10)
    assert (bench.left.error == 0) is (old if firmware == "0.5" else new)


@BOTH
def test_closed_loop_needs_a_request_time_and_no_errors(firmware: str) -> None:
    bench = Bench(firmware)
    bench.tick(state(0, CLOSED))
    assert bench.left.state is IDLE
    bench.tick(times=2)
    assert (bench.left.state, bench.right.state) == (CLOSED, IDLE)
    bench.tick(state(0, IDLE), times=3)
    assert bench.left.state is IDLE

    bench.left.latch(0x40)
    frames = bench.tick(state(0, CLOSED), times=30)
    assert bench.left.state is IDLE
    newest = of(frames, 0x01)[-1].data
    if firmware == "0.5":
        assert newest[:5] == bytes((0x40, 0, 0, 0, 1)), "no invalid state"
    else:
        assert newest[:6] == bytes((0x40, 0, 0, 0, 1, 13)), "procedure: invalid state"


def test_0_5_enters_closed_loop_with_an_error_for_a_moment_and_gives_no_torque_in_it() -> None:
    bench = Bench("0.5")
    bench.left.latch(0x40)
    bench.tick(mode(0, 1), torque(0, 1.0), state(0, CLOSED))
    seen = []
    for _ in range(4):
        bench.tick(torque(0, 1.0))
        seen.append((bench.left.state, bench.torques[0], bench.left.error))
    assert seen == [(IDLE, 0.0, 0x40), (CLOSED, 0.0, 0x40), (IDLE, 0.0, 0x40), (IDLE, 0.0, 0x40)]


@pytest.mark.parametrize(("firmware", "error", "result"), [("0.5", 0x1, 0), ("0.6", 0, 14)])
def test_an_axis_that_is_not_calibrated_never_enters_closed_loop(firmware: str, error: int, result: int) -> None:
    bench = Bench(firmware)
    bench.left.is_calibrated = False
    for _ in range(4):
        bench.tick(torque(0, 0.0), state(0, CLOSED))
        bench.tick(times=5)
        assert (bench.left.state, bench.left.error, bench.left.procedure_result) == (IDLE, error, result)


def test_entering_closed_loop_feeds_the_watchdog() -> None:
    bench = Bench("0.6")
    bench.tick(torque(0, 0.0), times=45)
    bench.tick(state(0, CLOSED), times=50)
    assert (bench.left.state, bench.left.error) == (CLOSED, 0)
    bench.tick(times=5)
    assert bench.left.state is IDLE


@BOTH
@pytest.mark.parametrize("bits", [0x40, 0x800])
def test_an_error_on_one_axis_does_not_keep_the_other_out_of_closed_loop(firmware: str, bits: int) -> None:
    bench = Bench(firmware)
    bench.right.latch(bits)
    bench.tick(state(0, CLOSED), times=4)
    assert (bench.left.state, bench.left.error) == (CLOSED, 0)
    assert (bench.right.state, bench.right.error) == (IDLE, bits)


@BOTH
def test_the_watchdogs_of_two_axes_are_independent(firmware: str) -> None:
    bench = Bench(firmware)
    bench.close_loop()
    for _ in range(20):
        bench.tick(torque(0, 0.5), times=10)
    assert (bench.left.state, bench.left.error) == (CLOSED, 0)
    assert (bench.right.state, bench.right.error) == (IDLE, EXPIRED[firmware])


@BOTH
@pytest.mark.parametrize("wanted", [3, 77])
def test_states_that_are_not_simulated_are_refused(firmware: str, wanted: int) -> None:
    bench = Bench(firmware)
    bench.tick(state(0, wanted), times=4)
    assert bench.left.state is IDLE
    assert (bench.left.error, bench.left.procedure_result) == ((1, 0) if firmware == "0.5" else (0, 13))


def test_0_5_reads_a_short_frame_as_if_zeros_followed_and_0_6_needs_what_it_reads() -> None:
    for length, old, new in ((1, CLOSED, IDLE), (4, CLOSED, CLOSED)):
        benches = Bench("0.5"), Bench("0.6")
        for bench in benches:
            bench.tick(state(0, CLOSED, length), times=4)
        assert [bench.left.state for bench in benches] == [old, new]
        assert [bench.device.refused_frames for bench in benches] == [0, int(length == 1)]


@BOTH
def test_torque_is_held_until_the_watchdog_expires_and_the_motor_is_off_then(firmware: str) -> None:
    bench = Bench(firmware)
    bench.close_loop()
    bench.tick(torque(0, 1.5), torque(1, 1.5))
    assert list(bench.torques) == [1.5, -3.0]
    bench.tick(times=50)
    assert list(bench.torques) == [1.5, -3.0]
    bench.tick()
    assert list(bench.torques) == [0.0, 0.0]
    assert (bench.left.state, bench.left.error) == (IDLE, EXPIRED[firmware])


@BOTH
def test_a_drive_without_a_watchdog_holds_its_last_torque_for_ever(firmware: str) -> None:
    bench = Bench(firmware)
    bench.left.watchdog_s = bench.right.watchdog_s = None
    bench.close_loop()
    bench.tick(torque(0, 1.5))
    bench.tick(times=2000)
    assert bench.torques[0] == 1.5


@BOTH
def test_estop_latches_and_the_motor_is_off(firmware: str) -> None:
    bench = Bench(firmware)
    bench.close_loop()
    bench.tick(torque(0, 1.0), Frame(0x02, b""))
    assert (bench.left.state, bench.left.error, bench.torques[0]) == (IDLE, ESTOP[firmware], 0.0)
    bench.tick(torque(0, 1.0), state(0, CLOSED), times=4)
    assert bench.left.state is IDLE


def test_torque_is_limited_by_the_current() -> None:
    bench = Bench()
    bench.close_loop()
    bench.tick(Frame(0x0F, struct.pack("<ff", 100.0, 3.0)), torque(0, 9.0))
    assert bench.torques[0] == 1.5  # 3 A at 0.5 N m/A
    bench.tick(torque(0, -9.0))
    assert bench.torques[0] == -1.5
    assert struct.unpack("<ff", of(bench.tick(torque(0, -9.0), times=12), 0x14)[-1].data) == (-3.0, -3.0)


def test_torque_mode_gives_less_beyond_the_velocity_limit() -> None:
    bench = Bench()
    bench.close_loop()
    bench.outputs["left.velocity"] = 2.0 * math.tau
    bench.tick(Frame(0x0F, struct.pack("<ff", 3.0, 50.0)), torque(0, 4.0))
    assert bench.torques[0] == pytest.approx(0.16)
    bench.left.enable_torque_mode_velocity_limit = False
    bench.tick(torque(0, 4.0))
    assert bench.torques[0] == 4.0


def test_set_points_on_the_bus_do_not_change_the_control_mode() -> None:
    bench = Bench()
    bench.close_loop()
    bench.tick(Frame(0x0D, struct.pack("<ff", 5.0, 0.25)))
    assert (bench.left.control_mode, bench.torques[0]) == (1, 0.25)
    bench.tick(mode(0, 2))
    assert bench.torques[0] == pytest.approx(0.16 * 5.0 + 0.25)
    bench.tick(Frame(0x0C, struct.pack("<fhh", 0.5, 0, 0)), mode(0, 3))
    assert bench.torques[0] == pytest.approx(0.16 * 20.0 * 0.5)
    bench.tick(mode(0, 0))
    assert bench.torques[0] == 0.0


def test_inputs_of_an_inactive_mode_are_not_taken() -> None:
    bench = Bench()
    bench.close_loop()
    inputs = torque(0, 1.0), Frame(0x0D, struct.pack("<ff", 1.0, 1.0)), Frame(0x0C, struct.pack("<fhh", 1.0, 9, 9))
    bench.tick(mode(0, 1, 0), *inputs)
    assert bench.torques[0] == 0.0


def test_after_power_on_an_axis_is_in_position_mode_where_torque_means_nothing() -> None:
    bench = Bench()
    bench.tick(torque(0, 0.0), state(0, CLOSED), times=4)
    bench.tick(torque(0, 0.0))
    assert (bench.left.control_mode, bench.left.state) == (3, CLOSED)
    assert bench.torques[0] == 0.0


def test_angles_are_counted_from_power_on_in_steps_of_the_encoder() -> None:
    bench = Bench(release=Release.V0_5_5)
    bench.outputs |= {"left.angle": 1.0, "right.angle": 1.0}
    bench.tick()
    bench.outputs |= {"left.angle": 1.0 + 0.3, "right.angle": 1.0 + 0.3, "right.velocity": math.pi}
    frames = bench.tick(times=10)
    left = struct.unpack("<ff", of(frames, 0x09)[-1].data)
    right = struct.unpack("<ff", of(frames, 0x29)[-1].data)
    assert left == (math.floor(0.3 / math.tau * 8192) / 8192, 0.0)
    assert right == (math.floor(-0.6 / math.tau * 8192) / 8192, -1.0)
    assert of(bench.tick(Frame(0x0A, b"", is_remote=True)), 0x0A)[0].data == struct.pack("<ii", 391, 391)


@pytest.mark.parametrize(("firmware", "data"), [("0.5", struct.pack("<i", 8192)), ("0.6", struct.pack("<f", 1.0))])
def test_the_position_can_be_set(firmware: str, data: bytes) -> None:
    bench = Bench(firmware)
    bench.outputs["left.angle"] = 77.0
    bench.tick()
    bench.tick(Frame(0x19, data))
    assert bench.left.position_rev == pytest.approx(1.0, abs=1 / 8192)


ANSWERED = {
    "0.5": {0x03, 0x04, 0x05, 0x09, 0x0A, 0x14, 0x15, 0x17, 0x1D},
    "0.6": {0x00, 0x03, 0x09, 0x14, 0x15, 0x17, 0x1C},
}


@BOTH
@pytest.mark.parametrize("is_remote", [True, False])
def test_requests_are_answered(firmware: str, *, is_remote: bool) -> None:
    bench = Bench(firmware)
    bench.tick()
    for command in range(32):
        if command in (0x02, 0x16, 0x18):
            continue  # commands that need no data
        bench.now_ns = 1 * MS
        frames = bench.tick(Frame(0x20 | command, b"", is_remote=is_remote))
        assert [frame.arbitration_id for frame in frames] == ([0x20 | command] if command in ANSWERED[firmware] else [])


def test_0_6_reports_its_version_and_a_missing_motor_sensor() -> None:
    bench = Bench("0.6")
    bench.tick()
    version, temperatures = bench.tick(Frame(0x00, b"", is_remote=True), Frame(0x15, b"", is_remote=True))
    assert version.data[4:6] == b"\0\6"
    assert math.isnan(struct.unpack("<ff", temperatures.data)[1])


def test_without_power_nothing_is_received_sent_or_moved_and_nothing_is_kept() -> None:
    bench = Bench()
    bench.close_loop()
    bench.tick(torque(0, 1.0))
    bench.device.switch_off()
    bench.port.arrived = b"f 0\n"
    assert bench.tick(torque(0, 1.0), Frame(0x09, b"", is_remote=True), times=200) == []
    assert list(bench.torques) == [0.0, 0.0]
    assert bench.port.written == b""

    bench.outputs["left.angle"] = 50.0
    bench.device.switch_on()
    bench.tick()
    assert (bench.left.state, bench.left.error, bench.left.position_rev) == (IDLE, 0, 0.0)
    bench.tick(times=51)
    assert bench.left.error == 0x800


@pytest.mark.parametrize(("firmware", "data", "others"), [("0.5", b"", True), ("0.6", b"\0", False)])
def test_rebooting_restarts_the_board(firmware: str, data: bytes, *, others: bool) -> None:
    bench = Bench(firmware)
    bench.close_loop()
    bench.tick(Frame(0x16, data))
    assert (bench.left.state, bench.right.state) == (IDLE, IDLE if others else CLOSED)
    bench.close_loop()
    bench.tick(Frame(0x16, b"\1"))
    assert bench.left.state is (IDLE if others else CLOSED), "to 0.6 this says to save"


def test_what_is_no_number_is_refused_and_counted() -> None:
    bench = Bench()
    bench.close_loop()
    bench.tick(torque(0, 1.0))
    bench.tick(torque(0, math.nan))
    assert bench.torques[0] == 1.0
    assert bench.device.refused_frames == 1


def _memory(bench: Bench) -> list[Any]:
    skipped = {"_fed_ns", "_requested_ns"}
    return [{k: v for k, v in vars(axis).items() if k not in skipped} for axis in bench.device.axes]


@BOTH
def test_no_other_identifier_or_length_changes_anything(firmware: str) -> None:
    obeyed = {0x02, 0x07, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x16, 0x18, 0x19}
    bench = Bench(firmware)
    for axis in bench.device.axes:
        axis.watchdog_s = None
    bench.close_loop()
    bench.left.latch(0x10)
    before = _memory(bench)
    for identifier in range(2048):
        for length in range(9):
            if identifier >= 0x40 or identifier % 32 not in obeyed:
                bench.device.obey([Frame(identifier, b"\x41" * length)], bench.now_ns, bench.outputs)
        for length in range(9):
            data = b"\x41" * length
            bench.device.obey([Frame(identifier, data, is_extended=True)], bench.now_ns, bench.outputs)
    assert _memory(bench) == before

    for command in obeyed:
        fresh = Bench(firmware)
        fresh.close_loop()
        fresh.left.latch(0x10)
        begun = _memory(fresh)
        # Zero is what asks 0.6 to restart; elsewhere it says something too.
        fresh.tick(Frame(command, bytes(8) if command == 0x16 else b"\x41\0\0\0\x41\x41\0\0"), times=4)
        assert _memory(fresh) != begun, f"0x{command:02X}"


def test_lines_are_answered_with_a_checksum_where_they_have_one() -> None:
    bench = Bench()
    assert bench.say("f 0") == b"0.000000 0.000000*32\r\n"
    assert bench.say("r axis1.current_state") == b"1*49\r\n"
    assert bench.say("f 37") == b"invalid motor 37*30\r\n"
    bench.port.written, bench.port.arrived = b"", b"f 0 ; how is it?\n"
    bench.tick()
    assert bench.port.written == b"0.000000 0.000000\r\n"


@pytest.mark.parametrize("end", ["\n", "\r", "!"])
def test_lines_may_end_in_three_ways(end: str) -> None:
    assert Bench().say("r vbus_voltage", end).startswith(b"36.000000*")


def test_a_wrong_checksum_is_passed_over_in_silence() -> None:
    bench = Bench()
    bench.port.arrived = b"f 0*15\n"
    bench.tick()
    assert bench.port.written == b""
    assert bench.device.refused_frames == 1


@pytest.mark.parametrize(
    ("text", "reply"),
    [
        ("x", b"unknown command"),
        ("c 0", b"invalid command format"),
        ("c 0 much", b"invalid command format"),
        ("c 5 1.0", b"invalid motor 5"),
        ("f", b"invalid command format"),
        ("w axis0.requested_state", b"invalid command format"),
        ("r axis0.nonsense", b"invalid property"),
        ("r axis7.error", b"invalid property"),
        ("w axis7.requested_state 1", b"invalid property"),
        ("w axis0.nonsense 1", b"invalid property"),
        ("w axis0.requested_state idle", b"not implemented"),
    ],
)
def test_an_unknown_line_is_answered_with_an_error(text: str, reply: bytes) -> None:
    assert Bench().say(text).partition(b"*")[0] == reply


def test_unlike_the_bus_lines_change_the_control_mode() -> None:
    bench = Bench()
    bench.close_loop()
    assert bench.say("v 0 2.0 0.5") == b""
    assert (bench.left.control_mode, bench.left.input_velocity_rev_s, bench.left.input_torque_nm) == (2, 2.0, 0.5)
    bench.say("p 0 1.5")
    assert (bench.left.control_mode, bench.left.input_position_rev) == (3, 1.5)
    bench.say("c 0 0.75")
    assert (bench.left.control_mode, bench.torques[0]) == (1, 0.75)


@pytest.mark.parametrize(
    ("text", "feeds"),
    [
        ("c 0 0.0", True),
        ("v 0 0.0", True),
        ("p 0 0.0", True),
        ("u 0", True),
        ("f 0", False),
        ("r axis0.error", False),
        ("w axis0.requested_state 1", False),
        ("sc", False),
        ("c 1 0.0", False),
    ],
)
def test_commands_feed_the_watchdog_and_questions_do_not(text: str, *, feeds: bool) -> None:
    bench = Bench()
    for _ in range(10):
        bench.say(text)
        bench.tick(times=9)
    assert (bench.left.error == 0) is feeds


def test_lines_set_states_and_modes_clear_errors_and_report_the_watchdog() -> None:
    bench = Bench()
    bench.left.latch(0x100)
    bench.say("sc")
    assert bench.left.error == 0
    bench.say("w axis0.controller.config.control_mode 1")
    bench.say("w axis0.controller.config.input_mode 1")
    bench.say("w axis0.requested_state 8")
    bench.tick(torque(0, 1.0), times=4)
    assert (bench.left.state, bench.torques[0]) == (CLOSED, 1.0)
    assert bench.say("r axis0.config.enable_watchdog").startswith(b"1*")
    assert bench.say("r axis0.config.watchdog_timeout").startswith(b"0.050000*")
    assert bench.say("r axis0.motor.current_control.Iq_measured").startswith(b"2.000000*")
    assert bench.say("r axis0.controller.config.control_mode").startswith(b"1*")
    assert bench.say("r axis0.controller.config.input_mode").startswith(b"1*")
    assert bench.say("r axis0.error").startswith(b"0*")


def test_a_line_that_is_too_long_is_dropped_and_the_next_one_taken() -> None:
    bench = Bench()
    bench.port.arrived = b"x" * 300 + b"\nf 0\n"
    bench.tick()
    assert bench.port.written == b"0.000000 0.000000\r\n"
