# SPDX-License-Identifier: MIT
"""The driver with protocol 2: which session it enters, and when."""

import pytest

from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard
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
from segway_ecc.firmware_io.links.link import Frame, Link

MS = 1_000_000
ZERO = WheelCommand(0.0, 0.0, enable=False)
ZERO_ENABLED = WheelCommand(0.0, 0.0, enable=True)


class Bench:
    """A driver of version 2 on a link in memory, and the board's side."""

    def __init__(self, link: Link, sent: list[Frame]) -> None:
        self.now_ns = 1_000 * MS
        settings = WheelBoardSettings(watchdog_s=0.04, protocol=2)
        self.driver = WheelBoard(link, settings, loop_period_s=0.01, now_ns=lambda: self.now_ns)
        self.session = CommandSession()
        self._receiver = CommandReceiver(self.session)
        self._sent = sent
        self._counters = dict.fromkeys(FrameId, 0)

    def tell(self, frame_id: FrameId, payload: Payload) -> None:
        """Let a frame of the board arrive now."""
        frame = Frame(frame_id, encode(frame_id, payload, self._counters[frame_id]), self.now_ns)
        self._counters[frame_id] += 1
        assert self.driver.take_frame(frame)

    def announce(self, number: int, epoch: int = 0) -> None:
        """Let the board begin and announce a session."""
        self.session.begin(number, epoch)
        self.tell(FrameId.BOARD_SESSION, BoardSession(number, epoch))

    def tell_status(self, state: BoardState = BoardState.DISABLED, watchdog_s: float = 0.04) -> None:
        """Let the board's status arrive now."""
        self.tell(FrameId.BOARD_STATUS, BoardStatus(state, 36.0, watchdog_s, 0))

    def taken(self) -> list[WheelCommand | BoardSetup]:
        """What the board takes of all that was sent since the last time."""
        frames, self._sent[:] = list(self._sent), []
        return [payload for frame in frames if (payload := self._receiver.check(frame)) is not None]

    def enable(self) -> None:
        """Enable the driver as far as the board is concerned."""
        self.tell_status()
        self.driver.enable()
        self.driver.command((0.0, 0.0))
        self.tell_status(BoardState.ENABLED)


@pytest.fixture
def bench(link: Link, sent: list[Frame]) -> Bench:
    return Bench(link, sent)


def test_its_commands_are_those_of_version_2_and_it_listens_to_sessions(bench: Bench) -> None:
    assert set(bench.driver.commanded_by) == {(0x112, False), (0x113, False), (0x114, False)}
    assert (0x131, False) in set(bench.driver.listens_to)


def test_before_a_session_nothing_is_sent(bench: Bench, sent: list[Frame]) -> None:
    bench.driver.start()
    bench.driver.command((1.0, 2.0))
    bench.tell_status(watchdog_s=0.05)
    assert sent == []


def test_in_a_session_it_sets_up_and_commands(bench: Bench) -> None:
    bench.announce(7)
    assert bench.taken() == [ZERO, BoardSetup(0.04)], "at once: it may be asked to arm before the next status"
    bench.tell_status(watchdog_s=0.05)
    bench.driver.command((1.0, 2.0))
    assert bench.taken() == [BoardSetup(0.04), ZERO]
    bench.enable()
    bench.driver.command((1.0, -2.0))
    assert bench.taken() == [ZERO_ENABLED, WheelCommand(1.0, -2.0, enable=True)]
    bench.driver.disable()
    assert bench.taken() == [ZERO]


def test_session_that_is_announced_again_goes_on(bench: Bench) -> None:
    bench.announce(7)
    bench.driver.command((0.0, 0.0))
    bench.tell(FrameId.BOARD_SESSION, BoardSession(7, 0))
    bench.driver.command((0.0, 0.0))
    assert bench.taken() == [ZERO, BoardSetup(0.04), ZERO, ZERO]
    assert bench.session.counter == 4


def test_disabled_it_enters_the_session_that_the_board_begins(bench: Bench) -> None:
    bench.announce(7)
    bench.driver.command((0.0, 0.0))
    bench.announce(8, 3)
    bench.driver.command((0.0, 0.0))
    assert bench.taken() == [ZERO, BoardSetup(0.04), ZERO], "what was sent in the session before is refused"
    assert bench.driver.health["session"] == "8"


def test_while_it_arms_too(bench: Bench) -> None:
    bench.announce(7)
    bench.driver.enable()
    bench.announce(8)
    bench.driver.command((0.0, 0.0))
    assert bench.taken() == [ZERO_ENABLED]


def test_enabled_it_keeps_its_session_whatever_is_announced(bench: Bench) -> None:
    bench.announce(7)
    bench.enable()
    bench.tell(FrameId.BOARD_SESSION, BoardSession(8, 0))
    bench.taken()
    bench.driver.command((1.0, 1.0))
    assert bench.taken() == [WheelCommand(1.0, 1.0, enable=True)]
    assert bench.driver.health["session"] == "7"


def test_board_without_sessions_may_not_be_armed(bench: Bench) -> None:
    bench.tell_status()
    (reason,) = bench.driver.arming_failures()
    assert reason == "the board does not send BOARD_SESSION; has its firmware version 2? if not, set protocol: 1"
    bench.announce(7)
    assert bench.driver.arming_failures() == []


def test_version_1_knows_no_session(link: Link) -> None:
    driver = WheelBoard(link, WheelBoardSettings(protocol=1), loop_period_s=0.01)
    assert (0x131, False) not in set(driver.listens_to)
    assert "session" not in driver.health
