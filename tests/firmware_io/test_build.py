# SPDX-License-Identifier: MIT
"""The ways to a robot's drives, made of its settings."""

import msgspec
import pytest

from segway_ecc.firmware_io.build import (
    build_hardware,
    can_link,
    guard_link,
    imu_line,
    make_link,
    serial_codec,
    serial_of,
    takes_serial,
    with_port,
)
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings, HoverboardWheelSettings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings, OdriveWheelSettings
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.imus.xsens_mti.settings import XsensMtiSettings
from segway_ecc.firmware_io.links.joined_link import JoinedLink
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.serial_link import Port, SerialLink
from segway_ecc.firmware_io.links.serial_writer import SerialWriter
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings, SerialSettings
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial


class StoppedClock(RealClock):
    now_ns = staticmethod(lambda: 0)


CAN = CanSettings(interface="virtual", channel="bench", bitrate=250_000)
SERIAL = SerialSettings(port="/dev/bench", baudrate=115_200, lost_after_s=0.03, dwell_s=2.0)
BOARD = WheelBoardSettings(can=CAN, watchdog_s=0.03)
VESC = VescSettings(
    can=CAN,
    axes={
        "left": VescWheelSettings(controller_id=1, pole_pairs=7, torque_constant=0.1, max_torque=1.0),
        "right": VescWheelSettings(controller_id=2, pole_pairs=7, torque_constant=0.1, max_torque=1.0),
    },
    timeout_set_s=0.03,
    serial=SERIAL,
)
CIA402 = Cia402Settings(
    can=CAN,
    axes={
        "left": Cia402WheelSettings(node_id=1, counts_per_turn=4_096, max_torque=1.0),
        "right": Cia402WheelSettings(node_id=2, counts_per_turn=4_096, max_torque=1.0),
    },
)


def test_without_a_serial_line_the_bus_is_the_link() -> None:
    bus = SimulatedBus(250_000, lambda: 0).attach("node")
    assert make_link(BOARD, RealClock(), bus) is bus
    assert make_link(CIA402, RealClock(), bus) is bus
    named = make_link(BOARD, RealClock())
    assert type(named) is type(can_link(CAN, RealClock()))
    assert named.description == can_link(CAN, RealClock()).description


def test_a_bus_and_a_port_can_be_given_instead_of_those_that_are_named() -> None:
    asked: list[PortSettings] = []
    wires = SimulatedSerial(SERIAL.baudrate, lambda: 0)

    def open_port(settings: PortSettings) -> Port:
        asked.append(settings)
        return wires.host

    bus = SimulatedBus(250_000, lambda: 0).attach("node")
    link = make_link(VESC, StoppedClock(), bus, open_port)
    assert isinstance(link, RedundantLink)
    assert link.lines[0] is bus
    assert link.lines[1].description == "serial /dev/bench at 115200 bit/s"
    link.open()
    assert asked == [SERIAL]


def test_the_bus_that_is_named_is_used_where_none_is_given() -> None:
    link = make_link(VESC, RealClock())
    assert isinstance(link, RedundantLink)
    assert link.lines[0].description == can_link(CAN, RealClock()).description


@pytest.mark.parametrize(("settings", "takes"), [(BOARD, True), (VESC, True), (CIA402, False)])
def test_a_family_has_a_serial_line_whether_one_is_named_or_not(settings: HardwareSettings, takes: bool) -> None:  # noqa: FBT001 - a parameter of the test
    assert takes_serial(settings) is takes


def test_a_line_at_another_port_is_otherwise_the_same() -> None:
    moved = with_port(VESC, "/dev/other")
    assert serial_of(moved) == SerialSettings(port="/dev/other", baudrate=115_200, lost_after_s=0.03, dwell_s=2.0)
    assert moved.can == CAN
    assert serial_of(VESC) == SERIAL


def test_a_line_that_was_not_named_is_one_like_any_other() -> None:
    assert serial_of(BOARD) is None
    assert serial_of(with_port(BOARD, "/dev/other")) == SerialSettings(port="/dev/other")


def test_drives_without_a_serial_line_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^Cia402Settings has no serial line$"):
        with_port(CIA402, "/dev/other")
    with pytest.raises(ValueError, match=r"^cia402 drives have no serial line$"):
        serial_codec(CIA402)


ODRIVE = OdriveSettings(
    can=CAN,
    axes={
        "left": OdriveWheelSettings(node_id=5, max_torque=1.0),
        "right": OdriveWheelSettings(node_id=6, max_torque=1.0),
    },
    encoder_period_s=0.002,
    external_imu=XsensMtiSettings(period_s=0.01),
)
MS = 1_000_000


@pytest.mark.parametrize(
    ("settings", "key", "period_ms"),
    [
        (BOARD, FrameKey(0x120), 5),
        (WheelBoardSettings(can=CAN, imu=True), FrameKey(0x123), 5),
        (ODRIVE, FrameKey(0xA9), 2),
        (ODRIVE, FrameKey(0x34), 10),
        (msgspec.structs.replace(VESC, serial=None, status_rate_hz=100.0), FrameKey(0x1B02, is_extended=True), 10),
        (CIA402, FrameKey(0x182), 20),
        (CIA402, FrameKey(0x281), 20),
    ],
)
def test_telemetry_of_every_family_has_one_sender_at_the_rate_that_is_fixed_or_set(
    settings: HardwareSettings, key: FrameKey, period_ms: int
) -> None:
    now_ns = 0

    class Clock(RealClock):
        @staticmethod
        def now_ns() -> int:
            return now_ns

    bus = SimulatedBus(250_000, lambda: now_ns)
    hardware = build_hardware(settings, 0.02, Clock(), bus.attach("node"))
    device = bus.attach("device")
    found = []
    for senders in (1, 2):
        for ms in range(500 * senders, 500 * senders + 500):
            now_ns = ms * MS
            for sender in range(senders):
                if ms % period_ms == sender:
                    device.send(Frame(key.arbitration_id, ms.to_bytes(8, "big"), is_extended=key.is_extended))
            bus.deliver()
            if ms % 20 == 0:
                hardware.exchange(None)
        found.append(
            [r for r in hardware.arming_failures() if f"more telemetry than the device sends, 0x{key[0]:X}" in r]
        )
    assert found[0] == []
    assert f"0x{key.arbitration_id:X} (every {period_ms} ms)" in found[1][0]


HOVERBOARD = HoverboardSettings(
    serial=PortSettings(port="/dev/board"),
    left=HoverboardWheelSettings(torque_constant=0.25, max_torque=3.0),
    right=HoverboardWheelSettings(torque_constant=0.25, max_torque=3.0),
    serial_timeout_cycles=160,
)
BRIDGE = Icm42688BridgeSettings(serial=PortSettings(port="/dev/imu", baudrate=460_800))


def test_a_serial_line_can_be_the_only_one() -> None:
    assert HOVERBOARD.line is HOVERBOARD.serial
    assert serial_of(HOVERBOARD) is None, "it is none to fall back on"
    link = make_link(HOVERBOARD, RealClock())
    assert isinstance(link, SerialLink)
    assert link.description == "serial /dev/board at 115200 bit/s"
    assert link.is_active
    assert "held_back" in link.health, "its firmware needs a pause after each packet"
    assert with_port(HOVERBOARD, "/dev/other").line == PortSettings(port="/dev/other")


def test_the_guard_joins_the_line_that_the_drives_are_on() -> None:
    assert guard_link(BOARD, RealClock()).description == can_link(CAN, RealClock()).description
    guard = guard_link(HOVERBOARD, RealClock())
    assert isinstance(guard, SerialWriter)
    assert guard.description == "serial /dev/board at 115200 bit/s, to write on"


def test_an_imu_on_a_line_of_its_own_is_joined_to_the_drives_link() -> None:
    for settings, main in (
        (BOARD, can_link(CAN, RealClock()).description),
        (HOVERBOARD, "serial /dev/board at 115200 bit/s"),
    ):
        link = make_link(msgspec.structs.replace(settings, external_imu=BRIDGE), RealClock())
        assert isinstance(link, JoinedLink)
        assert link.description == f"{main}; serial /dev/imu at 460800 bit/s"
    assert imu_line(BOARD) is None
