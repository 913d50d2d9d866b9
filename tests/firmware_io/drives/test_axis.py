# SPDX-License-Identifier: MIT
"""What drives of one axis share, by one whose reports are three numbers of a byte each."""

import math
from collections.abc import Sequence

import pytest

from segway_ecc.firmware_io.devices import Freshness
from segway_ecc.firmware_io.drives.axis import REPORT, ReportingAxis
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.settings import WheelSettings
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

MS = 1_000_000
GEARED = WheelSettings(max_torque=4.0, gear_ratio=2.0, direction=-1)


class Byte(ReportingAxis):
    """Reports angle, velocity and torque of its motor as bytes, then 1 where it follows."""

    def _take(self, frame: Frame) -> None:
        if len(frame.data) != 4:
            raise FrameRefusedError(Refusal.LENGTH, "report")
        angle, velocity, torque, follows = frame.data
        self._report((angle, velocity, torque), frame.received_ns, is_off=not follows, follows=bool(follows))


class Bench:
    def __init__(self) -> None:
        self.now_ns = 100 * MS
        link = SimulatedBus(500_000, self.clock).attach("node")
        self.drive = Byte(link, "pan", GEARED, Freshness({REPORT: 30 * MS}, self.clock), self.clock)

    def clock(self) -> int:
        return self.now_ns

    def is_off(self) -> bool:
        return self.drive.is_off

    def is_enabled(self) -> bool:
        return self.drive.is_enabled

    def report(self, *data: int) -> bool:
        return self.drive.take_frame(Frame(0x100, bytes(data), self.now_ns))

    def motor_torques(self, torques: Sequence[float]) -> list[float]:
        return [self.drive._motor_torque(torque) for torque in torques]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_it_names_what_it_measures_and_takes(bench: Bench) -> None:
    assert list(bench.drive.signals) == ["pan.angle", "pan.velocity", "pan.torque"]
    assert (dict(bench.drive.commands), bench.drive.limits) == ({"pan.torque": "N m"}, (4.0,))


def test_a_report_is_that_of_the_wheel_and_as_old_as_it_is(bench: Bench) -> None:
    assert bench.drive.read().valid == (False,) * 3
    assert bench.report(6, 4, 1, 0)
    bench.now_ns += 20 * MS
    assert bench.drive.read() == bench.drive.read().__class__((-3.0, -2.0, -2.0), (0.02,) * 3, (True,) * 3)
    bench.now_ns += 31 * MS
    assert bench.drive.read().valid == (False,) * 3


def test_a_frame_that_is_refused_is_counted_by_cause(bench: Bench) -> None:
    assert not bench.report(1, 2)
    assert not bench.report(1)
    assert bench.drive._refusals == {"refused.length": "2"}
    assert bench.drive.read().valid == (False,) * 3


def test_it_is_off_by_a_fresh_report_alone(bench: Bench) -> None:
    assert not bench.is_off()
    bench.report(0, 0, 0, 0)
    assert bench.is_off()
    bench.report(0, 0, 0, 1)
    assert not bench.is_off()
    bench.report(0, 0, 0, 0)
    bench.now_ns += 51 * MS
    assert not bench.is_off()


def test_it_is_enabled_once_it_reports_to_follow(bench: Bench) -> None:
    bench.report(0, 0, 0, 1)
    assert not bench.is_enabled(), "nobody has asked for it"
    bench.drive._enabling.begin(bench.now_ns)
    bench.report(0, 0, 0, 0)
    assert not bench.is_enabled()
    bench.report(0, 0, 0, 1)
    assert bench.is_enabled()


def test_torque_is_the_motor_s_within_the_limit_and_a_number(bench: Bench) -> None:
    assert bench.motor_torques([1.0, 9.0, -9.0, math.nan, math.inf]) == [-0.5, -2.0, 2.0, 0.0, 0.0]
    assert bench.drive._refusals == {"refused.range": "2"}


def test_a_family_has_to_say_how_a_frame_is_taken() -> None:
    drive = ReportingAxis(
        SimulatedBus(500_000, lambda: 0).attach("node"), "pan", GEARED, Freshness({REPORT: 1}, lambda: 0), lambda: 0
    )
    with pytest.raises(NotImplementedError):
        drive.take_frame(Frame(0x100, b""))
