# SPDX-License-Identifier: MIT
"""A wheel board of version 2: its sessions, which both lines share, and what they change of its states."""

import pytest

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSession,
    BoardSetup,
    BoardState,
    BoardStatus,
    Endpoint,
    FrameId,
    Payload,
    WheelCommand,
)
from segway_ecc.firmware_io.drives.wheel_board.session import CommandSession
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from segway_ecc.hil.rig.simulated_bus import SimulatedBus
from tests.hil.devices.test_wheel_board import OUTPUTS, Port, SerialHost

ON = WheelCommand(3.0, -4.0, enable=True)
OFF = WheelCommand(0.0, 0.0, enable=False)
OFF_TIME_TICKS = 41
"""More than the 0.2 s after which a session that is not used ends."""
TELEMETRY = frozenset({FrameId.BOARD_STATUS, FrameId.BOARD_SESSION})


class Bench:
    """A board of version 2 on a bus and a serial line, and a host that knows its session."""

    def __init__(self) -> None:
        self.now_ns = 0
        bus, port = SimulatedBus(1_000_000_000, lambda: self.now_ns), Port()
        self.host_link, self.board_link = bus.attach("host"), bus.attach("board")
        self.serial_host = SerialHost(port)
        self.board = SimulatedWheelBoard(self.board_link, WheelBoardSettings(protocol=2), port)
        self.endpoint = Endpoint(self.host_link.send, TELEMETRY)
        self.session = CommandSession()
        self.tick()
        self.enter()

    def tick(self, *frames: Frame, times: int = 1) -> None:
        """Let the board tick, with some frames of the bus."""
        for frame in frames:
            self.host_link.send(frame)
        for _ in range(times):
            self.now_ns += TICK_NS
            self.board.obey(self.board_link.receive(), self.now_ns, OUTPUTS)
            self.board.send_telemetry(self.now_ns, OUTPUTS)

    def tick_serial(self, *frames: Frame) -> None:
        """The same with frames of the serial line."""
        for frame in frames:
            self.serial_host.send(frame)
        self.tick()

    def received(self) -> list[Payload]:
        """Status and session, as the board sent them on the bus since the last time."""
        self.now_ns += 1_000
        return [payload for frame in self.host_link.receive() if (payload := self.endpoint.check(frame)) is not None]

    def announced(self) -> BoardSession:
        """The newest session that the board announced."""
        self.tick(times=4)
        return [payload for payload in self.received() if isinstance(payload, BoardSession)][-1]

    def enter(self) -> None:
        """Enter the session that the board announces."""
        announced = self.announced()
        self.session.begin(announced.number, announced.epoch)

    def state(self) -> BoardState:
        """The board's state."""
        return self.board.state


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_session_is_announced_after_each_status(bench: Bench) -> None:
    bench.tick(times=8)
    assert [type(payload) for payload in bench.received()] == [BoardStatus, BoardSession] * 2


def test_on_the_serial_line_it_is_announced_in_each_answer(bench: Bench) -> None:
    bench.serial_host.ask()
    bench.tick()
    assert [frame.arbitration_id for frame in bench.serial_host.receive()] == [0x120, 0x121, 0x130, 0x131]


def test_commands_of_the_session_are_obeyed_once_it_was_commanded_to_be_off(bench: Bench) -> None:
    bench.tick(*bench.session.command(ON))
    assert (bench.state(), bench.board.refused_frames) == (BoardState.DISABLED, 1)
    bench.tick(*bench.session.command(OFF))
    bench.tick(*bench.session.command(ON))
    assert (bench.state(), tuple(bench.board.voltages)) == (BoardState.ENABLED, (3.0, -4.0))
    bench.tick(*bench.session.command(OFF))
    assert (bench.state(), tuple(bench.board.voltages)) == (BoardState.DISABLED, (0.0, 0.0))


def test_half_a_command_does_not_feed_the_watchdog(bench: Bench) -> None:
    bench.tick(*bench.session.command(OFF))
    bench.tick(*bench.session.command(ON))
    for _ in range(11):
        bench.tick(bench.session.command(ON)[0])
    assert bench.state() is BoardState.WATCHDOG


def test_setup_sets_the_watchdog_while_it_is_not_enabled(bench: Bench) -> None:
    bench.tick(bench.session.setup(BoardSetup(0.03)), *bench.session.command(OFF))
    bench.tick(*bench.session.command(ON))
    bench.tick(bench.session.setup(BoardSetup(1.0)), *bench.session.command(ON), times=8)
    assert bench.state() is BoardState.WATCHDOG


def test_session_that_was_not_used_lasts(bench: Bench) -> None:
    first = bench.announced()
    bench.tick(times=10 * OFF_TIME_TICKS)
    assert bench.announced() == first


def test_silent_host_ends_the_session_and_its_commands_pass_no_more(bench: Bench) -> None:
    first = bench.announced()
    recorded = [frame for command in (OFF, ON) for frame in bench.session.command(command)]
    bench.tick(*recorded, times=OFF_TIME_TICKS + 11)
    assert bench.announced() == BoardSession(first.number + 1, 0)
    before = bench.board.refused_frames
    bench.tick(*recorded, *bench.session.command(OFF), *bench.session.command(ON))
    assert bench.state() is BoardState.WATCHDOG
    assert bench.board.refused_frames == before + 8

    bench.enter()
    bench.tick(*bench.session.command(OFF), *bench.session.command(ON))
    assert bench.state() is BoardState.ENABLED


def test_host_that_lost_count_gets_a_new_session(bench: Bench) -> None:
    first = bench.announced()
    bench.tick(*bench.session.command(OFF))
    for _ in range(OFF_TIME_TICKS):
        bench.session.counter += 100
        bench.tick(*bench.session.command(OFF))
    assert bench.announced().number == first.number + 1


def test_enabled_board_keeps_its_session_whatever_its_watchdog(bench: Bench) -> None:
    first = bench.announced()
    bench.tick(bench.session.setup(BoardSetup(1.0)), *bench.session.command(OFF))
    bench.tick(*bench.session.command(ON), times=2 * OFF_TIME_TICKS)
    assert bench.state() is BoardState.ENABLED
    assert bench.announced() == first


def test_announced_epoch_follows_the_counter(bench: Bench) -> None:
    for counter in range(0, 3 << 15, 64):
        bench.session.counter = counter
        bench.tick(*bench.session.command(OFF))
    assert bench.announced().epoch == 2


def test_lines_share_the_session_and_the_one_that_was_off_last_owns_the_board(bench: Bench) -> None:
    bench.tick(*bench.session.command(OFF))
    late = bench.session.command(ON)
    bench.tick_serial(*bench.session.command(OFF))
    bench.tick_serial(*bench.session.command(ON))
    assert bench.state() is BoardState.ENABLED
    bench.tick(*late)
    assert bench.board.refused_frames == 2, "what comes late out of the line that was left counts as old"
    bench.tick(*bench.session.command(ON))
    assert bench.board.refused_frames == 3, "and what is new there comes from a line that does not own the board"
    bench.tick(*bench.session.command(OFF))
    assert bench.state() is BoardState.DISABLED


def test_commands_of_version_1_are_refused(bench: Bench) -> None:
    old = Endpoint(bench.host_link.send, TELEMETRY)
    old.send(FrameId.WHEEL_COMMAND, OFF)
    old.send(FrameId.WHEEL_COMMAND, ON)
    bench.tick()
    assert (bench.state(), bench.board.refused_frames) == (BoardState.DISABLED, 2)


def test_noise_on_the_serial_line_is_counted_too(bench: Bench) -> None:
    bench.tick_serial(Frame(0x113, bytes(8)), Frame(0x114, bytes(8)))
    assert bench.board.refused_frames == 2
