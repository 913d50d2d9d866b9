# SPDX-License-Identifier: MIT
"""The guard with each family's simulated drives, in lock step: when it acts, and when it does not."""

from collections.abc import Callable
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
ROBOTS = ["cart-can", "cart-odrive", "cart-vesc", "cart-cia402", "cart-moteus"]
REPORTING = ["cart-can", "cart-odrive", "cart-cia402", "cart-moteus"]
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
    assert g.guard_link.counters.sent == 0


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
    g.guard = g.new_guard(g.rig.bus.attach("late guard"))
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


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_node_that_was_stopped_and_goes_on_begins_with_zeros(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    g.drive(20)
    g.wait(500)
    g.moments.clear()
    witness = g.rig.bus.attach("witness")
    sensors = g.robot.exchange((1.0, 1.0))
    g.wait(50)
    stopper = stopper_of(g.settings)
    found = [observed.meaning for frame in witness.receive() if (observed := stopper.read(frame)) is not None]

    assert sensors.faults[:2] == (
        "the guard stopped the drives: the node's heartbeats stopped",
        "this node sent no command for 500 ms",
    )
    assert Meaning.MOVE not in found
    assert not any(any(abs(value) > 1e-3 for value in given) for _, given in g.moments)


@pytest.mark.parametrize("robot", ROBOTS)
def test_without_a_guard_too_and_the_reason_names_the_drives(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.is_watched = False
    g.arm()
    g.drive(20)
    g.wait(200)
    sensors = g.robot.exchange((1.0, 1.0))

    assert sensors.faults[0] == "this node sent no command for 200 ms"
    if robot == "cart-can":
        assert sensors.faults[1:] == ("the wheel board switched its motors off: WATCHDOG",)
    assert all(not drive.is_enabled for drive in g.robot._drives)


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_stopped_node_s_old_command_does_nothing(guarded: Any, cart_of: Callable[[int], str], protocol: int) -> None:
    """Should a frame have left between the look at the clock and the stop: the guard is there too."""
    g = guarded(cart_of(protocol))
    g.arm()
    g.drive(20)
    g.kill()
    g.wait(500)
    g.bus.fault, g.beats.is_cut = None, False
    g.moments.clear()
    for _ in range(2):
        g.beats.beat(is_on=True)
        g.robot._drives[0]._send(WheelCommand(1.0, 1.0, enable=True))
        g.wait(5)
    g.wait(30)

    # The guard's frames have moved the board's counter on, so that it refuses even the first of these. So does the
    # guard in version 2, where a count comes once; in version 1 it may come again, and is answered.
    assert not any(any(given) for _, given in g.moments)
    assert [done.cause for done in g.watch.interventions] == [Cause.SILENCE, Cause.DEFIANCE][: 3 - protocol]
    assert not g.gives_torque


def record(g: Any, cycles: int) -> list[tuple[int, Frame]]:
    """What the node sends in so many cycles, with when it came."""
    recorder = g.rig.bus.attach("recorder")
    g.drive(cycles)
    ids = {(key.arbitration_id, key.is_extended) for drive in g.robot._drives for key in drive.commanded_by}
    frames = [frame for frame in recorder.receive() if (frame.arbitration_id, frame.is_extended) in ids]
    return [(frame.received_ns, frame) for frame in frames]


def play(g: Any, recording: list[tuple[int, Frame]]) -> None:
    player, began_ns = g.rig.bus.attach("player"), g.rig.now_ns()
    for at_ns, frame in recording:
        g.rig.sleep_until_ns(began_ns + at_ns - recording[0][0])
        player.send(frame)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_recording_keeps_no_drive_on_when_the_node_is_dead(guarded: Any, robot: str) -> None:
    """The drives tick every 5 ms here, and the guard with them, so that its answer may take as long.

    What was recorded of a wheel board's session is none of its commands any more, so there is nothing to answer.
    """
    g = guarded(robot)
    g.arm()
    recording = record(g, 150)
    g.kill()
    killed_ns = g.rig.now_ns()
    play(g, recording)
    g.wait(50)
    after = [abs(given[0]) for at_ns, given in g.moments if at_ns > killed_ns + 50 * MS]

    assert g.watch.strange == 0 if robot == "cart-can" else g.watch.strange > 50
    assert g.watch.intervened == 1
    assert not g.gives_torque
    # A VESC takes every current: each of the recording's is answered, and acts until then.
    assert sum(after) / len(after) < (0.15 if robot == "cart-vesc" else 1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_recording_that_arms_keeps_no_drive_on_when_the_node_is_dead(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.robot.open()
    while g._arming_failures():
        g.cycle((0.0, 0.0))
    g.robot.arm()
    recording = record(g, 100)
    g.kill()
    g.wait(500)
    g.moments.clear()
    play(g, recording)
    g.wait(50)
    given = [abs(values[0]) for _, values in g.moments]

    assert len(given) > 100
    assert sum(given) / len(given) < (0.15 if robot == "cart-vesc" else 0.02)


@pytest.mark.parametrize("robot", ROBOTS)
def test_frames_of_another_are_a_fault_in_the_same_exchange(guarded: Any, robot: str) -> None:
    g = guarded(robot)
    g.arm()
    recording = record(g, 1)
    g.drive(20)
    player = g.rig.bus.attach("player")
    player.send(recording[-1][1])
    sensors = g.cycle()

    (reason, *_) = sensors.faults
    assert reason.startswith(f"command frames that this node did not send, 0x{recording[-1][1].arbitration_id:X} (1): ")
    assert all(not drive.is_enabled for drive in g.robot._drives)
    g.robot.disarm()
    assert [text for text in g.robot.arming_failures() if text.startswith("another controller")]
    for _ in range(120):
        g.cycle()

    assert not [text for text in g.robot.arming_failures() if text.startswith("another controller")]


@pytest.mark.parametrize("deaf", range(17))
def test_the_board_takes_the_guard_s_first_burst_whatever_the_guard_missed(deaf: int) -> None:
    """The board follows the node's counter; the guard has not heard the newest `deaf` commands."""
    rig = LockstepRig(500_000)
    board = SimulatedWheelBoard(rig.bus.attach("board"), WheelBoardSettings(protocol=1))
    stopper = stopper_of(WheelBoardSettings(protocol=1))
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
