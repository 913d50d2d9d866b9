# SPDX-License-Identifier: MIT
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from msgspec import structs

from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.imus.xsens_mti.driver import XsensMti
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.devices.xsens_mti import SimulatedXsensMti
from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_robot
from segway_ecc.node.config import RobotFile, load_robot
from segway_ecc.node.robot import build_robot
from segway_ecc.node.sequence.manoeuvre import single_segment

MS = 1_000_000
NAMES = [f"imu.{quantity}_{axis}" for quantity in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
LEANING = dict(zip(NAMES, (0.5, -1.0, 2.0, 1.5, -0.5, 9.75), strict=True))
"""All of them are whole counts."""


class Bench:
    """A sensor that is ticked, on a bus so fast that what is sent has arrived before the next tick."""

    def __init__(self, tick_ms: int = 5, **options: Any) -> None:
        self.now_ns = 7 * MS
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        self.host = bus.attach("host")
        settings = XsensMtiSettings(**options)
        self.imu = SimulatedXsensMti(bus.attach("imu"), settings)
        self.driver = XsensMti(self.host, settings, 0.01, lambda: self.now_ns)
        self.outputs = dict(LEANING)
        self._tick_ns = tick_ms * MS

    def tick(self, times: int = 1) -> None:
        for _ in range(times):
            assert tuple(self.imu.obey([], self.now_ns, self.outputs)) == ()
            self.imu.send_telemetry(self.now_ns, self.outputs)
            self.now_ns += self._tick_ns

    def heard(self) -> list[Frame]:
        return self.host.receive()

    def counters(self) -> list[tuple[float, int]]:
        """When each group counter came, ms since the first tick, and what it was."""
        return [
            (round(frame.received_ns / MS) - 7, int.from_bytes(frame.data, "big"))
            for frame in self.heard()
            if frame.arbitration_id == 0x006
        ]


def test_it_moves_nothing_and_measures_the_plants_imu_outputs() -> None:
    assert SimulatedXsensMti.inputs == ()
    assert sorted(SimulatedXsensMti.needs) == sorted(NAMES)
    assert Bench().imu.refused_frames == 0


def test_a_set_is_counter_time_rate_and_acceleration_and_no_orientation() -> None:
    bench = Bench()
    bench.tick(3)
    frames = {frame.arbitration_id: frame.data for frame in bench.heard()[-4:]}
    assert frames == {
        0x005: struct.pack(">I", 100),  # 10 ms in ticks of 100 us
        0x006: struct.pack(">H", 2),
        0x032: struct.pack(">3h", 256, -512, 1024),  # 512 counts for 1 rad/s
        0x034: struct.pack(">3h", 384, -128, 2496),  # 256 counts for 1 m/s2
    }


def test_sample_time_in_microseconds() -> None:
    bench = Bench(sample_time_unit="us")
    bench.tick(2)
    assert [f.data for f in bench.heard() if f.arbitration_id == 0x005] == [struct.pack(">I", n) for n in (0, 5000)]


@pytest.mark.parametrize(
    ("tick_ms", "period_ms"), [(1, 1), (1, 2), (1, 5), (5, 5), (5, 10)], ids=lambda number: f"{number} ms"
)
def test_one_set_comes_each_period(tick_ms: int, period_ms: int) -> None:
    bench = Bench(tick_ms, period_s=period_ms * 1e-3)
    bench.tick(100 // tick_ms)
    assert bench.counters() == [(count * period_ms, count) for count in range(100 // period_ms)]


def test_a_tick_that_comes_late_is_made_up_for() -> None:
    bench = Bench(tick_ms=1, period_s=0.005)
    bench.tick(5)
    bench.now_ns += 3 * MS
    bench.tick(13)
    assert bench.counters() == [(0, 0), (8, 1), (10, 2), (15, 3), (20, 4)]


def test_what_is_too_much_is_the_end_of_the_range() -> None:
    bench = Bench()
    bench.outputs |= dict(zip(NAMES, (35.1, -1e6, 34.0, 100.1, -1e9, 99.0), strict=True))
    bench.tick()
    rate, force = (frame.data for frame in bench.heard() if frame.arbitration_id in {0x032, 0x034})
    assert struct.unpack(">3h", rate) == (35 * 512, -35 * 512, 34 * 512)
    assert struct.unpack(">3h", force) == (100 * 256, -100 * 256, 99 * 256)


def test_a_sensor_that_hangs_sends_the_same_set_again_and_again() -> None:
    bench = Bench()
    bench.tick(2)
    first = bench.heard()[-4:]
    bench.imu.frozen = True
    bench.outputs["imu.angular_velocity_x"] = 3.0
    bench.tick(2)
    assert [f.data for f in bench.heard()] == 2 * [f.data for f in first]
    bench.imu.frozen = False
    bench.tick()
    assert bench.heard()[-2].data[:2] == struct.pack(">h", 3 * 512)


def test_it_sleeps_from_one_set_to_the_next() -> None:
    bench = Bench(tick_ms=1, period_s=0.005)
    begun_ns = bench.now_ns
    bench.tick()
    assert bench.imu.next_ns == begun_ns + 5 * MS
    bench.tick(7)
    assert bench.imu.next_ns == begun_ns + 10 * MS
    bench.imu.powered = False
    assert bench.imu.next_ns == -math.inf


def test_a_sensor_that_is_switched_off_is_silent_and_begins_anew_when_switched_on() -> None:
    bench = Bench()
    bench.tick(20)
    bench.heard()
    bench.imu.powered = False
    bench.tick(20)
    assert bench.heard() == []
    bench.imu.powered = True
    bench.tick(2)
    frames = [(f.arbitration_id, int.from_bytes(f.data, "big")) for f in bench.heard() if f.arbitration_id < 0x10]
    assert sorted(frames) == [(0x005, 0), (0x005, 50), (0x006, 0), (0x006, 1)]


@pytest.mark.parametrize("mounting", [("+x", "+y", "+z"), ("+y", "+z", "+x"), ("-y", "-x", "-z")], ids=" ".join)
@pytest.mark.parametrize("extended_ids", [False, True])
def test_the_driver_reads_the_plants_outputs(mounting: tuple[str, ...], *, extended_ids: bool) -> None:
    bench = Bench(mounting=mounting, extended_ids=extended_ids)
    bench.tick(2)
    taken = [bench.driver.take_frame(frame) for frame in bench.heard()]
    assert taken == [True] * 8
    assert bench.driver.read().values == tuple(LEANING.values())
    assert all(bench.driver.read().valid)
    assert bench.driver.health["sample_period_s"] == "0.005000"


def with_imu(**options: Any) -> RobotFile:
    """The cart on CAN with an IMU; without noise, as the simulated one is, values repeat in rest and steady motion."""
    file = load_robot("cart-can")
    assert file.safety is not None
    safety = structs.replace(file.safety, frozen_after_s=None)
    hardware = WheelBoardSettings(external_imu=XsensMtiSettings(**options))
    return structs.replace(file, hardware=hardware, safety=safety)


def test_a_robot_file_that_asks_for_an_imu_has_one_at_both_ends() -> None:
    rig = LockstepRig(500_000)
    robot = build_robot(with_imu(), rig, rig.bus.attach("node"))
    assert list(robot.hardware.signals)[-6:] == NAMES
    assert [name for name in robot.wiring.published if name.startswith("imu.")] == NAMES
    plain = build_robot(load_robot("cart-can"), rig, rig.bus.attach("node"))
    assert not set(NAMES) & {*plain.hardware.signals, *plain.wiring.published}


def test_an_imu_that_the_rig_cannot_be_in_time_for_is_refused() -> None:
    rig = LockstepRig(500_000)
    with pytest.raises(NoSimulationError, match=r"^the simulated drives tick every 5 ms: make external_imu\.period_s"):
        simulated_robot(with_imu(period_s=0.004), rig.bus.attach("plant"))


def messages(path: Path, topic: str) -> Iterator[Any]:
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, _, message in reader.iter_decoded_messages(topics=[topic]):
            yield message


def test_a_cart_in_lock_step_logs_what_its_imu_measures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("segway_ecc.hil.case_study.can.load_robot", lambda _: with_imu(mounting=("-y", "+x", "+z")))
    LockstepCanSeat(tmp_path).run("turn", single_segment(0.5, 1.0, 2.0))
    log = tmp_path / "can_turn.mcap"
    imu = list(messages(log, "/imu/data"))
    wheels = [(m.velocity[0], m.velocity[1]) for m in messages(log, "/joint_states")]
    last = imu[-1]

    assert len(imu) == len(wheels) > 150
    assert last.header.frame_id == "imu_link"
    # A wheel of 0.05 m on a track of 0.3 m; counts of 1/512 rad/s and 1/256 m/s2, and a cycle between the two.
    left, right = wheels[-1]
    yaw_rate, speed = 0.05 * (right - left) / 0.3, 0.05 * (left + right) / 2
    assert yaw_rate == pytest.approx(1.0, abs=0.01)
    assert last.angular_velocity.z == pytest.approx(yaw_rate, abs=0.01)
    assert last.linear_acceleration.y == pytest.approx(yaw_rate * speed, abs=0.02)
    assert last.linear_acceleration.z == pytest.approx(9.80665, abs=1 / 512)
    assert (last.angular_velocity.x, last.angular_velocity.y) == (0.0, 0.0)
    ages = [message.age_s.imu_angular_velocity_z for message in messages(log, "/cycle")]
    assert max(ages[5:]) < 0.012
