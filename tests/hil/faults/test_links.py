# SPDX-License-Identifier: MIT
"""What becomes of frames and bytes on links that fail."""

import pytest

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.faults.fault import Fault, Injections, Target, Type
from segway_ecc.hil.faults.links import CutOnlyLine, DisturbedBus, DisturbedDevicesLink, DisturbedLine
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial

MS = 1_000_000


class Bench:
    """The robot's end and the devices' end of a bus, both with one fault, from the beginning."""

    def __init__(  # noqa: PLR0913, PLR0917 - a fault in full
        self,
        target: Target,
        kind: Type,
        amount: float | None = None,
        seed: int = 0,
        at_s: float = 0.0,
        for_s: float | None = None,
    ) -> None:
        self.ns = 1_000 * MS
        fault = Fault(target=target, type=kind, at_s=at_s, for_s=for_s, amount=amount)
        faults = Injections([fault], seed, lambda: self.ns)
        bus = SimulatedBus(500_000, lambda: self.ns)
        self.robot = DisturbedBus(bus.attach("robot"), faults, lambda: self.ns)
        self.devices = DisturbedDevicesLink(bus.attach("devices"), faults, {(0x50, False)})
        faults.timeline.start()
        self.ns += 100 * MS

    def to_devices(self, *frames: Frame) -> list[bytes]:
        sent = [self.robot.send(frame) for frame in frames]
        self.sent = all(sent)
        self.ns += 5 * MS
        return [frame.data for frame in self.devices.receive()]

    def to_robot(self, *frames: Frame) -> list[bytes]:
        for frame in frames:
            self.devices.send(frame)
        self.ns += 5 * MS
        return [frame.data for frame in self.robot.receive()]


def frames(count: int, arbitration_id: int = 0x10) -> list[Frame]:
    return [Frame(arbitration_id, bytes([n])) for n in range(count)]


def datas(count: int) -> list[bytes]:
    return [bytes([n]) for n in range(count)]


def test_a_cut_bus_carries_nothing_and_reports_nothing() -> None:
    bench = Bench("can", "off")
    assert bench.to_devices(*frames(3)) == []
    assert bench.sent
    assert bench.to_robot(*frames(3)) == []


def test_without_telemetry_commands_still_pass() -> None:
    bench = Bench("can", "stale")
    assert bench.to_devices(*frames(3)) == datas(3)
    assert bench.to_robot(*frames(3)) == []


def test_bytes_are_in_the_other_order_either_way() -> None:
    bench = Bench("can", "swapped")
    assert bench.to_devices(Frame(0x10, b"\x01\x02\x03")) == [b"\x03\x02\x01"]
    assert bench.to_robot(Frame(0x50, b"\x04\x05")) == [b"\x05\x04"]


def test_a_full_queue_refuses_while_telemetry_goes_on() -> None:
    bench = Bench("can", "stuck")
    assert bench.to_devices(*frames(3)) == []
    assert not bench.sent
    assert bench.to_robot(*frames(3)) == datas(3)


@pytest.mark.parametrize(("share", "left"), [(1.0, 0), (0.0, 20)])
def test_frames_are_lost_at_their_probability(share: float, left: int) -> None:
    bench = Bench("can", "intermittent", share)
    assert len(bench.to_devices(*frames(20))) == left
    assert len(bench.to_robot(*frames(20))) == left


def test_about_half_of_the_frames_are_lost_and_the_same_ones_for_the_same_seed() -> None:
    kept = [Bench("can", "intermittent", 0.5, seed).to_devices(*frames(16)) for seed in (3, 3, 4)]
    assert 3 <= len(kept[0]) <= 13
    assert kept[0] == kept[1] != kept[2]


def test_spoilt_frames_differ_in_one_to_three_bits() -> None:
    zero = Frame(0x10, bytes(8))
    spoilt = Bench("can", "garbage", 1.0).to_devices(*[zero] * 15)
    bits = {int.from_bytes(data, "little").bit_count() for data in spoilt}
    assert len(spoilt) == 15
    assert bits == {1, 2, 3}


def test_a_frame_without_data_cannot_be_spoilt() -> None:
    assert Bench("can", "garbage", 1.0).to_devices(Frame(0x10, b"")) == [b""]


def test_after_each_frame_the_one_before_it_comes_again() -> None:
    bench = Bench("can", "wrong")
    assert bench.to_robot(*frames(3)) == [b"\0", b"\1", b"\0", b"\2", b"\1"]
    assert bench.to_robot(Frame(0x11, b"x")) == [b"x"]


def test_frames_are_late_both_ways_and_stamped_when_they_arrive() -> None:
    bench = Bench("can", "delayed", 0.02)
    assert bench.to_devices(Frame(0x10, b"a")) == []
    assert bench.to_robot(Frame(0x11, b"b")) == []
    bench.ns += 18 * MS
    (late,) = bench.robot.receive()
    bench.ns += 2 * MS
    assert [frame.data for frame in bench.devices.receive()] == [b"a"]
    on_wire_ns = round((55 + 10) * 1e9 / 500_000)  # worst case of one byte, 11-bit identifier
    assert late.received_ns == 1_105 * MS + on_wire_ns + 20 * MS


def test_no_frame_overtakes_those_that_are_still_late_when_the_fault_is_over() -> None:
    bench = Bench("can", "delayed", 0.02, for_s=0.107)
    assert bench.to_robot(Frame(0x11, b"a")) == []
    assert bench.to_devices(Frame(0x10, b"c")) == []
    assert bench.to_robot(Frame(0x11, b"b")) == []
    assert bench.to_devices(Frame(0x10, b"d")) == []
    bench.ns += 20 * MS
    assert [frame.data for frame in bench.robot.receive()] == [b"a", b"b"]
    bench.ns += 1 * MS
    assert [frame.data for frame in bench.devices.receive()] == [b"c", b"d"]


def test_what_waits_to_be_sent_goes_whenever_the_robot_looks_at_its_bus() -> None:
    bench = Bench("can", "delayed", 0.02, for_s=0.101)
    assert bench.to_devices(Frame(0x10, b"a")) == []
    bench.ns += 20 * MS
    assert bench.robot.receive() == []
    bench.ns += 1 * MS
    assert [frame.data for frame in bench.devices.receive()] == [b"a"]


def test_the_frame_before_it_is_known_from_before_the_fault() -> None:
    bench = Bench("can", "wrong", at_s=0.111)
    assert bench.to_robot(Frame(0x10, b"a")) == [b"a"]
    assert bench.to_devices(Frame(0x10, b"x")) == [b"x"]
    bench.ns += 5 * MS
    assert bench.to_robot(Frame(0x10, b"b")) == [b"b", b"a"]
    assert bench.to_devices(Frame(0x10, b"y")) == [b"y", b"x"]


def test_nothing_leaves_a_dead_process() -> None:
    bench = Bench("serial", "off")
    bench.robot.is_dead = True
    assert bench.to_devices(*frames(3)) == []


def test_an_imu_that_is_off_is_silent_and_the_others_are_not() -> None:
    bench = Bench("imu", "off")
    assert bench.to_robot(Frame(0x50, b"i"), Frame(0x51, b"w")) == [b"w"]
    assert bench.to_devices(Frame(0x50, b"c")) == [b"c"]


def test_an_imu_loses_some_of_its_frames() -> None:
    assert 3 <= len(Bench("imu", "intermittent", 0.5).to_robot(*frames(16, 0x50))) <= 13
    assert Bench("imu", "intermittent", 1.0).to_robot(*frames(16, 0x51)) == datas(16)


def test_without_supply_nothing_is_sent_or_received() -> None:
    bench = Bench("battery", "off")
    assert bench.to_robot(*frames(3)) == []
    assert bench.to_devices(*frames(3)) == []


class SerialBench:
    def __init__(self, target: Target, kind: Type, for_s: float | None = 0.1) -> None:
        self.ns = 0
        faults = Injections([Fault(target=target, type=kind, at_s=0.1, for_s=for_s)], 0, lambda: self.ns)
        self.wires = SimulatedSerial(921_600, lambda: self.ns)
        self.line = DisturbedLine(self.wires, faults, 5 * MS)
        faults.timeline.start()

    def at(self, ms: int) -> None:
        self.ns = ms * MS
        self.line.act()


@pytest.mark.parametrize("target", ["serial", "battery"])
def test_a_line_is_cut(target: Target) -> None:
    bench = SerialBench(target, "off", 0.1 if target == "serial" else None)
    seen = []
    for ms in (95, 100, 195, 200):
        bench.at(ms)
        seen.append(bench.wires.cut)
    assert seen == [False, True, True, target == "battery"]


def test_a_port_is_gone_and_comes_back() -> None:
    bench = SerialBench("serial", "stuck")
    bench.at(95)
    assert bench.wires.host.in_waiting == 0
    bench.at(100)
    with pytest.raises(OSError, match="unplugged"):
        _ = bench.wires.host.in_waiting
    bench.at(200)
    assert bench.wires.host.in_waiting == 0


def test_noise_arrives_at_its_rate() -> None:
    bench = SerialBench("serial", "garbage")
    for ms in range(0, 300, 5):
        bench.at(ms)
    assert bench.wires.host.in_waiting == 100  # 1000 bytes/s for 0.1 s
    assert len(set(bench.wires.host.read(100))) > 50


def test_a_line_in_place_of_a_bus_is_cut_while_that_would_be() -> None:
    clock = [0]
    wires = SimulatedSerial(115_200, lambda: clock[0])
    cut = Fault(target="can", type="off", at_s=0.1, for_s=0.1)
    faults = Injections([cut, Fault(target="can", type="stale", at_s=0.0)], 0, lambda: clock[0])
    line = CutOnlyLine(wires, faults, "can", "battery")
    faults.timeline.start()
    arrived = {}
    for at_ms in (50, 150, 250):
        clock[0] = at_ms * MS
        line.act()
        wires.host.write(b"zero")
        wires.device.write(b"told")
        clock[0] += 10 * MS
        arrived[at_ms] = (wires.device.read(9), wires.host.read(9))
    assert arrived == {50: (b"zero", b"told"), 150: (b"", b""), 250: (b"zero", b"told")}


@pytest.mark.parametrize(("target", "targets"), [("battery", ("can", "battery")), ("imu", ("imu", "battery"))])
def test_a_line_in_place_of_a_bus_is_silent_without_supply_and_that_of_an_imu_that_is_off_too(
    target: Target, targets: tuple[Target, ...]
) -> None:
    clock = [0]
    wires = SimulatedSerial(115_200, lambda: clock[0])
    off = Fault(target=target, type="off", at_s=0.1)
    faults = Injections([off, Fault(target="serial", type="off", at_s=0.0)], 0, lambda: clock[0])
    line = CutOnlyLine(wires, faults, *targets)
    faults.timeline.start()
    seen = []
    for at_ms in (95, 100, 900):
        clock[0] = at_ms * MS
        line.act()
        seen.append(wires.cut)
    assert seen == [False, True, True]
