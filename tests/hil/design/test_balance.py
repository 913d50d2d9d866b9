# SPDX-License-Identifier: MIT
from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.design.balance import DelayedLink
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

MS = 1_000_000


def test_a_delayed_link_hands_over_later_with_a_stamp_that_is_as_much_later() -> None:
    now_ns = 0
    bus = SimulatedBus(1_000_000, lambda: now_ns)
    far, near = bus.attach("far"), bus.attach("near")
    straight, delayed = bus.attach("straight"), DelayedLink(near, lambda: now_ns)
    delayed.delay_ns = 5 * MS

    far.send(Frame(0x120, b"angle"))
    now_ns = 2 * MS
    (undelayed,) = straight.receive()
    assert 0 < undelayed.received_ns < 2 * MS
    assert delayed.receive() == []
    now_ns = undelayed.received_ns + 5 * MS - 1
    assert delayed.receive() == []
    now_ns += 1
    assert delayed.receive() == [replace(undelayed, received_ns=undelayed.received_ns + 5 * MS)]
    assert delayed.receive() == []


def test_a_link_with_no_delay_is_the_link_behind() -> None:
    now_ns = 0
    bus = SimulatedBus(1_000_000, lambda: now_ns)
    far, near = bus.attach("far"), bus.attach("near")
    link = DelayedLink(near, lambda: now_ns)
    far.send(Frame(0x120, b"angle"))
    now_ns = 2 * MS
    assert [frame.arbitration_id for frame in link.receive()] == [0x120]
    assert link.send(Frame(0x110, b"torque"))
    now_ns = 4 * MS
    assert [frame.arbitration_id for frame in far.receive()] == [0x110]
    assert link.counters is near.counters
