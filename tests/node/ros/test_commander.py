# SPDX-License-Identifier: MIT
"""What the commander takes of the robot's diagnostics, on a node that a test stands in for."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from segway_ecc.node.cycle.trajectory import TrajectoryState, TrajectoryStatus
from segway_ecc.node.errors import NobodyListensError
from segway_ecc.node.ros.commander import Commander
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.sequence.manoeuvre import Odometry, Player, PlayState, single_segment

pytestmark = pytest.mark.ros


def diagnostics(second: int, name: str, **values: str) -> Any:
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
    header = SimpleNamespace(stamp=SimpleNamespace(sec=second, nanosec=0))
    return SimpleNamespace(header=header, status=[SimpleNamespace(name=name, values=pairs)])


def callbacks(node: MagicMock) -> dict[str, Callable[..., None]]:
    return {call.args[1]: call.args[2] for call in node.create_subscription.call_args_list}


@pytest.mark.parametrize("values", [{}, {"mode": "REVERSE"}, {"reason": "in gear 2"}, {"mode": ""}])
def test_mode_in_diagnostics_that_is_not_of_a_robot_changes_nothing(values: dict[str, str]) -> None:
    node = MagicMock()
    commander = Commander(node, MagicMock(), "model", lambda: None)
    receive = callbacks(node)
    receive["diagnostics"](diagnostics(1, "alice: mode", mode="ARMED", reason="asked to arm"))
    receive["diagnostics"](diagnostics(2, "gearbox: mode", **values))
    assert (commander.mode, commander.reason) == (Mode.ARMED, "asked to arm")


def test_mode_of_a_robot_in_another_namespace_changes_nothing() -> None:
    node = MagicMock()
    commander = Commander(node, MagicMock(), "model", lambda: None)
    receive = callbacks(node)
    receive["diagnostics"](diagnostics(1, "alice: mode", mode="ARMED", reason="asked to arm"))
    receive["diagnostics"](diagnostics(2, "robot1/alice: mode", mode="FAULT", reason="stop was pressed"))
    assert (commander.mode, commander.reason) == (Mode.ARMED, "asked to arm")


def test_an_answer_of_one_of_two_robots_ends_with_their_number() -> None:
    node, executor = MagicMock(), MagicMock()
    node.count_publishers.return_value = 2
    commander = Commander(node, executor, "model", lambda: None)
    odometry, numbers = MagicMock(), iter(range(1000))
    odometry.pose.pose.orientation = SimpleNamespace(z=0.0, w=1.0)

    def receive_of_both(**_: float) -> None:
        number = next(numbers)
        info = {"publication_sequence_number": number // 2 if number % 2 else 1000 + number}
        callbacks(node)["odom"](odometry, info)

    executor.spin_once.side_effect = receive_of_both
    player = MagicMock(state=PlayState.REFUSED)
    player.status.reason = "another sequence is being driven"
    player.trajectory.return_value = Player(single_segment(1.0, 0.0, 1.0)).trajectory(0)
    with pytest.raises(NobodyListensError, match="2 robots are in namespace"):
        commander.play(player, lambda _: None, 1.0)


class Robot:
    """Answers each spin: it accepts, sends odometry each 10 ms, and stands for a while in the middle."""

    def __init__(self, player: Player, stands_s: float, we_stop_s: float = 0.0) -> None:
        self.player = player
        self.time_s = 0.0
        self._pauses = [0.1] * round(stands_s / 0.1) + [we_stop_s]
        self._stamps = iter(range(0, 1_100_000_001, 10_000_000))

    def spin_once(self, timeout_sec: float) -> None:
        """What arrives within the time-out, or nothing."""
        if self.player.status is None:
            trajectory = self.player.trajectory(0)
            accepted = TrajectoryState.ACCEPTED, "", 50_000_000, 1_050_000_000, 100, trajectory.digest
            self.player.receive_status(TrajectoryStatus(0, *accepted))
        elif self.player.latest_ns >= 500_000_000 and self._pauses:
            self.time_s += self._pauses.pop()
        else:
            self.time_s += min(0.01, timeout_sec)
            self.player.receive_odometry(Odometry(next(self._stamps), 0.0, 0.0, 0.0, 0.0, 0.0))
            if self.player.has_reached_end and self.player.status is not None:
                self.player.receive_status(self.player.status._replace(state=TrajectoryState.DONE))


@pytest.mark.parametrize(("stands_s", "we_stop_s", "took_s"), [(0.0, 0.0, 1.0), (1.5, 0.0, 2.5), (0.0, 5.0, 1.1)])
def test_how_long_it_took_is_counted_while_this_process_could_receive(
    stands_s: float, we_stop_s: float, took_s: float
) -> None:
    player = Player(single_segment(1.0, 0.0, 1.0))
    robot, node = Robot(player, stands_s, we_stop_s), MagicMock()
    node.count_publishers.return_value = 1
    commander = Commander(node, robot, "model", lambda: None, lambda: robot.time_s)
    commander.mode = Mode.ARMED
    commander.play(player, lambda _: None, 1.0)
    assert commander.took_s == pytest.approx(took_s)
