# SPDX-License-Identifier: MIT
"""The ways to a robot's drives, made of its settings."""

import pytest

from segway_ecc.firmware_io.build import (
    HardwareSettings,
    can_link,
    make_link,
    serial_codec,
    serial_of,
    takes_serial,
    with_port,
)
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings, Cia402WheelSettings
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.links.settings import CanSettings, SerialSettings
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from segway_ecc.hil.rig.simulated_serial import SimulatedSerial


class StoppedClock(RealClock):
    now_ns = staticmethod(lambda: 0)


CAN = CanSettings(interface="virtual", channel="bench", bitrate=250_000)
SERIAL = SerialSettings(port="/dev/bench", baudrate=115_200, lost_after_s=0.03, dwell_s=2.0)
BOARD = WheelBoardSettings(can=CAN, watchdog_s=0.03)
VESC = VescSettings(
    can=CAN,
    left=VescWheelSettings(controller_id=1, pole_pairs=7, torque_constant=0.1, max_torque=1.0),
    right=VescWheelSettings(controller_id=2, pole_pairs=7, torque_constant=0.1, max_torque=1.0),
    timeout_set_s=0.03,
    serial=SERIAL,
)
CIA402 = Cia402Settings(
    can=CAN,
    left=Cia402WheelSettings(node_id=1, counts_per_turn=4_096, max_torque=1.0),
    right=Cia402WheelSettings(node_id=2, counts_per_turn=4_096, max_torque=1.0),
)


def test_without_a_serial_line_the_bus_is_the_link() -> None:
    bus = SimulatedBus(250_000, lambda: 0).attach("node")
    assert make_link(BOARD, RealClock(), bus) is bus
    assert make_link(CIA402, RealClock(), bus) is bus
    named = make_link(BOARD, RealClock())
    assert type(named) is type(can_link(CAN, RealClock()))
    assert named.description == can_link(CAN, RealClock()).description


def test_a_bus_and_a_port_can_be_given_instead_of_those_that_are_named() -> None:
    asked: list[SerialSettings] = []
    wires = SimulatedSerial(SERIAL.baudrate, lambda: 0)

    def open_port(settings: SerialSettings) -> Port:
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
    with pytest.raises(ValueError, match=r"^CiA 402 drives have no serial line$"):
        serial_codec(CIA402)
