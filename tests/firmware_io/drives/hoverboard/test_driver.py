# SPDX-License-Identifier: MIT
"""The driver alone: what it makes of feedback, and what it sends."""

import math
import struct
from collections.abc import Mapping

import msgspec
import pytest

from segway_ecc.firmware_io.drives.hoverboard.driver import Hoverboard
from segway_ecc.firmware_io.drives.hoverboard.frames import FEEDBACK
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings, HoverboardWheelSettings
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState
from segway_ecc.firmware_io.links.settings import PortSettings

MS = 1_000_000
SETTINGS = HoverboardSettings(
    serial=PortSettings(port="test"),
    left=HoverboardWheelSettings(torque_constant=0.25, max_torque=3.0),
    right=HoverboardWheelSettings(torque_constant=0.25, max_torque=1.0, direction=-1),
    serial_timeout_cycles=160,
)


class Bench:
    """A driver, its clock, and the other end of its link."""

    description = "memory"
    state = LinkState.ACTIVE

    def __init__(self, settings: HoverboardSettings = SETTINGS) -> None:
        self.counters = LinkCounters()
        self.time_ns = 1_000 * MS
        self.sent: list[tuple[int, int]] = []
        self.drive = Hoverboard(self, settings, 0.01, self)

    @property
    def health(self) -> Mapping[str, str]:
        return {}

    def open(self) -> None: ...

    def close(self) -> None: ...

    def send(self, frame: Frame) -> bool:
        self.sent.append(struct.unpack("<hh", frame.data))
        return True

    def receive(self) -> list[Frame]:
        return []

    def now_ns(self) -> int:
        return self.time_ns

    def wall_ns(self) -> int:
        return self.time_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.time_ns = deadline_ns

    def feed(self, *words: int, after_ms: int = 10) -> bool:
        """Feedback from commands on, some time later."""
        self.time_ns += after_ms * MS
        data = struct.pack(f"<{len(words)}h", *words)
        return self.drive.take_frame(Frame(FEEDBACK, data, self.time_ns))

    def echo(self, after_ms: int = 10) -> None:
        assert self.feed(*self.sent[-1], 0, 0, 3_600, 250, 0, after_ms=after_ms)

    def arm(self) -> None:
        self.drive.start()
        self.echo()
        assert self.drive.arming_failures() == []
        self.drive.enable()
        self.drive.command((1.0, 1.0))
        assert self.sent[-1] == (0, 0)
        self.echo()
        assert self.drive.is_enabled


def test_torques_become_parts_of_the_largest_current() -> None:
    bench = Bench()
    bench.arm()
    bench.drive.command((1.5, 0.75))
    assert bench.sent[-1] == (400, -200)
    bench.drive.command((99.0, -99.0))
    assert bench.sent[-1] == (800, 267)
    bench.drive.command((math.nan, 1.0))
    assert bench.sent[-1] == (0, 0)
    assert bench.drive.health["refused.range"] == "1"


def test_velocities_are_the_wheels_and_the_supply_is_measured() -> None:
    bench = Bench()
    assert list(bench.drive.signals) == ["left.velocity", "right.velocity", "supply.voltage"]
    assert bench.drive.read().valid == (False, False, False)
    bench.feed(0, 0, -60, 60, 3_650, 312, 0)
    readings = bench.drive.read()
    assert readings.values == pytest.approx((60.5 / 60 * math.tau, -59.5 / 60 * math.tau, 36.5))
    assert readings.valid == (True, True, True)
    bench.time_ns += 60 * MS
    assert bench.drive.read().valid == (False, False, True)
    assert bench.drive.health["board_deg_c"] == "31.2"


def test_angles_are_measured_where_the_firmware_sends_counts() -> None:
    bench = Bench(msgspec.structs.replace(SETTINGS, feedback="odometry"))
    assert list(bench.drive.signals)[:2] == ["left.angle", "right.angle"]
    bench.feed(0, 0, 0, 0, 8_990, 8_990, 3_600, 250, 0)
    start = bench.drive.read().values
    bench.feed(0, 0, 0, 0, 8_981, 0, 3_600, 250, 0)
    turned = [new - old for new, old in zip(bench.drive.read().values, start, strict=True)]
    assert turned[:2] == pytest.approx([10 / 90 * math.tau, 9 / 90 * math.tau])
    # Switched off for a while: it counts from 0 again, and the wheels have not turned.
    before = bench.drive.read().values[:2]
    bench.feed(0, 0, 0, 0, 0, 0, 3_600, 250, 0, after_ms=2_000)
    assert bench.drive.read().values[:2] == before


def test_velocities_are_drawn_to_the_angle_that_is_counted() -> None:
    """A wheel that creeps below what the board measures, and one whose speed is rounded by 0.4 rpm."""
    bench = Bench(msgspec.structs.replace(SETTINGS, feedback="odometry"))
    creep, fast, sums = 4.0 / 60.0 * 90.0, 600.1 / 60.0 * 90.0, [0.0, 0.0]
    for cycle in range(1_000):
        counts = [int(speed * cycle * 0.01) % 9_000 for speed in (creep, fast)]
        bench.feed(0, 0, -601, 0, counts[1], counts[0], 3_600, 250, 0)
        if cycle >= 200:
            values = bench.drive.read().values
            sums = [total + value / 800 for total, value in zip(sums, values[2:4], strict=True)]
    assert sums == pytest.approx([4.0 / 60.0 * math.tau, -600.1 / 60.0 * math.tau], abs=0.01)


def test_a_silent_board_is_not_armed_and_says_so_when_it_was() -> None:
    bench = Bench()
    (failure,) = bench.drive.arming_failures()
    assert failure.startswith("the hoverboard sends nothing intact on memory")
    bench.arm()
    bench.time_ns += 60 * MS
    assert bench.drive.faults() == ("the feedback of the hoverboard is too old: 60 ms",)
    bench.drive.command((1.0, 1.0))
    assert bench.sent[-1] == (0, 0), "in the cycle that finds it silent"
    assert not bench.drive.is_off


def test_a_board_that_does_not_take_commands_is_a_fault() -> None:
    bench = Bench()
    bench.arm()
    for _ in range(30):
        bench.drive.command((1.5, 0.0))
        bench.feed(0, 0, 0, 0, 3_600, 250, 0)
    (fault,) = bench.drive.faults()
    assert fault.startswith("the hoverboard does not take what is sent: (0, 0) comes back")
    (failure,) = bench.drive.arming_failures()
    assert failure == fault


def test_a_zero_that_comes_back_shows_that_the_motors_are_off() -> None:
    bench = Bench()
    bench.arm()
    bench.drive.command((1.5, 0.0))
    bench.echo()
    assert bench.drive.faults() == ()
    bench.drive.disable()
    assert bench.sent[-1] == (0, 0)
    assert not bench.drive.is_off
    bench.echo()
    assert bench.drive.is_off


def test_enabling_ends_when_no_zero_comes_back() -> None:
    bench = Bench()
    bench.drive.start()
    bench.echo()
    bench.drive.enable()
    for _ in range(60):
        bench.drive.command((0.0, 0.0))
        bench.feed(5, 0, 0, 0, 3_600, 250, 0)
    assert not bench.drive.is_enabled
    assert bench.drive.faults()[0].startswith("the hoverboard does not take what is sent")


def test_what_is_not_intact_is_counted() -> None:
    bench = Bench()
    assert not bench.feed(1_001, 0, 0, 0, 3_600, 250, 0)
    assert not bench.feed(0)
    assert bench.drive.health["refused.range"] == bench.drive.health["refused.length"] == "1"
