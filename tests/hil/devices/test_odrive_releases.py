# SPDX-License-Identifier: MIT
"""What the releases of ODrive's firmware do that their frames do not show: zeros, limits, errors and settings."""

import functools
import math
import struct
from pathlib import Path
from typing import Any

import cantools
import pytest

from segway_ecc.firmware_io.drives import odrive
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices._odrive_board import ENDPOINTS
from segway_ecc.hil.devices.odrive import Release
from tests.hil.devices.odrive_bench import CLOSED, IDLE, MS, Bench, clear, mode, of, state, torque

OLD, NEW = (Release.V0_5_4, Release.V0_5_5, Release.V0_5_6), Release.V0_6_10
ALL = pytest.mark.parametrize("release", [*OLD, NEW])
V0_5 = pytest.mark.parametrize("release", OLD)
DBC = Path(odrive.__file__).parent


def bench_of(release: Release, **changes: Any) -> Bench:
    return Bench(release.firmware, release, **changes)


def ask(bench: Bench, command: int, node: int = 0) -> bytes:
    """The answer to a remote frame, with what comes unasked kept apart."""
    for cycles in bench.device.cycles:
        for cycle in cycles:
            cycle.last_ns = bench.now_ns
    (answer,) = of(bench.tick(Frame(node << 5 | command, b"", is_remote=True)), node << 5 | command)
    return answer.data


@functools.cache
def database(name: str) -> Any:
    return cantools.database.load_file(DBC / f"odrive-cansimple-{name}.dbc")


def decoded(release: Release, frame: Frame) -> dict[str, Any]:
    """A frame as ODrive's own DBC file has it."""
    name = "0.5.6" if release.firmware == "0.5" else "0.6.10"
    message = database(name).get_message_by_frame_id(frame.arbitration_id)
    values: dict[str, Any] = message.decode(frame.data, decode_choices=False)
    return values


def drive_in_closed_loop(bench: Bench, nm: float, rev_s: float) -> None:
    """Both axes in torque mode, given a torque at a speed, for a tick."""
    bench.close_loop()
    sign = bench.right.settings.direction * bench.right.settings.gear_ratio
    bench.outputs |= {"left.velocity": rev_s * math.tau, "right.velocity": rev_s * math.tau / sign}
    bench.tick(torque(0, nm), torque(1, nm), times=2)


@ALL
def test_before_closed_loop_only_0_5_6_sends_zeros(release: Release) -> None:
    bench = bench_of(release)
    bench.tick()
    bench.outputs |= {"left.angle": 0.75 * math.tau, "left.velocity": math.tau}
    bench.tick()
    true = struct.pack("<ff", 0.75, 1.0)
    is_zero = release is Release.V0_5_6
    assert ask(bench, 0x09) == (bytes(8) if is_zero else true)
    if release.firmware == "0.5":
        assert ask(bench, 0x0A) == struct.pack("<ii", 6144, 6144), "the count is the encoder's own"
        assert bench.say("f 0").startswith(b"0.750000 1.000000*"), "and so is the serial line's"

    bench.tick(mode(0, 1), torque(0, 0.0), state(0, CLOSED), times=4)
    assert ask(bench, 0x09) == true, "jumps to the encoder's count"
    bench.tick(state(0, IDLE), times=4)
    assert ask(bench, 0x09) == true, "stays connected when disarmed"
    bench.device.switch_off()
    bench.device.switch_on()
    bench.outputs["left.angle"] += 0.5 * math.tau
    bench.tick(times=2)
    assert (ask(bench, 0x09)[:4] == bytes(4)) is True, "counts from power-on again"


def test_closed_loop_that_fails_by_an_error_connects_the_estimates_too() -> None:
    bench = bench_of(Release.V0_5_6)
    bench.tick()
    bench.outputs["left.angle"] = 0.75 * math.tau
    bench.left.latch(0x40)
    bench.tick(state(0, CLOSED), times=5)
    assert bench.left.state is IDLE
    assert ask(bench, 0x09) == struct.pack("<ff", 0.75, 0.0)
    assert ask(bench, 0x09, 1) == bytes(8)


def test_without_calibration_nothing_is_connected() -> None:
    bench = bench_of(Release.V0_5_6)
    bench.left.is_calibrated = False
    bench.tick()
    bench.outputs["left.angle"] = 0.75 * math.tau
    bench.tick(state(0, CLOSED), times=5)
    assert ask(bench, 0x09) == bytes(8)


@pytest.mark.parametrize(("turns", "counts"), [(2.25, 2048), (-0.25, 6144)])
def test_an_absolute_encoder_counts_from_its_own_zero_within_the_turn(turns: float, counts: int) -> None:
    bench = bench_of(Release.V0_5_6)
    bench.left.has_absolute_encoder = True
    bench.outputs["left.angle"] = turns * math.tau
    bench.tick()
    assert bench.left.counts == counts


@ALL
@pytest.mark.parametrize("sign", [1, -1])
def test_overspeed_disarms_its_axis_alone(release: Release, sign: int) -> None:
    bench = bench_of(release)
    bench.close_loop()
    bench.left.velocity_limit_rev_s = 2.0
    bench.outputs["left.velocity"] = sign * 2.39 * math.tau
    bench.tick(torque(0, 0.0), torque(1, 0.0))
    assert bench.left.state is CLOSED
    bench.outputs["left.velocity"] = sign * 2.41 * math.tau
    frames = bench.tick(torque(0, 0.0), torque(1, 0.0), times=25)
    assert (bench.left.state, bench.right.state) == (IDLE, CLOSED)
    beat = decoded(release, of(frames, 0x01)[-1])
    if release is NEW:
        assert beat["Axis_Error"] == 0x8000
        assert ask(bench, 0x03) == struct.pack("<II", 0, 0x8000), "no longer active, and the reason"
    else:
        assert beat["Axis_Error"] == 0x200
        assert beat["Controller_Error_Flag"] == int(release is not Release.V0_5_4)
        assert (beat["Motor_Error_Flag"], beat["Encoder_Error_Flag"]) == (0, 0)
        assert ask(bench, 0x03) == bytes(8)
        assert bench.left.controller_error == 0x1


@ALL
def test_overspeed_is_no_error_in_idle_nor_where_it_is_switched_off(release: Release) -> None:
    bench = bench_of(release)
    bench.left.velocity_limit_rev_s = 2.0
    bench.outputs["left.velocity"] = 20.0 * math.tau
    bench.tick(torque(0, 0.0), times=5)
    assert bench.left.error == 0
    bench.left.enable_overspeed_error = False
    bench.close_loop()
    assert bench.left.error == 0


@ALL
@pytest.mark.parametrize(
    ("nm", "bit_of_board", "bit_of_0_6"),
    [(-0.5, 0x8, 0x800), (0.5, 0x10, 0x400)],
)
def test_a_current_of_the_supply_out_of_its_limits_disarms_the_board(
    release: Release, nm: float, bit_of_board: int, bit_of_0_6: int
) -> None:
    bench = bench_of(release)
    for board in bench.device.boards:
        board.dc_max_negative_current_a, board.dc_max_positive_current_a = -0.01, 0.1
    drive_in_closed_loop(bench, nm, 4.0)
    assert (bench.left.state, bench.right.state) == (IDLE, IDLE)
    assert list(bench.torques) == [0.0, 0.0]
    if release is NEW:
        assert ask(bench, 0x03) == ask(bench, 0x03, 1) == struct.pack("<II", 0, bit_of_0_6)
        return
    for node, axis in enumerate(bench.device.axes):
        assert (axis.error, ask(bench, 0x03, node)) == (0x40, struct.pack("<Q", 0x1000000)), "motor: system level"
    assert bench.say("r error").startswith(f"{bit_of_board}*".encode())
    bench.tick(torque(0, 0.0), torque(1, 0.0), clear("0.5", 0))
    assert [(axis.error, axis.motor_error) for axis in bench.device.axes] == [(0, 0)] * 2
    assert bench.device.boards[0].error == 0


@ALL
def test_the_currents_of_both_axes_of_a_board_add_up(release: Release) -> None:
    bench = bench_of(release)
    for board in bench.device.boards:
        board.dc_max_negative_current_a = -0.01
    bench.close_loop()
    bench.outputs |= {"left.velocity": 4.0 * math.tau, "right.velocity": 4.0 * math.tau / -2.0}
    bench.tick(torque(0, -0.5), torque(1, 0.6), times=2)
    is_one_board = release is not NEW
    assert (bench.left.state is CLOSED) is is_one_board, "0.5: what one brakes the other takes"


def test_a_brake_resistor_takes_what_flows_back() -> None:
    bench = bench_of(Release.V0_5_6)
    (board,) = bench.device.boards
    board.dc_max_negative_current_a, board.enable_brake_resistor = -0.01, True
    drive_in_closed_loop(bench, -0.5, 4.0)
    assert (bench.left.state, bench.right.state) == (CLOSED, CLOSED)


@ALL
def test_a_current_above_its_limit_and_margin_disarms_the_axis(release: Release) -> None:
    bench = bench_of(release)
    bench.left.current_limit_a, bench.left.current_limit_margin_a = 20.0, 2.0
    drive_in_closed_loop(bench, 4.0, 0.0)
    assert bench.left.current_a == 8.0
    bench.tick(torque(0, 4.0), torque(1, 4.0), Frame(0x0F, struct.pack("<ff", 100.0, 6.5)), times=2)
    assert (bench.left.state, bench.left.current_a) == (CLOSED, 6.5), "within the margin"
    bench.tick(torque(0, 4.0), torque(1, 4.0), Frame(0x0F, struct.pack("<ff", 100.0, 1.0)), times=2)
    assert (bench.left.state, bench.right.state) == (IDLE, CLOSED)
    if release is NEW:
        assert ask(bench, 0x03) == struct.pack("<II", 0, 0x1000)
    else:
        assert (bench.left.error, ask(bench, 0x03)) == (0x40, struct.pack("<Q", 0x1000))


@V0_5
def test_error_registers_are_answered_and_flagged_as_in_each_release(release: Release) -> None:
    bench = bench_of(release)
    bench.left.motor_error, bench.left.encoder_error, bench.left.controller_error = 1 << 35, 0x4, 0x80
    assert ask(bench, 0x03) == struct.pack("<Q", 1 << 35)
    assert ask(bench, 0x04) == struct.pack("<Q", 0x4)
    has_controller_error = release is not Release.V0_5_4
    bench.now_ns += 50 * MS
    beat, *_ = of(bench.tick(), 0x01)
    names = ("Motor_Error_Flag", "Encoder_Error_Flag", "Controller_Error_Flag")
    assert [decoded(release, beat)[name] for name in names] == [int(has_controller_error)] * 3
    for frame in (Frame(0x1D, b"", is_remote=True), Frame(0x1D, b""), Frame(0x1D, b"\1\2\3")):
        answers = [each.data for each in of(bench.tick(frame), 0x1D)]
        assert answers == ([struct.pack("<Q", 0x80)] if has_controller_error else [])


def test_0_5_4_answers_remote_frames_only_and_knows_less() -> None:
    bench = bench_of(Release.V0_5_4)
    assert ask(bench, 0x09) == bytes(8)
    assert of(bench.tick(Frame(0x09, b"")), 0x09) == []
    drive_in_closed_loop(bench, 2.0, 1.0)
    assert ask(bench, 0x14) == struct.pack("<ff", 0.0, 4.0), "d and q set-points"
    assert ask(bench, 0x17) == struct.pack("<ff", 36.0, 0.0), "no current"
    sent = {frame.arbitration_id for frame in bench.tick(times=200)}
    assert sent == {0x01, 0x09, 0x21, 0x29}, "nothing else is cyclic"


@ALL
def test_a_new_board_has_the_traps_of_its_factory_settings(release: Release) -> None:
    bench = bench_of(release)
    for axis in bench.device.axes:
        axis.factory_settings()
    assert {axis.watchdog_s for axis in bench.device.axes} == {None}
    bench.close_loop()
    bench.outputs["left.velocity"] = 2.5 * math.tau
    bench.tick(times=1)
    assert bench.left.state is IDLE, "overspeed above 2.4 rev/s"


LINES = [
    ("axis0.controller.config.vel_limit", "2.500000", "velocity_limit_rev_s", 2.5),
    ("axis1.controller.config.vel_limit_tolerance", "1.500000", "velocity_limit_tolerance", 1.5),
    ("axis1.controller.config.enable_overspeed_error", "0", "enable_overspeed_error", False),
    ("axis0.controller.config.enable_torque_mode_vel_limit", "0", "enable_torque_mode_velocity_limit", False),
    ("axis0.motor.config.current_lim", "7.000000", "current_limit_a", 7.0),
    ("axis0.motor.config.current_lim_margin", "3.000000", "current_limit_margin_a", 3.0),
    ("axis0.motor.config.torque_constant", "0.040000", "torque_constant", 0.04),
    ("axis1.config.watchdog_timeout", "0.030000", "watchdog_timeout_s", 0.03),
    ("axis1.config.enable_watchdog", "0", "enable_watchdog", False),
]


@pytest.mark.parametrize(("name", "text", "attribute", "value"), LINES)
def test_settings_are_written_and_read_on_the_serial_line(name: str, text: str, attribute: str, value: float) -> None:
    bench = bench_of(Release.V0_5_6)
    assert bench.say(f"w {name} {text}") == b""
    axis = bench.device.axes[int(name[4])]
    assert getattr(axis, attribute) == value
    assert bench.say(f"r {name}").partition(b"*")[0].decode() == text


def test_a_board_reports_its_settings_and_its_version_on_the_serial_line() -> None:
    bench = bench_of(Release.V0_5_6)
    assert bench.say("w config.dc_max_negative_current -0.01") == b""
    assert bench.device.boards[0].dc_max_negative_current_a == -0.01
    said = [bench.say(f"r fw_version_{part}")[:1] for part in ("major", "minor", "revision")]
    assert said == [b"0", b"5", b"6"]
    assert bench.say("r config.dc_max_positive_current").startswith(b"inf*")
    for line in ("w vbus_voltage 3.0", "w axis0.error 0", "w axis0.controller.config.vel_limit fast"):
        assert bench.say(line).startswith(b"not implemented*")
    assert bench.say("r axis0.active_errors").startswith(b"invalid property*"), "which 0.6 has"


def sdo(opcode: int, endpoint: int, value: bytes = b"", node: int = 0) -> Frame:
    return Frame(node << 5 | 0x04, struct.pack("<BHB", opcode, endpoint, 0) + value)


def endpoint_of(name: str) -> int:
    (number,) = (number for number, each in ENDPOINTS.items() if each == name)
    return number


def read(bench: Bench, name: str, node: int = 0) -> bytes:
    """An endpoint's value, from a request as the DBC file has it, of eight bytes."""
    number = endpoint_of(name)
    frames = of(bench.tick(sdo(0, number, bytes(4), node)), node << 5 | 0x05)
    (reply,) = frames
    assert (reply.data[0], reply.data[3]) == (0, 0)
    assert struct.unpack_from("<H", reply.data, 1) == (number,)
    assert len(reply.data) <= 8
    return reply.data[4:]


def test_endpoints_are_read_on_each_board_by_itself() -> None:
    bench = bench_of(NEW)
    bench.left.velocity_limit_rev_s, bench.right.velocity_limit_rev_s = 2.0, 5.0
    name = "axis0.controller.config.vel_limit"
    assert [read(bench, name, node) for node in (0, 1)] == [struct.pack("<f", 2.0), struct.pack("<f", 5.0)]
    assert read(bench, "axis0.controller.config.enable_overspeed_error") == b"\1"
    assert read(bench, "axis0.current_state") == b"\1"
    assert read(bench, "vbus_voltage") == struct.pack("<f", 36.0)
    assert read(bench, "config.dc_max_negative_current") == struct.pack("<f", -math.inf)
    assert [read(bench, f"fw_version_{part}")[0] for part in ("major", "minor", "revision")] == [0, 6, 10]
    bench.left.latch(0x20)
    assert read(bench, "axis0.active_errors") == struct.pack("<I", 0x20)


def test_every_endpoint_that_is_listed_is_there() -> None:
    bench = bench_of(NEW)
    bench.tick()
    assert {name: len(read(bench, name)) in (1, 4) for name in ENDPOINTS.values()} == dict.fromkeys(
        ENDPOINTS.values(), True
    )


def test_endpoints_are_written_without_a_reply() -> None:
    bench = bench_of(NEW)
    limit, overspeed = (endpoint_of(f"axis0.controller.config.{n}") for n in ("vel_limit", "enable_overspeed_error"))
    assert of(bench.tick(sdo(1, limit, struct.pack("<f", 3.0), 1)), 0x25) == []
    assert (bench.left.velocity_limit_rev_s, bench.right.velocity_limit_rev_s) == (math.inf, 3.0)
    bench.tick(sdo(1, overspeed, bytes(4)))
    assert bench.left.enable_overspeed_error is False
    bench.tick(sdo(1, endpoint_of("axis0.requested_state"), b"\x08"), times=4)
    assert bench.left.state is CLOSED
    assert bench.device.refused_frames == 0


@pytest.mark.parametrize(
    "frame",
    [
        sdo(0, 9999),
        sdo(1, endpoint_of("vbus_voltage"), struct.pack("<f", 1.0)),
        sdo(1, endpoint_of("axis0.controller.config.vel_limit"), b"\0\0\0"),
        sdo(2, endpoint_of("vbus_voltage")),
        Frame(0x04, b"\0\1"),
    ],
)
def test_what_cannot_be_read_or_written_is_refused_without_a_reply(frame: Frame) -> None:
    bench = bench_of(NEW)
    before = bench.left.velocity_limit_rev_s
    assert of(bench.tick(frame), 0x05) == []
    assert (bench.device.refused_frames, bench.left.velocity_limit_rev_s) == (1, before)


def test_sdo_frames_feed_no_watchdog_of_0_6() -> None:
    bench = bench_of(NEW)
    for _ in range(10):
        bench.tick(sdo(0, 1), times=10)
    assert bench.left.error == 0x01000000


def test_0_6_reports_a_latched_error_as_active_and_what_it_disarmed_as_the_reason() -> None:
    bench = bench_of(NEW)
    bench.tick(times=60)
    assert ask(bench, 0x03) == struct.pack("<II", 0x01000000, 0), "expired in idle: nothing was disarmed"
    bench.close_loop()
    bench.tick(Frame(0x02, b""))
    assert ask(bench, 0x03) == struct.pack("<II", 0x02000000, 0x02000000)
    bench.tick(torque(0, 0.0), clear("0.6", 0))
    assert ask(bench, 0x03) == bytes(8)


@ALL
def test_all_that_is_sent_lies_as_the_dbc_file_has_it(release: Release) -> None:
    bench = bench_of(release)
    drive_in_closed_loop(bench, 1.0, 2.0)
    frames = {frame.arbitration_id: decoded(release, frame) for frame in bench.tick(torque(0, 1.0), times=40)}
    assert frames[0x01]["Axis_State"] == 8
    assert frames[0x09] == {"Pos_Estimate": 0.0, "Vel_Estimate": 2.0}
    if release is Release.V0_5_4:
        return
    torque_id, names = (
        (0x1C, ("Torque_Target", "Torque_Estimate")) if release is NEW else (0x14, ("Iq_Setpoint", "Iq_Measured"))
    )
    assert [frames[torque_id][name] for name in names] == pytest.approx([1.0, 1.0] if release is NEW else [2.0, 2.0])
