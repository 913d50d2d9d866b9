# SPDX-License-Identifier: MIT
"""The guard of a wheel board of version 2: what it reads, what it sends; and of both versions in lock step."""

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSession,
    BoardSetup,
    BoardState,
    BoardStatus,
    FrameId,
    Payload,
    WheelCommand,
    encode,
)
from segway_ecc.firmware_io.drives.wheel_board.session import CommandReceiver, CommandSession
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.guard.guard import stopper_of
from segway_ecc.firmware_io.guard.watch import Cause, End
from segway_ecc.firmware_io.links.link import Frame
from tests.firmware_io.guard.test_lockstep import play, record

MS = 1_000_000
ON, OFF = WheelCommand(1.0, 2.0, enable=True), WheelCommand(0.0, 0.0, enable=False)


class Sides:
    """A node in a session, the board's receiver, and a guard that looks in on both."""

    def __init__(self) -> None:
        self.node, self.board = CommandSession(), CommandSession()
        self.receiver = CommandReceiver(self.board)
        self.stopper = stopper_of(WheelBoardSettings(protocol=2))
        self.begin(7)

    def begin(self, number: int, counter: int = 0) -> None:
        """Let node and board be in a session, at some count."""
        for end in (self.node, self.board):
            end.begin(number)
            end.counter = counter

    def announce(self) -> None:
        """Let the guard receive what the board announces."""
        assert self.tell(FrameId.BOARD_SESSION, BoardSession(self.board.number, self.board.epoch)) is None

    def tell(self, frame_id: FrameId, payload: Payload) -> Observation | None:
        """What the guard makes of a frame of the board."""
        return self.stopper.read(Frame(frame_id, encode(frame_id, payload, 0)))

    def command(self, payload: WheelCommand) -> list[Meaning | None]:
        """What the guard makes of a command of the node, which the board takes."""
        read = []
        for frame in self.node.command(payload):
            self.receiver.check(frame)
            observed = self.stopper.read(frame)
            read.append(None if observed is None else observed.meaning)
        return read

    def stopped(self) -> list[WheelCommand | BoardSetup]:
        """What the board takes of the guard's frames."""
        frames = sorted(self.stopper.stop(), key=lambda frame: frame.arbitration_id)
        return [payload for frame in frames if (payload := self.receiver.check(frame)) is not None]


@pytest.fixture
def sides() -> Sides:
    return Sides()


def test_whole_commands_and_states_mean_something(sides: Sides) -> None:
    assert sides.tell(FrameId.BOARD_STATUS, BoardStatus(BoardState.ENABLED, 36.0, 0.05, 0)) == ("board", Meaning.ON)
    assert sides.tell(FrameId.BOARD_STATUS, BoardStatus(BoardState.WATCHDOG, 36.0, 0.05, 0)) == ("board", Meaning.OFF)
    sides.announce()
    assert sides.command(ON) == [None, Meaning.MOVE]
    assert sides.command(OFF) == [None, Meaning.DISABLE]
    assert sides.stopper.read(sides.node.setup(BoardSetup(0.04))) is None


def test_before_the_session_is_known_commands_mean_nothing_and_nothing_is_sent(sides: Sides) -> None:
    assert sides.command(ON) == [None, None]
    assert list(sides.stopper.stop()) == []


def test_damaged_recorded_and_foreign_frames_mean_nothing(sides: Sides) -> None:
    sides.announce()
    left, right = sides.node.command(ON)
    flipped = replace(right, data=bytes((right.data[0] ^ 1, *right.data[1:])))
    status = Frame(FrameId.BOARD_STATUS, bytes(8))
    assert [sides.stopper.read(f) for f in (left, flipped, replace(right, is_extended=True), status)] == [None] * 4
    assert sides.stopper.read(replace(status, is_extended=True)) is None
    assert sides.stopper.read(right) == ("board", Meaning.MOVE)
    assert [sides.stopper.read(f) for f in (left, right)] == [None, None], "played again"


def test_stop_frames_count_on_where_the_node_was(sides: Sides) -> None:
    sides.announce()
    sides.command(ON)
    assert sides.stopped() == [OFF, OFF]
    assert sides.stopped() == [OFF, OFF]
    assert sides.board.counter == 5
    sides.announce()
    assert sides.stopped() == [OFF, OFF], "what is announced of this session does not set the counter back"


def test_who_looks_in_late_stops_all_the_same(sides: Sides) -> None:
    sides.begin(7, 0x5_4320)
    sides.announce()
    assert sides.command(ON) == [None, Meaning.MOVE]
    assert sides.stopped() == [OFF, OFF]


def test_next_session_and_next_bits_are_followed(sides: Sides) -> None:
    sides.announce()
    sides.command(ON)
    sides.begin(7, 0x1_0005)
    sides.announce()
    assert sides.command(ON) == [None, Meaning.MOVE]
    sides.begin(8)
    assert sides.command(ON) == [None, None]
    sides.announce()
    assert sides.command(ON) == [None, Meaning.MOVE]
    assert sides.stopped() == [OFF, OFF]


@pytest.fixture(params=[1, 2])
def driving(guarded: Callable[[str], Any], cart_of: Callable[[int], str], request: pytest.FixtureRequest) -> Any:
    """The cart behind a board of either version, driving."""
    g = guarded(cart_of(request.param))
    g.wait(200)
    g.arm()
    g.drive(100)
    return g


def test_start_drive_disarm_and_stop_go_undisturbed(driving: Any) -> None:
    driving.robot.disarm()
    driving.drive(100)
    while driving._arming_failures():
        driving.cycle()
    driving.robot.arm()
    driving.drive(100)
    assert driving.gives_torque
    driving.robot.close()
    driving.wait(1_000)

    assert driving.watch.intervened == 0
    assert driving.guard_link.counters.sent == 0


def test_dead_node_s_torque_ends_in_time(driving: Any) -> None:
    last_ns = driving.rig.now_ns()
    driving.kill()
    driving.wait(50)

    assert not driving.gives_torque
    (done,) = driving.watch.interventions
    assert done.cause is Cause.SILENCE
    assert 30 * MS < done.first_ns - last_ns <= 40 * MS
    driving.wait(1_500)
    assert done.end is End.OFF
    assert driving.watch.intervened == 1


@pytest.mark.parametrize("driving", [2], indirect=True)
def test_recording_does_nothing_while_the_node_is_dead(driving: Any) -> None:
    recording = record(driving, 150)
    driving.kill()
    driving.wait(100)
    driving.moments.clear()
    play(driving, recording)
    driving.wait(50)

    assert not any(any(given) for _, given in driving.moments)
    assert driving.watch.intervened == 1


def test_node_that_was_stopped_is_armed_again(driving: Any) -> None:
    driving.kill()
    driving.wait(100)
    driving.bus.fault, driving.beats.is_cut = None, False
    driving.robot.disarm()
    for _ in range(120):  # the guard's frames count as another controller's for a second
        driving.cycle()
    assert driving._arming_failures() == []
    driving.robot.arm()
    driving.drive(50)
    assert driving.gives_torque
