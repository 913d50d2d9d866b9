# SPDX-License-Identifier: MIT
"""The guard with each family's simulated drives, in lock step: when it acts, and when it does not."""

from typing import Any

import pytest

from segway_ecc.firmware_io.drives.stopper import Meaning
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardState, Endpoint, FrameId, WheelCommand
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.guard.guard import stopper_of
from segway_ecc.firmware_io.guard.watch import Cause, End
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.wheel_board import SimulatedWheelBoard
from segway_ecc.hil.rig.simulation import LockstepRig

MS = 1_000_000
ROBOTS = ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402"]
REPORTING = ["cart-can", "cart-odrive", "cart-cia402"]
AT_REST = {"left.angle": 0.0, "left.velocity": 0.0, "right.angle": 0.0, "right.velocity": 0.0}


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_dead_node_s_torque_ends_in_time(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    g.drive(50)
    last_ns = g.rig.now_ns()
    assert g.watch.intervened == 0
    g.kill()
    g.wait(29)
    assert g.watch.intervened == 0
    g.wait(21)

    assert not g.gives_torque
    assert g.watch.intervened == 1
    (done,) = g.watch.interventions
    assert done.cause is Cause.SILENCE
    assert 30 * MS < done.first_ns - last_ns <= 40 * MS
    g.wait(1_500)
    assert done.end is (End.TIME if robot == "cart-vesc" else End.OFF)
    assert g.watch.intervened == 1


@pytest.mark.parametrize("robot", ROBOTS)
def test_without_the_guard_only_the_drive_s_own_watchdog_would(guarded: Any, robot: str) -> None:
    """That the test above can fail: at the time at which the guard has acted, the drive by itself has not."""
    g = guarded(robot)
    g.arm()
    g.drive(50)
    g.is_watched = False
    g.kill()
    g.wait(40)

    assert g.gives_torque


@pytest.mark.parametrize("robot", ROBOTS)
def test_start_drive_disarm_and_stop_go_undisturbed(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.wait(200)
    g.arm()
    g.drive(100)
    g.robot.disarm()
    g.drive(100)
    while g._arming_failures():
        g.cycle()
    g.robot.arm()
    g.drive(100)
    g.robot.close()
    g.wait(1_000)

    assert g.watch.intervened == 0
    assert g.voice.counters.sent == 0


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_disarmed_node_that_dies_leaves_nothing_to_do(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    g.drive(20)
    g.robot.disarm()
    g.drive(20)
    g.kill()
    g.wait(1_000)

    assert g.watch.intervened == 0


@pytest.mark.parametrize("robot", REPORTING)
def test_a_node_that_dies_while_it_arms_leaves_no_drive_on(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    witness = g.rig.bus.attach("witness")
    g.robot.open()
    while g._arming_failures():
        g.cycle((0.0, 0.0))
    g.robot.arm()
    g.drive(3)
    g.kill()
    g.wait(200)
    stopper = stopper_of(g.settings)
    heard = [told for frame in witness.receive() if (told := stopper.read(frame)) is not None]
    last = {told.drive: told.meaning for told in heard if told.meaning in (Meaning.ON, Meaning.OFF)}

    assert last
    assert set(last.values()) == {Meaning.OFF}
    assert not g.gives_torque


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_guard_that_comes_late_finds_its_way_in(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.is_watched = False
    g.arm()
    g.drive(50)
    g.guard = g.new_guard(g.rig.bus.attach("late ears"))
    g.is_watched = True
    g.drive(50)
    assert g.watch.intervened == 0
    g.kill()
    g.wait(50)

    assert g.watch.intervened == 1
    assert not g.gives_torque


@pytest.mark.parametrize("robot", ROBOTS)
def test_commands_over_another_line_are_seen_by_their_heartbeats(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    g.drive(20)
    for _ in range(100):
        g.beats.beat(is_on=True)
        g.wait(10)
    g.wait(2)

    assert g.watch.intervened == 0
    assert g.watch.heartbeats > 100


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_node_that_restarts_drives_again(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    g.drive(20)
    g.kill()
    g.wait(2_000)
    g.bus.fault, g.beats.is_cut = None, False
    g.robot.disarm()
    g.arm()
    g.drive(50)

    assert g.gives_torque
    assert g.watch.intervened == 1


@pytest.mark.parametrize("robot", ["cart-can"])
def test_a_node_that_was_stopped_and_goes_on_moves_nothing(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    g.drive(20)
    g.kill()
    g.wait(500)
    g.bus.fault = None
    g.moments.clear()
    # As after SIGCONT: the first exchange still sends the old command.
    g.robot._drives[0]._endpoint.send(FrameId.WHEEL_COMMAND, WheelCommand(1.0, 1.0, enable=True))
    g.wait(5)
    g.robot._drives[0]._endpoint.send(FrameId.WHEEL_COMMAND, WheelCommand(1.0, 1.0, enable=True))
    g.wait(50)

    # The guard's frames have moved the board's counter on, so that it refuses even the first of these.
    assert not any(any(given) for _, given in g.moments)
    assert [done.cause for done in g.watch.interventions] == [Cause.SILENCE, Cause.DEFIANCE]
    assert not g.gives_torque


@pytest.mark.parametrize("deaf", range(17))
def test_the_board_takes_the_guard_s_first_burst_whatever_the_guard_missed(deaf: int) -> None:
    """The board follows the node's counter; the guard has not heard the newest `deaf` commands."""
    rig = LockstepRig(500_000)
    board = SimulatedWheelBoard(rig.bus.attach("board"), WheelBoardSettings())
    stopper = stopper_of(WheelBoardSettings())
    sent: list[Frame] = []
    node = SimulatedNode(sent)
    node.command(enable=False)
    for _ in range(30):
        node.command(enable=True)
    for frame in sent[: len(sent) - deaf]:
        stopper.read(frame)
    assert list(board.obey(sent, 0, AT_REST)) == [5.0, 5.0]
    given = board.obey(stopper.stop(), 5 * MS, AT_REST)

    assert list(given) == [0.0, 0.0]
    assert board.state is BoardState.DISABLED
    if deaf == 0:
        # The first frame of the burst alone does.
        assert board.refused_frames == 0


class SimulatedNode:
    """Commands as the driver sends them."""

    def __init__(self, sent: list[Frame]) -> None:
        self._sent = sent
        self._endpoint = Endpoint(self.send, frozenset())

    def send(self, frame: Frame) -> bool:
        self._sent.append(frame)
        return True

    def command(self, *, enable: bool) -> None:
        self._endpoint.send(FrameId.WHEEL_COMMAND, WheelCommand(5.0, 5.0, enable))
