# SPDX-License-Identifier: MIT
"""The guard of a robot whose only line is a serial one, in lock step: it writes there, and reads nothing."""

from typing import Any

import pytest

from segway_ecc.firmware_io.guard.watch import Cause, End
from segway_ecc.firmware_io.links.serial_writer import SerialWriter

MS = 1_000_000
ROBOT = "cart-hoverboard"


def roll(guarded: Any, cycles: int) -> None:
    """Cycles with a torque with which the wheels stay below the board's limit of speed."""
    for _ in range(cycles):
        guarded.cycle((0.2, 0.2))


def test_a_dead_node_s_torque_ends_within_50_ms(guarded: Any) -> None:
    for cycles in (50, 51, 57):
        g = guarded(ROBOT)
        assert isinstance(g.guard_link, SerialWriter)
        g.arm()
        roll(g, cycles)
        assert g.gives_torque
        last_ns = g.rig.now_ns()
        g.kill()
        g.wait(50)

        assert not g.gives_torque
        (done,) = g.watch.interventions
        assert done.cause is Cause.SILENCE
        assert 30 * MS < done.first_ns - last_ns <= 40 * MS
        g.wait(1_500)
        assert done.end is End.TIME
        assert g.watch.intervened == 1


def test_without_a_guard_torque_goes_on_for_as_long_as_the_firmware_waits(guarded: Any) -> None:
    g = guarded(ROBOT)
    g.is_watched = False
    g.arm()
    roll(g, 50)
    g.kill()
    g.wait(790)
    assert g.gives_torque
    g.wait(60)
    assert not g.gives_torque


def test_a_node_that_lives_is_not_disturbed(guarded: Any) -> None:
    g = guarded(ROBOT)
    g.wait(200)
    g.arm()
    g.drive(100)
    g.robot.disarm()
    g.drive(20)
    assert not g.gives_torque
    g.robot.arm()
    g.drive(100)
    g.robot.close()
    g.wait(100)

    assert not g.gives_torque
    assert g.watch.intervened == 0
    assert g.guard_link.counters.sent == 0


def test_a_node_that_comes_back_is_told_who_stopped_it(guarded: Any) -> None:
    g = guarded(ROBOT)
    g.arm()
    g.drive(50)
    g.wait(45)
    sensors = g.cycle()
    assert not g.gives_torque
    assert sensors.faults[0].startswith("the guard stopped the drives: the node's heartbeats stopped")


@pytest.mark.parametrize("torque", [(0.2, 0.2), (0.0, 0.0)])
def test_the_last_zero_reaches_the_board_also_right_after_a_command(guarded: Any, torque: tuple[float, float]) -> None:
    """Two packets without a pause between them are one block to the firmware, of which it takes nothing."""
    g = guarded(ROBOT)
    g.is_watched = False
    g.arm()
    roll(g, 50)
    assert g.gives_torque
    g.cycle(torque)
    g.robot.close()
    g.wait(20)
    assert not g.gives_torque
