# SPDX-License-Identifier: MIT
"""A bus at the other end of a network."""

from collections.abc import Sequence

from msgspec.structs import replace

from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.placement.network import Channel, Delivery, Network, RemoteLink, bursts
from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000


def parted(latency_s: float, loss: float = 0.0) -> tuple[LockstepRig, RemoteLink, Channel[list[Frame]]]:
    rig = LockstepRig(1_000_000)
    network = Network(latency_s=latency_s, loss=loss)
    up: Channel[Sequence[Frame]] = Channel(network, Delivery.NEWEST, "up", rig.now_ns)
    down: Channel[list[Frame]] = Channel(network, Delivery.NEWEST, "down", rig.now_ns)
    link = RemoteLink(rig.bus.attach("gateway"), up, down, rig.now_ns)
    rig.add(link)
    return rig, link, down


def test_frames_of_the_bus_arrive_later_and_carry_the_time_of_their_arrival() -> None:
    rig, link, _ = parted(0.010)
    sensors, straight = rig.bus.attach("sensors"), rig.bus.attach("straight")
    sensors.send(Frame(0x120, b"angle"))
    rig.sleep_until_ns(5 * MS)
    (undelayed,) = straight.receive()
    assert link.receive() == []
    rig.sleep_until_ns(undelayed.received_ns + 10 * MS - 1)
    assert link.receive() == []
    rig.sleep_until_ns(undelayed.received_ns + 10 * MS)
    assert link.receive() == [replace(undelayed, received_ns=undelayed.received_ns + 10 * MS)]
    assert link.receive() == []


def test_commands_are_on_the_bus_when_they_have_arrived_whatever_the_tick() -> None:
    rig, link, _ = parted(0.0073)
    drive = rig.bus.attach("drive")
    rig.sleep_until_ns(1 * MS)
    assert link.send(Frame(0x110, b"torque"))
    rig.sleep_until_ns(50 * MS)
    (command,) = drive.receive()
    assert command.data == b"torque"
    # 1 ms, 7.3 ms on the network, and not more than 150 us on a bus of 1 Mbit/s.
    assert 8_300_000 < command.received_ns < 8_450_000


def test_what_is_sent_at_one_instant_is_one_message() -> None:
    rig, link, down = parted(0.002)
    drive = rig.bus.attach("drive")
    for number in (1, 2):
        link.send(Frame(number, b""))
    rig.sleep_until_ns(1 * MS)
    link.send(Frame(3, b""))
    assert down.sent == 2
    rig.sleep_until_ns(10 * MS)
    assert [frame.arbitration_id for frame in drive.receive()] == [1, 2, 3]


def test_a_network_that_loses_everything_leaves_the_bus_silent() -> None:
    rig, link, down = parted(0.0, loss=1.0)
    drive, sensors = rig.bus.attach("drive"), rig.bus.attach("sensors")
    link.send(Frame(1, b""))
    sensors.send(Frame(2, b""))
    rig.sleep_until_ns(10 * MS)
    assert [frame.arbitration_id for frame in drive.receive()] == [2]
    assert link.receive() == []
    assert down.lost == 1


def test_frames_within_two_milliseconds_are_one_snapshot() -> None:
    times = [0, 300_000, 2_000_000, 2_000_001, 5_000_000]
    frames = [Frame(number, b"", received_ns=at_ns) for number, at_ns in enumerate(times)]
    assert [[frame.arbitration_id for frame in burst] for burst in bursts(frames)] == [[0, 1, 2], [3], [4]]
    assert bursts([]) == []
