# SPDX-License-Identifier: MIT
from collections.abc import Collection, Sequence
from typing import NamedTuple

import pytest

from segway_ecc.firmware_io.assembly import Assembly
from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardState
from segway_ecc.firmware_io.drives.wheel_board.session import CommandId
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.case_study.study import Cell, difference, thesis_cells
from segway_ecc.hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from segway_ecc.hil.plants.cart import CartPlant
from segway_ecc.hil.rig.fronts import LinkFront
from segway_ecc.hil.rig.simulated_bus import SimulatedLink
from segway_ecc.hil.rig.simulated_robot import SimulatedRobot
from segway_ecc.hil.rig.simulation import LockstepRig
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment, single_segment

MS = 1_000_000
WALL_NS = 1_700_000_000_000_000_000


class Log:
    """What the rig lets see, tick by tick."""

    def __init__(self) -> None:
        self.stamps: list[int] = []

    def __call__(self, wall_ns: int, outputs: Sequence[float]) -> None:
        assert len(outputs) == len(CartPlant.outputs)
        self.stamps.append(wall_ns)


class Drive(NamedTuple):
    """A drive of 300 ms: the board, its state in each cycle, and whether there were faults."""

    board: SimulatedWheelBoard
    seen: list[tuple[BoardState, bool]]


def robot(board: SimulatedWheelBoard, link: SimulatedLink) -> SimulatedRobot:
    """The cart behind a board."""
    return SimulatedRobot(link, [board], CartPlant(), TICK_NS)


@pytest.fixture
def rig() -> LockstepRig:
    return LockstepRig(500_000)


def test_time_passes_only_by_waiting(rig: LockstepRig) -> None:
    assert (rig.now_ns(), rig.wall_ns()) == (0, WALL_NS)
    rig.sleep_until_ns(12 * MS)
    assert (rig.now_ns(), rig.wall_ns()) == (12 * MS, WALL_NS + 12 * MS)
    rig.sleep_until_ns(3 * MS)
    assert rig.now_ns() == 12 * MS, "a moment that has passed is not waited for"


def test_the_device_runs_up_to_the_moment_waited_for(rig: LockstepRig) -> None:
    log = Log()
    rig.attach(robot(SimulatedWheelBoard(link := rig.bus.attach("board")), link), log)

    rig.sleep_until_ns(10 * MS)
    assert log.stamps == [WALL_NS, WALL_NS + 5 * MS], "the tick at that very moment comes after the node's turn"
    rig.sleep_until_ns(10 * MS + 1)
    assert log.stamps[2:] == [WALL_NS + 10 * MS]
    rig.sleep_until_ns(10 * MS + 2)
    assert len(log.stamps) == 3


def test_without_a_device_time_passes_all_the_same(rig: LockstepRig) -> None:
    rig.sleep_until_ns(20 * MS)
    assert rig.now_ns() == 20 * MS


_COMMANDS = frozenset({CommandId.LEFT_COMMAND, CommandId.RIGHT_COMMAND})


class LosingLink(LinkFront):
    """Loses commands while it is told to."""

    loses = False

    def send(self, frame: Frame) -> bool:
        return (self.loses and frame.arbitration_id in _COMMANDS) or super().send(frame)


def _drive(rig: LockstepRig, lost: Collection[int]) -> Drive:
    """Drive for 300 ms, some of the commands lost on the bus."""
    link = LosingLink(rig.bus.attach("node"))
    driver = Assembly(
        link, [WheelBoard(link, WheelBoardSettings(), loop_period_s=0.01, now_ns=rig.now_ns)], now_ns=rig.now_ns
    )
    board = SimulatedWheelBoard(board_link := rig.bus.attach("board"))
    rig.attach(robot(board, board_link))
    driver.open()
    rig.sleep_until_ns(100 * MS)
    driver.exchange((0.0, 0.0))
    driver.arm()
    for _ in range(5):
        ready = driver.exchange((1.0, 1.0)).ready
        rig.sleep_until_ns(rig.now_ns() + 10 * MS)
    assert ready
    seen = []
    for cycle in range(30):
        link.loses = cycle in lost
        sensors = driver.exchange((1.0, 1.0))
        rig.sleep_until_ns(rig.now_ns() + 10 * MS)
        seen.append((board.state, bool(sensors.faults)))
    return Drive(board, seen)


def test_a_single_lost_command_does_not_stop_the_robot(rig: LockstepRig) -> None:
    board, seen = _drive(rig, {5, 9, 14})
    assert set(seen) == {(BoardState.ENABLED, False)}
    assert board.refused_frames == 0


def test_commands_lost_for_longer_than_the_watchdog_stop_the_motors_for_good(rig: LockstepRig) -> None:
    board, seen = _drive(rig, range(10, 17))
    states = [state for state, _ in seen]
    # The last command, of the tenth cycle, is read at 245 ms; 50 ms are over at the tick at 300 ms, in the 16th cycle.
    assert set(states[:15]) == {BoardState.ENABLED}
    assert set(states[15:]) == {BoardState.WATCHDOG}, "commands that come again do not switch the motors on again"
    assert tuple(board.voltages) == (0.0, 0.0)
    assert seen[-1][1], "the node hears of it"


def test_the_same_run_gives_the_same_bits() -> None:
    manoeuvre = Manoeuvre(
        segments=(Segment(linear=1.0, angular=0.5, duration=1.0), Segment(linear=1.0, angular=-0.5, duration=1.0))
    )
    first, second = (LockstepCanSeat(None).run("again", manoeuvre) for _ in range(2))
    assert first == second
    assert len(first.trajectory.time) == 201


@pytest.mark.parametrize("cell", thesis_cells(), ids=lambda cell: f"{cell.linear:g}-{cell.angular:g}")
def test_every_cell_of_the_case_study_ends_where_the_thesis_has_it(cell: Cell) -> None:
    run = LockstepCanSeat(None).run("cell", single_segment(cell.linear, cell.angular, 10.0))
    assert difference(run.position, cell.thesis_offline) < 0.12
