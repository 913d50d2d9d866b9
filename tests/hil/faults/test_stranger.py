# SPDX-License-Identifier: MIT
"""Somebody else on the bus, who plays what was sent there, or makes up frames."""

from segway_ecc.firmware_io.drives.wheel_board.frames import BoardSession, FrameId, Wheel, WheelCommand, encode
from segway_ecc.firmware_io.drives.wheel_board.session import CommandSession
from segway_ecc.firmware_io.drives.wheel_board.stopper import SessionBoardStopper, WheelBoardStopper
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.faults.fault import Fault, Injections, Type
from segway_ecc.hil.faults.stranger import Stranger
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

MS = 1_000_000


def received(kind: Type, amount: float) -> list[tuple[int, Frame]]:
    """What the node receives from a stranger in 300 ms, of which ms; a device sends the number of its frame each 10."""
    ns = 0
    faults = Injections([Fault(target="stranger", type=kind, at_s=0.1, for_s=0.1, amount=amount)], 0, lambda: ns)
    bus = SimulatedBus(500_000, lambda: ns)
    node = bus.attach("node")
    stranger = Stranger(bus.attach("stranger"), WheelBoardStopper(), faults, lambda: ns)
    faults.timeline.start()
    frames = []
    for ms in range(300):
        ns = ms * MS
        if ms % 10 == 0:
            stranger.overhear(Frame(0x7, bytes([ms // 10])))
        while stranger.next_ns is not None and stranger.next_ns <= ns:
            stranger.act()
        frames += [(ms, frame) for frame in node.receive()]
    return frames


def test_a_stranger_stops_the_drives() -> None:
    frames = received("off", 50.0)
    assert len(frames) == 10
    assert {frame.arbitration_id for _, frame in frames} == {FrameId.WHEEL_COMMAND}


def test_a_stranger_sends_noise_as_the_devices() -> None:
    frames = received("garbage", 100.0)
    assert [ms for ms, _ in frames] == [101 + 10 * n for n in range(10)]
    assert {frame.arbitration_id for _, frame in frames} == {0x7}
    assert len({frame.data for _, frame in frames}) > 5


def test_a_stranger_plays_what_devices_sent_before_the_fault_and_since() -> None:
    assert [frame.data[0] for _, frame in received("delayed", 0.05)] == [5, 6, 7, 8, 9, 10, 11, 12, 13, 14]


def test_a_stranger_plays_the_newest_command_that_moved_a_drive_while_it_is_asked_to() -> None:
    ns = 0
    faults = Injections([Fault(target="stranger", type="stuck", at_s=0.1, for_s=0.1, amount=50.0)], 0, lambda: ns)
    bus = SimulatedBus(500_000, lambda: ns)
    node, drive = bus.attach("node"), bus.attach("drive")
    stranger = Stranger(bus.attach("stranger"), WheelBoardStopper(), faults, lambda: ns)
    faults.timeline.start()
    moves = [encode(FrameId.WHEEL_COMMAND, WheelCommand(volts, volts, enable=True), 0) for volts in (1.0, 2.0, 3.0)]
    zero = encode(FrameId.WHEEL_COMMAND, WheelCommand(0.0, 0.0, enable=False), 0)
    played: list[tuple[int, bytes]] = []
    for ms in range(300):
        ns = ms * MS
        sent = {10: moves[0], 90: moves[1], 95: zero, 150: moves[2]}.get(ms)
        if sent is not None:
            node.send(Frame(FrameId.WHEEL_COMMAND, sent))
        while stranger.next_ns is not None and stranger.next_ns <= ns:
            stranger.act()
        played += [(ms, frame.data) for frame in node.receive()]
        drive.receive()

    assert [data for _, data in played] == [moves[1]] * 5
    assert [ms for ms, _ in played] == [101, 121, 141, 161, 181]


def test_a_stranger_plays_all_frames_of_a_command_that_takes_several() -> None:
    ns = 0
    faults = Injections([Fault(target="stranger", type="stuck", at_s=0.1, for_s=0.1, amount=50.0)], 0, lambda: ns)
    bus = SimulatedBus(500_000, lambda: ns)
    node, board = bus.attach("node"), bus.attach("board")
    stranger = Stranger(bus.attach("stranger"), SessionBoardStopper(), faults, lambda: ns)
    faults.timeline.start()
    session = CommandSession()
    session.begin(1)
    moves = session.command(WheelCommand(1.0, 1.0, enable=True))
    announced = Frame(FrameId.BOARD_SESSION, encode(FrameId.BOARD_SESSION, BoardSession(1, 0), 0))
    wheel = Frame(FrameId.LEFT_WHEEL, encode(FrameId.LEFT_WHEEL, Wheel(0.0, 0.0), 0))
    played: list[Frame] = []
    for ms in range(200):
        ns = ms * MS
        for at, link, frame in ((5, board, announced), (8, board, wheel), (10, node, moves[0]), (10, node, moves[1])):
            if ms == at:
                link.send(frame)
                if link is board:
                    stranger.overhear(frame)
        while stranger.next_ns is not None and stranger.next_ns <= ns:
            stranger.act()
        received = node.receive()
        played += received if ms >= 100 else []
        board.receive()

    assert [(frame.arbitration_id, frame.data) for frame in played] == [(f.arbitration_id, f.data) for f in moves] * 5


def test_without_such_a_fault_a_stranger_does_nothing() -> None:
    bus = SimulatedBus(500_000, lambda: 0)
    assert Stranger(bus.attach("x"), WheelBoardStopper(), Injections([], 0, lambda: 0), lambda: 0).next_ns is None
