# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.rig.simulated_serial import SimulatedPort, SimulatedSerial

BAUDRATE = 1_000_000
BYTE_NS = 10_000
SETTINGS = SerialSettings(port="simulated", baudrate=BAUDRATE)


class Clock:
    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def clock() -> Clock:
    """A clock that stands until it is set."""
    return Clock()


@pytest.fixture
def serial(clock: Clock) -> SimulatedSerial:
    """A line at 1 Mbit/s: a byte takes 10 us."""
    return SimulatedSerial(BAUDRATE, clock)


def test_a_byte_arrives_when_its_ten_bits_have_passed(serial: SimulatedSerial, clock: Clock) -> None:
    host: Port = serial.host
    assert host.write(b"abc") == 3
    for now_ns, arrived in ((9_999, b""), (10_000, b"a"), (29_999, b"ab"), (30_000, b"abc")):
        clock.now_ns = now_ns
        assert serial.device.in_waiting == len(arrived)
        assert serial.host.out_waiting == 3 - len(arrived)
    assert serial.device.read(2) == b"ab"
    assert serial.device.read(2) == b"c"
    assert serial.device.read(2) == b""


def test_bytes_queue_behind_those_before_and_keep_their_order(serial: SimulatedSerial, clock: Clock) -> None:
    serial.host.write(b"ab")
    clock.now_ns = 15_000
    serial.host.write(b"c")
    clock.now_ns = 29_999
    assert serial.device.read(9) == b"ab"
    clock.now_ns = 30_000
    assert serial.device.read(9) == b"c"
    clock.now_ns = 100_000
    serial.host.write(b"d")
    clock.now_ns = 109_999
    assert serial.device.read(9) == b""
    clock.now_ns = 110_000
    assert serial.device.read(9) == b"d"


def test_each_way_is_its_own(serial: SimulatedSerial, clock: Clock) -> None:
    serial.host.write(b"host")
    serial.device.write(b"device")
    clock.now_ns = 6 * BYTE_NS
    assert serial.host.read(9) == b"device"
    assert serial.device.read(9) == b"host"
    assert serial.host.read(9) == serial.device.read(9) == b""


def test_rounding_does_not_add_up(clock: Clock) -> None:
    serial = SimulatedSerial(921_600, clock)
    serial.host.write(bytes(2304))
    clock.now_ns = 24_999_999
    assert serial.device.in_waiting == 2303
    clock.now_ns = 25_000_000
    assert serial.device.in_waiting == 2304


def test_a_port_takes_no_more_than_there_is_room_for(serial: SimulatedSerial, clock: Clock) -> None:
    assert serial.host.write(bytes(5000)) == 4096
    assert serial.host.write(b"x") == 0
    clock.now_ns = 10 * BYTE_NS
    assert serial.host.write(bytes(11)) == 10


def test_what_nobody_reads_is_kept_within_bounds(serial: SimulatedSerial, clock: Clock) -> None:
    for _ in range(20):
        serial.host.write(bytes(4096))
        clock.now_ns += 4096 * BYTE_NS
    assert serial.device.in_waiting == 65_536
    serial.device.inject(b"more")
    assert serial.device.in_waiting == 65_536


def test_what_is_on_cut_wires_vanishes(serial: SimulatedSerial, clock: Clock) -> None:
    for port in (serial.host, serial.device):
        port.write(b"abcd")
    clock.now_ns = 15_000
    assert not serial.cut
    serial.cut = True
    assert serial.cut
    clock.now_ns = 35_000
    serial.cut = False
    clock.now_ns = 40_000
    assert serial.device.read(9) == serial.host.read(9) == b"ad"


def test_what_is_sent_into_cut_wires_vanishes(serial: SimulatedSerial, clock: Clock) -> None:
    serial.cut = True
    assert serial.host.write(b"abcd") == 4
    clock.now_ns = 40_000
    assert serial.device.read(9) == b""
    serial.cut = False
    serial.host.write(b"e")
    clock.now_ns = 50_000
    assert serial.device.read(9) == b"e"


def test_garbage_arrives_in_the_middle(serial: SimulatedSerial, clock: Clock) -> None:
    serial.device.write(b"ab")
    serial.host.write(b"AB")
    clock.now_ns = 10_000
    serial.host.inject(b"\xff")
    serial.device.inject(b"\x00")
    clock.now_ns = 20_000
    assert serial.host.read(9) == b"a\xffb"
    assert serial.device.read(9) == b"A\x00B"


def test_an_unplugged_port_fails_until_it_is_plugged_in_and_opened(serial: SimulatedSerial, clock: Clock) -> None:
    serial.host.unplug()
    for use in (
        lambda: serial.host.read(1),
        lambda: serial.host.write(b"x"),
        lambda: serial.host.in_waiting,
        lambda: serial.host.out_waiting,
    ):
        with pytest.raises(OSError, match="unplugged"):
            use()
    with pytest.raises(FileNotFoundError, match="unplugged"):
        serial.host.open(SETTINGS)
    serial.device.write(b"into the air")
    clock.now_ns = 200_000
    serial.host.plug()
    assert serial.host.open(SETTINGS) is serial.host
    assert serial.host.read(99) == b""
    serial.device.write(b"x")
    clock.now_ns = 210_000
    assert serial.host.read(99) == b"x"


def test_a_port_that_is_closed_can_be_opened_again(serial: SimulatedSerial, clock: Clock) -> None:
    port: SimulatedPort = serial.host.open(SETTINGS)
    port.close()
    port.close()
    assert port.open(SETTINGS).write(b"x") == 1
    clock.now_ns = BYTE_NS
    assert serial.device.read(9) == b"x"
