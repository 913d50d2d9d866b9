# SPDX-License-Identifier: MIT
"""What a simulated VESC answers about itself, what its limits do, and the sign of the current that it reports."""

import struct

import pytest

from segway_ecc.firmware_io.drives.vesc.frames import Current, PacketId, Status, decode
from segway_ecc.firmware_io.drives.vesc.packets import PacketReceiver, frame_packet
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.integrity import crc16_xmodem
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.vesc import TICK_NS, Firmware, SimulatedVesc
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig, simulated_plant
from segway_ecc.node.config import load_robot
from segway_ecc.node.robot import build_robot
from tests.hil.devices.test_vesc import RESTING, Bench

LIMITED = Firmware(timeout_s=1.0, max_current=20.0, min_current=-15.0, max_erpm=4_000.0, erpm_start=0.5, max_duty=0.9)
REPORTING = Firmware(timeout_s=1.0, status={1: 1_000.0})


def ask(bench: Bench, packet: bytes) -> bytes:
    """The answer on the serial line."""
    bench.port.to_device += frame_packet(packet)
    bench.run()
    answers, bench.port.from_device = PacketReceiver().feed(bench.port.from_device), b""
    (answer,) = (answer for answer in answers if answer[0] == packet[0] or packet[0] == 34)
    return answer


@pytest.mark.parametrize(("question", "controller_id"), [(b"\x00", 1), (b"\x22\x02\x00", 2)])
def test_fw_version_names_release_hardware_and_serial_number_of_each_controller(
    question: bytes, controller_id: int
) -> None:
    answer = ask(Bench(LIMITED), question)
    assert answer[:3] == b"\x00\x06\x05", "6.05"
    hardware, _, rest = answer[3:].partition(b"\0")
    assert hardware == b"60"
    assert int.from_bytes(rest[:12], "big") == controller_id
    assert rest[12:] == bytes(9)


@pytest.mark.parametrize("question", [b"\x0e", b"\x22\x02\x0e"])
def test_get_mcconf_has_the_limits_where_6_05_has_them(question: bytes) -> None:
    answer = ask(Bench(LIMITED), question)
    assert len(answer) == 487
    assert answer[:1] == b"\x0e"
    assert struct.unpack_from(">I", answer, 1) == (295_158_857,)
    assert answer[7] == 2, "FOC"
    assert struct.unpack_from(">ff", answer, 9) == (20.0, -15.0)
    assert struct.unpack_from(">ff", answer, 33) == (-4_000.0, 4_000.0)
    assert struct.unpack_from(">h", answer, 41) == (5_000,)
    assert struct.unpack_from(">h", answer, 76) == (9_000,)


def test_get_mcconf_asked_over_can_comes_in_frames_of_the_long_kind_too() -> None:
    bench = Bench(LIMITED)
    bench.host.send(Frame(0x802, b"\xfd\0\x0e", is_extended=True))
    bench.run(2)
    frames = bench.heard()
    short = b"".join(f.data[1:] for f in frames if f.arbitration_id == 0x5FD)
    long = b"".join(f.data[2:] for f in frames if f.arbitration_id == 0x6FD)
    (last,) = (f.data for f in frames if f.arbitration_id == 0x7FD)
    packet = short + long
    assert last == struct.pack(">BBHH", 2, 1, 487, crc16_xmodem(packet))
    assert packet == ask(bench, b"\x22\x02\x0e")


@pytest.mark.parametrize(
    ("velocity", "asked", "amperes"),
    [
        (29.0, 50.0, 20.0),  # drives forward
        (30.0, -50.0, -15.0),  # brakes
        (-29.0, -50.0, -20.0),  # drives backward
        (-30.0, 50.0, 15.0),
        (44.88, 50.0, 10.0),  # 3000 of 4000 electrical turns a minute, and it began at 2000
        (60.0, 50.0, 0.0),  # beyond the limit
        (60.0, -50.0, -15.0),  # where it still brakes
    ],
)
def test_limits_of_current_and_speed_hold_for_driving_and_for_braking(
    velocity: float, asked: float, amperes: float
) -> None:
    bench = Bench(LIMITED)
    bench.outputs = RESTING | {"left.velocity": velocity}
    bench.send(PacketId.SET_CURRENT, Current(asked))
    bench.run(20)
    assert bench.vesc.controllers["left"].current == pytest.approx(amperes, abs=0.01)


@pytest.mark.parametrize(
    ("velocity", "asked", "reported", "sign_of_duty"),
    [
        (30.0, 10.0, 10.0, 1),
        (30.0, -10.0, -10.0, 1),
        (-30.0, -10.0, 10.0, -1),
        (-30.0, 10.0, -10.0, -1),
        (0.0, 10.0, 10.0, 1),  # at rest it drives, whichever way
        (0.0, -10.0, 10.0, -1),
        (5.0, -10.0, 10.0, -1),  # slowly forward the resistance takes more than speed gives: it drives backward
    ],
)
def test_the_reported_current_has_the_sign_of_voltage_times_current(
    velocity: float, asked: float, reported: float, sign_of_duty: int
) -> None:
    bench = Bench(REPORTING)
    bench.outputs = RESTING | {"left.velocity": velocity}
    bench.send(PacketId.SET_CURRENT, Current(asked))
    bench.run(20)
    status = decode(PacketId.STATUS, [f for f in bench.heard() if f.arbitration_id == 0x901][-1].data)
    assert isinstance(status, Status)
    assert status.current == pytest.approx(reported)
    assert status.duty * sign_of_duty > 0.0
    values = bench.ask("motor_current", "q_current")
    assert values == pytest.approx({"motor_current": reported, "q_current": asked}), "q has the torque's direction"
    assert bench.torques[0] == pytest.approx(0.1 * asked)


def test_a_controller_that_is_set_to_does_not_answer_get_mcconf() -> None:
    bench = Bench(Firmware(answers_configuration=False))
    bench.port.to_device += frame_packet(b"\x0e")
    bench.run()
    assert bench.port.from_device == b""


@pytest.mark.parametrize("answers", [False, True])
def test_a_robot_can_be_armed_within_two_seconds(*, answers: bool) -> None:
    file = load_robot("cart-vesc")
    assert isinstance(file.hardware, VescSettings)
    settings = file.hardware
    rate_hz = settings.status_rate_hz
    firmware = Firmware(settings.timeout_set_s, status={1: rate_hz, 5: rate_hz}, answers_configuration=answers)
    rig = LockstepRig.of(settings)
    end = rig.bus.attach("drives")
    rig.attach(SimulatedRobot(end, [SimulatedVesc(end, settings, None, firmware)], simulated_plant(file), TICK_NS))
    hardware = build_robot(file, rig, rig.bus.attach("node")).hardware
    hardware.open()
    for _ in range(200):
        rig.sleep_until_ns(rig.now_ns() + 10_000_000)
        hardware.exchange((0.0, 0.0))
    assert hardware.arming_failures() == []
