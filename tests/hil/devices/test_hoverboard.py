# SPDX-License-Identifier: MIT
"""The simulated board by itself: what its firmware does that a driver would rather not know."""

import math
import struct
from dataclasses import replace

import pytest

from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings, HoverboardWheelSettings
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.hil.devices.family import simulated_drives
from segway_ecc.hil.devices.hoverboard import TICK_NS, SimulatedHoverboard
from segway_ecc.hil.rig.no_bus import NoBus
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial

PACKET = struct.Struct("<H8hHH")
WHEEL = HoverboardWheelSettings(torque_constant=0.2, max_torque=3.0)
SETTINGS = HoverboardSettings(
    serial=PortSettings(port="test"), left=WHEEL, right=WHEEL, serial_timeout_cycles=20, feedback="odometry"
)


def command(steer: int, speed: int) -> bytes:
    words = (0xABCD, steer & 0xFFFF, speed & 0xFFFF)
    return struct.pack("<4H", *words, words[0] ^ words[1] ^ words[2])


class Bench:
    """The board at one end of a line, at the other bytes by hand."""

    def __init__(self, settings: HoverboardSettings = SETTINGS) -> None:
        self.time_ns = 0
        self.wires = SimulatedSerial(115_200, lambda: self.time_ns)
        self.board = SimulatedHoverboard(settings, self.wires.device)
        self.wheels = {"left.angle": 0.0, "left.velocity": 0.0, "right.angle": 0.0, "right.velocity": 0.0}
        self.supply: dict[str, float] = {}
        self.feedback: list[tuple[int, ...]] = []
        self._received = b""
        self.torques = (0.0, 0.0)

    def run(self, milliseconds: int) -> None:
        for _ in range(milliseconds):
            outputs = {**self.wheels, **self.supply}
            self.torques = tuple(self.board.obey((), self.time_ns, outputs))  # type: ignore[assignment]  # two of them
            self.board.send_telemetry(self.time_ns, outputs)
            self.time_ns += TICK_NS
            for side in ("left", "right"):
                self.wheels[f"{side}.angle"] += self.wheels[f"{side}.velocity"] * 1e-3
        self._received += self.wires.host.read(1_000_000)
        while len(self._received) >= PACKET.size:
            self.feedback.append(PACKET.unpack(self._received[: PACKET.size]))
            self._received = self._received[PACKET.size :]

    def send(self, steer: int, speed: int, milliseconds: int = 10) -> None:
        self.wires.host.write(command(steer, speed))
        self.run(milliseconds)

    def switch_on(self) -> None:
        for _ in range(40):
            self.send(0, 0)
        assert self.board.enable


def test_both_motors_give_the_part_of_their_largest_current_that_was_asked_for() -> None:
    bench = Bench()
    bench.switch_on()
    bench.send(500, -250, 20)
    assert bench.torques == pytest.approx((1.5, -0.75), abs=0.004)


def test_its_motors_are_on_by_themselves_and_meanwhile_it_beeps_and_sends_nothing() -> None:
    bench = Bench()
    bench.run(290)
    assert bench.board.enable
    assert bench.feedback == []
    bench.run(60)
    assert len(bench.feedback) > 2


@pytest.mark.parametrize("block", [command(500, 0) * 2, command(500, 0)[:7], b"\0" + command(500, 0), bytes(8)])
def test_what_does_not_come_as_one_whole_packet_between_two_pauses_is_not_taken(block: bytes) -> None:
    bench = Bench()
    bench.switch_on()
    bench.wires.host.write(block)
    bench.run(30)
    assert bench.torques == (0.0, 0.0)
    assert bench.board.refused_frames == 1


def test_a_wrong_checksum_is_refused() -> None:
    bench = Bench()
    bench.switch_on()
    bench.wires.host.write(command(500, 0)[:6] + b"\0\0")
    bench.run(30)
    assert bench.torques == (0.0, 0.0)


def test_silence_ends_torque_after_its_time_out_and_not_before() -> None:
    bench = Bench()
    bench.switch_on()
    bench.send(500, 500, 20)
    bench.run(70)
    assert bench.torques[0] > 1.0
    bench.run(30)
    assert bench.torques == (0.0, 0.0)
    assert bench.feedback[-1][1:3] == (0, 0), "and its feedback has zero where the command was"
    bench.send(500, 500, 20)
    assert bench.torques[0] > 1.0


def test_a_motor_s_error_switches_both_off_and_nothing_shows_it() -> None:
    bench = Bench()
    bench.switch_on()
    bench.send(500, 500, 20)
    bench.board.has_error = True
    bench.send(500, 500, 20)
    assert bench.torques == (0.0, 0.0)
    assert bench.feedback[-1][1:3] == (500, 500)
    bench.board.has_error = False
    bench.send(500, 500, 20)
    assert bench.torques == (0.0, 0.0), "not before a command is small again"


def test_the_right_motor_stands_mirrored_and_speeds_are_rounded_down() -> None:
    bench = Bench()
    rad_s = 60.3 * math.tau / 60.0
    bench.wheels |= {"left.velocity": rad_s, "right.velocity": rad_s}
    bench.switch_on()
    _, _, _, right, left, right_count, left_count, *_ = bench.feedback[-1]
    assert (left, right) in {(60, -61), (60, -60), (59, -60)}, "in whole counts between four edges"
    turned = bench.wheels["left.angle"] / math.tau * 90
    assert left_count == pytest.approx(turned % 9000, abs=3)
    assert right_count == pytest.approx(turned % 9000, abs=3)


def test_no_speed_is_measured_more_than_125_ms_after_a_hall_edge() -> None:
    for rpm, found in ((4.0, {0}), (8.0, {7, 8})):
        bench = Bench()
        bench.wheels["left.velocity"] = rpm * math.tau / 60.0
        bench.switch_on()
        bench.run(1_000)
        assert {feedback[4] for feedback in bench.feedback[50:]} <= found


def test_the_time_between_two_packets_of_feedback_is_two_loops_of_the_firmware() -> None:
    bench = Bench()
    bench.switch_on()
    bench.feedback.clear()
    for _ in range(100):
        bench.send(0, 0)
    assert len(bench.feedback) in (98, 99, 100)


def test_an_empty_battery_switches_it_off_for_good() -> None:
    bench = Bench()
    bench.switch_on()
    bench.supply["truth.supply_voltage"] = 33.0
    bench.send(0, 0)
    bench.feedback.clear()
    for _ in range(20):
        bench.send(0, 0)
    assert bench.feedback == []


def test_a_board_that_is_left_in_peace_switches_itself_off() -> None:
    bench = Bench()
    bench.board.build = replace(bench.board.build, inactivity_timeout_min=0)
    bench.send(0, 0, 400)
    assert not bench.board.is_powered


def test_a_slow_filter_is_the_firmware_s_own() -> None:
    bench = Bench()
    bench.board.build = replace(bench.board.build, rate=480, filter=6553)
    bench.switch_on()
    bench.send(500, 500, 10)
    assert bench.torques[0] < 0.2
    for _ in range(50):
        bench.send(500, 500)
    assert bench.torques[0] == pytest.approx(1.5, abs=0.01)


def test_it_needs_a_line() -> None:
    with pytest.raises(ValueError, match="serial line only"):
        simulated_drives(SETTINGS).device(SETTINGS, NoBus(), None)
