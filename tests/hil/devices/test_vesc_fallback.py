# SPDX-License-Identifier: MIT
"""The bus is lost on this computer's side, and the UART of one controller takes over for both."""

from collections.abc import Mapping

import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.drives.vesc.driver import Vesc
from segway_ecc.firmware_io.drives.vesc.serial_codec import VescSerialCodec
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState
from segway_ecc.firmware_io.links.redundant_link import RedundantLink
from segway_ecc.firmware_io.links.serial_link import SerialLink
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.devices.vesc import TICK_NS, SimulatedVesc, VescFault
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

LEFT = VescWheelSettings(controller_id=1, pole_pairs=7, torque_constant=0.1, max_torque=3.0)
RIGHT = VescWheelSettings(controller_id=2, pole_pairs=7, torque_constant=0.1, max_torque=3.0)
SERIAL = SerialSettings(port="pipe", baudrate=115_200)
CYCLE_NS = 10_000_000
OUTPUTS = {"left.angle": 0.0, "left.velocity": 30.0, "right.angle": 0.0, "right.velocity": -30.0}


class End:
    """One end of a serial line in memory."""

    def __init__(self) -> None:
        self.arrived = bytearray()
        self.other = self

    @property
    def in_waiting(self) -> int:
        return len(self.arrived)

    def read(self, size: int, /) -> bytes:
        data = bytes(self.arrived[:size])
        del self.arrived[:size]
        return data

    def write(self, data: bytes, /) -> int:
        self.other.arrived += data
        return len(data)

    def close(self) -> None:
        """Nothing to close."""


class Plug:
    """A link that may be pulled out."""

    def __init__(self, link: Link) -> None:
        self.counters = LinkCounters()
        self.description = "bus"
        self.state = LinkState.ACTIVE
        self.is_pulled = False
        self._link = link

    @property
    def health(self) -> Mapping[str, str]:
        return {}

    def open(self) -> None:
        self._link.open()

    def send(self, frame: Frame) -> bool:
        return self.is_pulled or self._link.send(frame)

    def receive(self) -> list[Frame]:
        frames = self._link.receive()
        return [] if self.is_pulled else frames

    def close(self) -> None:
        self._link.close()


class Bench:
    """The node's hardware at 100 Hz and both controllers at 1 kHz, in lock step."""

    def __init__(self, settings: VescSettings) -> None:
        self.now_ns = 0
        bus = SimulatedBus(500_000, self._now)
        self.plug = Plug(bus.attach("host"))
        self._device_link = bus.attach("vesc")
        host, device = End(), End()
        host.other, device.other = device, host
        self.vesc = SimulatedVesc(self._device_link, settings, device)
        serial = SerialLink(SERIAL, VescSerialCodec(settings), self._now, lambda _: host)
        link = RedundantLink(self.plug, serial, self._now)
        drives = [Vesc(link, name, settings, 0.01, self._now) for name in ("left", "right")]
        self.robot = Assembly(link, drives, now_ns=self._now)
        self.robot.open()
        self.torques: tuple[float, ...] = ()

    def _now(self) -> int:
        return self.now_ns

    def cycles(self, count: int) -> None:
        for _ in range(count):
            for _ in range(CYCLE_NS // TICK_NS):
                self.now_ns += TICK_NS
                self.torques = tuple(self.vesc.obey(self._device_link.receive(), self.now_ns, OUTPUTS))
                self.vesc.send_telemetry(self.now_ns, OUTPUTS)
            self.sensors = self.robot.exchange((1.0, -2.0))

    def arm(self) -> None:
        self.cycles(100)
        self.robot.arm()
        self.cycles(10)
        assert self.sensors.ready


@pytest.fixture(params=["left", "right"])
def bench(request: pytest.FixtureRequest) -> Bench:
    settings = VescSettings(
        axes={"left": LEFT, "right": RIGHT}, timeout_set_s=0.05, serial=SERIAL, serial_controller=request.param
    )
    return Bench(settings)


def test_both_wheels_follow_over_the_bus(bench: Bench) -> None:
    bench.arm()
    assert bench.torques == pytest.approx((1.0, -2.0))
    assert bench.sensors.faults == ()


def test_both_wheels_follow_again_over_the_uart(bench: Bench) -> None:
    bench.arm()
    bench.plug.is_pulled = True
    for _ in range(30):
        bench.cycles(1)
        assert all(bench.sensors.valid), "the robot must not be let fall"
    assert bench.robot.switching is not None
    (switch,) = bench.robot.switching.switches
    assert switch.torque_gap_ns is not None
    assert switch.torque_gap_ns <= 60_000_000
    assert bench.torques == pytest.approx((1.0, -2.0))
    assert bench.sensors.ready
    told = dict(zip(bench.robot.signals, bench.sensors.values, strict=True))
    assert (told["left.velocity"], told["right.velocity"]) == pytest.approx((30.0, -30.0), abs=0.02)
    assert (told["left.torque"], told["right.torque"]) == pytest.approx((1.0, -2.0), abs=0.01)
    assert told["supply.voltage"] == pytest.approx(36.0)


def test_a_fault_is_reported_over_the_uart_too(bench: Bench) -> None:
    bench.arm()
    bench.plug.is_pulled = True
    bench.cycles(20)
    bench.vesc.controllers["right"].fail(VescFault.OVER_VOLTAGE)
    bench.cycles(3)
    assert bench.sensors.faults == ("the right VESC (id 2) reports over-voltage (fault 1)",)


def test_the_time_out_is_measured_over_the_uart_too(bench: Bench) -> None:
    bench.plug.is_pulled = True
    bench.cycles(150)
    health = bench.robot.health
    assert health["left.timeout"].startswith("measured")
    assert health["right.timeout"].startswith("measured")
