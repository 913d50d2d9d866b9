# SPDX-License-Identifier: MIT
"""Two simulated controllers; expected values are those of the firmware's documents."""

import math
import random
from collections.abc import Mapping

import pytest

from segway_ecc.firmware_io.drives.vesc.frames import (
    Current,
    CurrentLimits,
    Duty,
    PacketId,
    Payload,
    Ping,
    Position,
    RelativeCurrent,
    Speed,
    ask_selective,
    decode,
    decode_values,
    frame_of,
    mask_of,
)
from segway_ecc.firmware_io.drives.vesc.packets import Mode, PacketReceiver, frame_packet, frames_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.devices.vesc import TICK_NS, Firmware, SimulatedVesc, VescFault
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

LEFT = VescWheelSettings(controller_id=1, pole_pairs=7, torque_constant=0.1, max_torque=3.0)
RIGHT = VescWheelSettings(
    controller_id=2, pole_pairs=7, torque_constant=0.1, max_torque=3.0, gear_ratio=2.0, direction=-1
)
SETTINGS = VescSettings(axes={"left": LEFT, "right": RIGHT}, timeout_set_s=0.05)
RESTING = {"left.angle": 0.0, "left.velocity": 0.0, "right.angle": 0.0, "right.velocity": 0.0}


class Pipe:
    """A serial port in memory."""

    def __init__(self) -> None:
        self.to_device = b""
        self.from_device = b""

    @property
    def in_waiting(self) -> int:
        return len(self.to_device)

    def read(self, size: int, /) -> bytes:
        data, self.to_device = self.to_device[:size], self.to_device[size:]
        return data

    def write(self, data: bytes, /) -> int:
        self.from_device += data
        return len(data)

    def close(self) -> None:
        """Nothing to close."""


class Bench:
    """Both controllers on a bus so fast that what is sent has arrived before the next tick."""

    def __init__(self, firmware: Firmware | None = None, settings: VescSettings = SETTINGS) -> None:
        self.now_ns = 0
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        self.host = bus.attach("host")
        self._end = bus.attach("vesc")
        self.port = Pipe()
        self.vesc = SimulatedVesc(self._end, settings, self.port, firmware)
        self.outputs: Mapping[str, float] = RESTING
        self.torques: tuple[float, ...] = (0.0, 0.0)

    def send(self, command: PacketId, payload: Payload, controller_id: int = 1) -> None:
        self.host.send(frame_of(command, controller_id, payload))

    def run(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.now_ns += TICK_NS
            self.torques = tuple(self.vesc.obey(self._end.receive(), self.now_ns, self.outputs))
            self.vesc.send_telemetry(self.now_ns, self.outputs)

    def has_timed_out(self) -> bool:
        return self.vesc.controllers["left"].has_timed_out

    def heard(self) -> list[Frame]:
        self.now_ns += 1_000
        return self.host.receive()

    def ask(self, *names: str, controller_id: int = 1) -> dict[str, float]:
        """Over the UART."""
        packet = ask_selective(mask_of(names))
        if controller_id != 1:
            packet = bytes((34, controller_id)) + packet
        self.port.to_device += frame_packet(packet)
        self.run()
        replies = PacketReceiver().feed(self.port.from_device)
        self.port.from_device = b""
        return decode_values(replies[-1])[1] if replies else {}


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_is_a_device_for_both_wheels(bench: Bench) -> None:
    device: Device = bench.vesc
    assert list(device.inputs) == ["left.torque", "right.torque"]
    assert set(device.needs) == set(RESTING)
    assert TICK_NS == 1_000_000


def test_current_follows_with_a_lag_and_becomes_torque_at_the_wheel(bench: Bench) -> None:
    bench.send(PacketId.SET_CURRENT, Current(10.0))
    bench.send(PacketId.SET_CURRENT, Current(10.0), 2)
    bench.run()
    assert bench.torques == pytest.approx(((1 - math.exp(-1)), -2 * (1 - math.exp(-1))))
    bench.run(20)
    assert bench.torques == pytest.approx((1.0, -2.0))


@pytest.mark.parametrize(
    ("command", "payload", "amperes"),
    [
        (PacketId.SET_CURRENT, Current(1e6), 60.0),
        (PacketId.SET_CURRENT, Current(-61.0), -60.0),
        (PacketId.SET_CURRENT, Current(0.049), 0.0),
        (PacketId.SET_CURRENT_REL, RelativeCurrent(0.5), 30.0),
        (PacketId.SET_CURRENT_REL, RelativeCurrent(-7.0), -60.0),
        (PacketId.SET_CURRENT_BRAKE, Current(4.0), -4.0),
        (PacketId.SET_CURRENT_HANDBRAKE, Current(4.0), -4.0),
        (PacketId.SET_CURRENT_BRAKE_REL, RelativeCurrent(0.1), -6.0),
        (PacketId.SET_CURRENT_HANDBRAKE_REL, RelativeCurrent(0.1), -6.0),
        (PacketId.SET_DUTY, Duty(0.10), (3.6 - 3.0) / 0.1),
        (PacketId.SET_DUTY, Duty(-5.0), -60.0),
        (PacketId.SET_RPM, Speed(3005), (3005 - 2005) * 0.01),
        (PacketId.SET_POS, Position(90.0), math.pi / 2 * 5.0),
    ],
)
def test_each_mode_asks_for_a_current_within_the_limit(
    bench: Bench, command: PacketId, payload: Payload, amperes: float
) -> None:
    bench.outputs = RESTING | {"left.velocity": 30.0}  # 30 * 7 * 60 / tau = 2005 electrical turns a minute
    bench.send(command, payload)
    bench.run(20)
    assert bench.vesc.controllers["left"].current == pytest.approx(amperes, abs=1e-4)


def test_a_brake_at_rest_gives_no_torque(bench: Bench) -> None:
    bench.send(PacketId.SET_CURRENT_BRAKE, Current(4.0))
    bench.run(20)
    assert bench.torques[0] == 0.0


def test_everybody_obeys_the_identifier_of_all(bench: Bench) -> None:
    bench.send(PacketId.SET_CURRENT, Current(10.0), 255)
    bench.run(20)
    assert bench.torques == pytest.approx((1.0, -2.0))


@pytest.mark.parametrize(
    ("command", "payload"),
    [
        (PacketId.SET_CURRENT, Current(10.0)),
        (PacketId.SET_DUTY, Duty(0.1)),
        (PacketId.SET_RPM, Speed(1000)),
        (PacketId.SET_POS, Position(90.0)),
        (PacketId.SET_CURRENT_REL, RelativeCurrent(0.1)),
    ],
)
def test_silence_lets_the_motor_go_in_every_mode_and_a_command_drives_it_again(
    bench: Bench, command: PacketId, payload: Payload
) -> None:
    bench.send(command, payload)
    bench.run(50)
    assert not bench.has_timed_out()
    assert bench.torques[0] != 0.0
    bench.run(11)  # it looks every 10 ms
    assert bench.has_timed_out()
    bench.run(20)
    assert bench.torques[0] == pytest.approx(0.0, abs=1e-6)
    bench.send(command, payload)
    bench.run(20)
    assert not bench.has_timed_out()
    assert bench.torques[0] != pytest.approx(0.0, abs=1e-3)


def test_a_time_out_may_brake() -> None:
    bench = Bench(Firmware(timeout_s=0.05, timeout_brake_current=5.0))
    bench.outputs = RESTING | {"left.velocity": -3.0}
    bench.run(80)
    assert bench.vesc.controllers["left"].current == pytest.approx(5.0, abs=1e-3)


def test_a_new_controller_waits_a_second_and_sends_nothing() -> None:
    bench = Bench(Firmware())
    bench.send(PacketId.SET_CURRENT, Current(10.0))
    bench.run(990)
    assert bench.torques[0] == pytest.approx(1.0)
    bench.run(40)
    assert bench.torques[0] == pytest.approx(0.0, abs=1e-3)
    assert bench.heard() == []


def test_a_time_out_of_zero_is_none() -> None:
    bench = Bench(Firmware(timeout_s=0.0))
    bench.send(PacketId.SET_CURRENT, Current(10.0))
    bench.run(3_000)
    assert bench.torques[0] == pytest.approx(1.0)


def test_status_comes_at_its_rate_from_both(bench: Bench) -> None:
    bench.run(1_000)
    identifiers = [frame.arbitration_id for frame in bench.heard()]
    assert {i: identifiers.count(i) for i in set(identifiers)} == {0x901: 200, 0x1B01: 200, 0x902: 200, 0x1B02: 200}


def test_each_message_can_be_set_to_a_rate() -> None:
    bench = Bench(Firmware(status={1: 50.0, 2: 5.0, 3: 5.0, 4: 10.0, 5: 50.0, 6: 1.0}))
    bench.run(1_000)
    frames = [frame for frame in bench.heard() if frame.arbitration_id & 0xFF == 1]
    counts = [sum(f.arbitration_id >> 8 == command for f in frames) for command in (9, 14, 15, 16, 27, 58)]
    assert counts == [50, 5, 5, 10, 50, 1]
    assert all(len(frame.data) == 8 for frame in frames)


def test_status_reports_what_is_measured(bench: Bench) -> None:
    bench.send(PacketId.SET_CURRENT, Current(10.0), 2)
    bench.outputs = {"left.angle": 1.0, "left.velocity": 30.0, "right.angle": 1.0, "right.velocity": 30.0}
    bench.run(26)
    told = {f.arbitration_id: decode(f.arbitration_id >> 8, f.data) for f in bench.heard()}
    assert told[0x901] == pytest.approx((2005, 0.0, 0.083))
    assert told[0x902] == pytest.approx((-4010, -10.0, -0.139)), "it brakes; 10 A take 28 thousandths"
    assert told[0x1B01] == pytest.approx((6, 36.0))  # 42 / tau = 6.7 steps
    assert told[0x1B02] == pytest.approx((-14, 36.0))  # -84 / tau = -13.4 steps


def test_the_tachometer_wraps(bench: Bench) -> None:
    bench.outputs = RESTING | {"left.angle": (2**31 + 0.5) * math.tau / 42}
    assert bench.ask("tachometer") == {"tachometer": -(2**31)}


@pytest.mark.parametrize("fault", [VescFault.OVER_VOLTAGE, VescFault.OVER_TEMPERATURE])
def test_a_fault_frees_the_motor_for_half_a_second(bench: Bench, fault: VescFault) -> None:
    bench.vesc.controllers["left"].fail(fault)
    for tick in range(501):
        bench.send(PacketId.SET_CURRENT, Current(10.0))
        if tick == 499:
            assert bench.ask("fault") == {"fault": int(fault)}
            assert bench.torques[0] == 0.0
        bench.run()
    assert bench.ask("fault") == {"fault": 0}
    bench.send(PacketId.SET_CURRENT, Current(10.0))
    bench.run(20)
    assert bench.torques[0] == pytest.approx(1.0)


def test_a_ping_is_answered(bench: Bench) -> None:
    bench.send(PacketId.PING, Ping(200), 2)
    bench.run()
    pongs = [(f.arbitration_id, f.data) for f in bench.heard() if f.arbitration_id >> 8 == 18]
    assert pongs == [(0x12C8, b"\x02\x00")]


@pytest.mark.parametrize("controller_id", [1, 2])
def test_the_uart_reaches_both(bench: Bench, controller_id: int) -> None:
    packet = bytes.fromhex("0600002710")  # 10 A
    bench.port.to_device = frame_packet(packet if controller_id == 1 else b"\x22\x02" + packet)
    bench.run(20)
    assert bench.torques == pytest.approx((1.0, 0.0) if controller_id == 1 else (0.0, -2.0))
    assert bench.ask("controller_id", controller_id=controller_id) == {"controller_id": controller_id}


def test_the_uart_may_be_that_of_the_right_controller() -> None:
    bench = Bench(
        settings=VescSettings(axes={"left": LEFT, "right": RIGHT}, timeout_set_s=0.05, serial_controller="right")
    )
    bench.port.to_device = frame_packet(bytes.fromhex("0600002710"))
    bench.run(20)
    assert bench.torques == pytest.approx((0.0, -2.0))


def test_what_is_handed_on_passes_over_the_bus(bench: Bench) -> None:
    bench.run(2)
    bench.heard()
    assert bench.ask("erpm", "fault", controller_id=2)
    commands = [(f.arbitration_id >> 8, f.arbitration_id & 0xFF) for f in bench.heard()]
    on_the_way = sorted(command for command in commands if command[0] < 9)
    assert on_the_way == [(5, 1), (5, 1), (7, 1), (8, 2)], "the question in one frame, ten bytes back in three"


def test_a_broken_bus_between_them_cuts_the_far_one_off(bench: Bench) -> None:
    bench.vesc.bus_is_whole = False
    assert bench.ask("fault", controller_id=2) == {}
    assert bench.ask("fault") == {"fault": 0}


def test_somebody_else_behind_the_uart_is_not_reached(bench: Bench) -> None:
    assert bench.ask("fault", controller_id=3) == {}


def test_a_sign_of_life_feeds_the_time_out(bench: Bench) -> None:
    for _ in range(10):
        bench.port.to_device = frame_packet(b"\x1e")
        bench.run(20)
    assert not bench.has_timed_out()
    assert bench.vesc.controllers["right"].has_timed_out
    assert bench.ask("flags") == {"flags": 0}
    assert bench.ask("flags", controller_id=2) == {"flags": 1}


def test_questions_do_not_feed_the_time_out(bench: Bench) -> None:
    for _ in range(10):
        assert bench.ask("fault") == {"fault": 0}
        bench.run(20)
    assert bench.has_timed_out()


def test_a_question_over_can_is_answered_to_who_asked(bench: Bench) -> None:
    (question,) = frames_of(2, 253, Mode.PROCESS, ask_selective(mask_of(("flags",))))
    bench.run(100)
    bench.heard()
    bench.host.send(question)
    bench.run()
    answers = [f for f in bench.heard() if f.arbitration_id >> 8 == 8]
    assert [(f.arbitration_id, f.data.hex()) for f in answers] == [(0x8FD, "0201320020000001")]


@pytest.mark.parametrize("mode", [Mode.PASS_ON, Mode.PROCESS_SILENTLY])
def test_a_packet_that_wants_no_answer_has_none(bench: Bench, mode: Mode) -> None:
    bench.host.send(frames_of(2, 253, mode, ask_selective(mask_of(("flags",))))[0])
    bench.run()
    assert not [f for f in bench.heard() if f.arbitration_id >> 8 == 8]


def test_older_firmware_does_not_send_its_flags() -> None:
    bench = Bench(Firmware(knows_flags=False))
    assert bench.ask("fault", "flags") == {"fault": 0}
    assert bench.ask("fault") == {"fault": 0}


@pytest.mark.parametrize(
    "packet", ["05", "06", "060000", "3200", "3200400000", "FF", "01", "22", "2202", "220206", "2202220106"]
)
def test_a_packet_that_makes_no_sense_changes_nothing(bench: Bench, packet: str) -> None:
    bench.port.to_device = frame_packet(bytes.fromhex(packet))
    bench.run(20)
    assert bench.torques == (0.0, 0.0)
    assert bench.port.from_device == b""


@pytest.mark.parametrize("length", range(9))
def test_frames_that_are_not_listed_change_nothing(length: int) -> None:
    bench = Bench(Firmware())
    chance = random.Random(length)  # noqa: S311 - a test's chance, not a secret
    frames = [Frame(i, b"\x7f" * length) for i in range(2_048)]
    ours = [command << 8 | controller for command in PacketId for controller in (1, 2, 255)]
    extended = [i for i in (chance.getrandbits(29) for _ in range(10_000)) if i not in ours]
    frames += [Frame(i, b"\x7f" * length, is_extended=True) for i in extended]
    bench.vesc.obey(frames, bench.now_ns, RESTING)
    bench.run(20)
    assert bench.torques == (0.0, 0.0)
    assert bench.vesc.refused_frames == 0
    assert bench.heard() == []


def test_frames_of_another_length_are_refused_and_counted(bench: Bench) -> None:
    for command in (PacketId.SET_CURRENT, PacketId.SET_RPM, PacketId.PROCESS_SHORT_BUFFER):
        bench.host.send(Frame(command << 8 | 1, b"\x01", is_extended=True))
    bench.run(20)
    assert bench.torques == (0.0, 0.0)
    assert bench.vesc.refused_frames == 3


def test_status_and_limits_from_elsewhere_are_ignored(bench: Bench) -> None:
    bench.send(PacketId.CONF_CURRENT_LIMITS, CurrentLimits(-1.0, 1.0))
    bench.send(PacketId.SET_CURRENT, Current(10.0))
    bench.run(20)
    assert bench.torques[0] == pytest.approx(1.0)
