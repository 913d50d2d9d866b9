# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, LinkState
from segway_ecc.hil.rig.fronts import FaultyLink, LinkFault
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

COMMAND, TELEMETRY = Frame(0x110, b"torque"), Frame(0x120, b"angle")


class Bench:
    def __init__(self, fault: LinkFault | None) -> None:
        self.now_ns = 0
        bus = SimulatedBus(500_000, lambda: self.now_ns)
        self.far, near = bus.attach("far"), bus.attach("near")
        self.link = FaultyLink(near)
        self.link.open()
        self.link.fault = fault

    def exchange(self) -> tuple[bool, list[int], list[int]]:
        """One frame each way; whether ours was taken, and what arrived there and here."""
        self.far.send(TELEMETRY)
        taken = self.link.send(COMMAND)
        self.now_ns += 10_000_000
        there, here = self.far.receive(), self.link.receive()
        return taken, [f.arbitration_id for f in there], [f.arbitration_id for f in here]


@pytest.mark.parametrize(
    ("fault", "expected", "state"),
    [
        (None, (True, [0x110], [0x120]), LinkState.ACTIVE),
        (LinkFault.STALE, (True, [0x110], []), LinkState.ACTIVE),
        (LinkFault.CUT, (True, [], []), LinkState.ACTIVE),
        (LinkFault.PASSIVE, (True, [], []), LinkState.PASSIVE),
        (LinkFault.BUS_OFF, (False, [], []), LinkState.BUS_OFF),
        (LinkFault.QUEUE_FULL, (False, [], [0x120]), LinkState.ACTIVE),
    ],
)
def test_each_fault_shows_itself_as_on_a_real_bus(
    fault: LinkFault | None, expected: tuple[bool, list[int], list[int]], state: LinkState
) -> None:
    bench = Bench(fault)
    assert bench.exchange() == expected
    assert bench.link.state is state
    assert bench.link.health["state"] == str(state)


def test_an_unplugged_adapter_is_gone() -> None:
    bench = Bench(LinkFault.UNPLUGGED)
    assert bench.link.send(COMMAND) is False
    assert bench.link.state is LinkState.GONE
    with pytest.raises(LinkLostError, match=r"is gone: unplugged$"):
        bench.link.receive()
    assert bench.link.counters.send_dropped == 1


def test_a_restored_link_works_and_what_came_meanwhile_is_lost() -> None:
    bench = Bench(LinkFault.CUT)
    bench.exchange()
    bench.link.fault = None
    assert bench.exchange() == (True, [0x110], [0x120])
