# SPDX-License-Identifier: MIT
"""The other end of the model node's topics: sends a manoeuvre whole, and receives what the robot publishes of it."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Final

from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.cycle.trajectory import CANCEL, TOO_LATE, Trajectory
from segway_ecc.node.errors import AbandonedError, NobodyListensError, NodeError, RobotLostError, SequenceError
from segway_ecc.node.ros.messages import RosObject, message_type, stamp_ns
from segway_ecc.node.ros.runtime import discovery_text
from segway_ecc.node.ros.trajectories import (
    STATUS_DEPTH,
    STATUS_TOPIC,
    STATUS_TYPE,
    TRAJECTORY_TOPIC,
    TRAJECTORY_TYPE,
    read_status,
    trajectory_message,
)
from segway_ecc.node.safety.modes import ACTIVE, Action, Mode
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Odometry, Player, PlayState, start_stamp

_DEPTH: Final = 10
_ODOMETRY_DEPTH: Final = 1000
"""Odometry of ten seconds at 100 Hz may wait for us without loss."""
_SPIN_S: Final = 0.1
_STOPPED_S: Final = 0.5
"""A spin that took so long is one in which this process was stopped; a busy machine takes a third of it."""
_SILENCE_S: Final = 8.0
"""A model node whose ROS process died publishes again before, and the manoeuvre goes on meanwhile."""
_ANSWER_S: Final = 2.0
_AGAIN_S: Final = 0.5
"""Without an answer a trajectory is sent again after so long: that we see a robot does not mean that it sees us."""
_CONFIRMED_WITHIN_S: Final = 10.0
"""The robot repeats each second what became of a sequence, and DDS within 3 s what was lost."""
_TURNS: Final = 10
"""Each publisher counts its messages: where several publish the count goes back all the time, with a new one once."""
_LOOK_S: Final = 1.0
"""Robots publish at 20 Hz and more; those that are slower are found while the manoeuvre is played."""
_LONGEST_LEAD_NS: Final = 8_000_000_000


class Commander:
    """Plays manoeuvres to the model node in one namespace.

    How long it waits is counted in time in which it could receive: where this process was stopped or starved, what
    arrived meanwhile is looked at before anything is taken for lost.

    Attributes:
        mode: The robot's mode in its newest diagnostics; None before the first.
        reason: Why it is in that mode.
        took_s: How long the manoeuvre took in real time, from its first odometry to its last, s: at least, as it counts
            in time in which this process could receive. The robot's stamps do not tell: they stand while its loop does.
    """

    def __init__(
        self,
        node: RosObject,
        executor: RosObject,
        robot_node: str,
        stopped: Callable[[], str | None],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Use `node`, an rclpy node of the robot's namespace, to command the model node named `robot_node`.

        Args:
            node: Publishes the trajectory.
            executor: Of that node; see `steady_executor`.
            robot_node: Name of the model node.
            stopped: Polled often; returns the signal that is to end what goes on, or None. (An exception raised in a
                signal handler would be lost where it hits rclpy's C++ code.)
            monotonic_s: The clock that how long things take is counted by, s.
        """
        self.mode: Mode | None = None
        self.reason = ""
        self.took_s = 0.0
        self._monotonic_s = monotonic_s
        self._stopped = stopped
        self._node = node
        self._executor = executor
        self._publisher = node.create_publisher(message_type(TRAJECTORY_TYPE), TRAJECTORY_TOPIC, _DEPTH)
        self._arm_type = message_type("std_srvs/srv/Trigger")
        self._arm = node.create_client(self._arm_type, f"{robot_node}/{Action.ARM}")
        self._latest_ns = 0
        self._number = self._turns = 0
        self._has_status = False
        self._armed_ns = 0
        node.create_subscription(message_type("nav_msgs/msg/Odometry"), "odom", self._receive_odometry, _ODOMETRY_DEPTH)
        self._player: Player | None = None
        node.create_subscription(message_type(STATUS_TYPE), STATUS_TOPIC, self._receive_status, STATUS_DEPTH)
        diagnostics_type = message_type("diagnostic_msgs/msg/DiagnosticArray")
        node.create_subscription(diagnostics_type, "diagnostics", self._receive_diagnostics, _DEPTH)

    @property
    def loss(self) -> str:
        """Why odometry of the robot may be missing, as far as it is known here."""
        if self._turns:
            return "the robot's ROS process ended meanwhile and was replaced (its console has when)"
        return "on the way, it is not known where (a busy machine or a poor network loses messages)"

    def wait_for_robot(self, wait_s: float, *, arm: bool = False) -> None:
        """Wait until the model node's topics are received, and it is armed; with `arm` it is, should it not be.

        Raises:
            NobodyListensError: Nobody did within `wait_s`, or several robots did, or the robot is not armed.
            AbandonedError: A signal came.
        """
        self._spin_until(lambda: self.mode is not None and self._has_status and bool(self._latest_ns), wait_s)
        self._look_around()
        if arm and self.mode not in ACTIVE:
            self._arm.wait_for_service(_ANSWER_S)
            answer = self._arm.call_async(self._arm_type.Request())
            self._executor.spin_until_future_complete(answer, _ANSWER_S)
            if not answer.done():
                raise NobodyListensError(f"the model node did not answer {self._arm.srv_name} within {_ANSWER_S:g} s")
            if not answer.result().success:
                raise NobodyListensError(f"the robot refuses to arm: {answer.result().message}")
            self.mode, self.reason = Mode.ARMED, answer.result().message
            self._armed_ns = self._latest_ns
        elif self.mode not in ACTIVE:
            raise NobodyListensError(
                f"the robot is {self.mode} ({self.reason}) and takes no set-points: arm it first, or add --arm"
            )

    def play(self, player: Player, on_progress: Callable[[float], None], wait_s: float) -> None:
        """Send a manoeuvre, and watch how the robot plays it to its end.

        Args:
            player: The manoeuvre.
            on_progress: Called with the fraction that has passed, 0 to 1.
            wait_s: How long to wait for the robot to accept it, s.

        Raises:
            NobodyListensError: The robot did not answer within `wait_s`, or several robots are in its namespace.
            SequenceError: The robot refused it, or did not confirm its end.
            RobotLostError: The model node fell silent, or broke it off.
            AbandonedError: A signal came; the manoeuvre was cancelled.
        """
        self._player = player
        try:
            self._offer(player, wait_s)
            self._watch(player, on_progress)
        except AbandonedError as error:
            raise AbandonedError(f"{error}; {self._cancel(player)}") from None
        except NodeError:
            self._cancel(player)  # it may have been accepted, and go on without us
            self._look_around()  # what two robots answer contradicts itself
            raise

    def _offer(self, player: Player, wait_s: float) -> None:
        """Send it until the robot answers, and anew, with more time, where it came too late to begin when it was to."""
        lead_ns, waited_s, unanswered_s = LEAD_NS, 0.0, 0.0
        trajectory = player.trajectory(start_stamp(self._latest_ns, lead_ns))
        self._send(trajectory)
        while player.state in (PlayState.WAITING, PlayState.REFUSED):
            elapsed_s = self._spin()
            self._check_alone()
            waited_s, unanswered_s = waited_s + elapsed_s, unanswered_s + elapsed_s
            if player.state is PlayState.REFUSED:
                reason = player.status.reason if player.status is not None else ""
                if not reason.startswith(TOO_LATE) or waited_s > wait_s:
                    raise SequenceError(f"the robot refused the sequence: {reason}")
                lead_ns = min(2 * lead_ns, _LONGEST_LEAD_NS)
                trajectory, unanswered_s = player.trajectory(start_stamp(self._latest_ns, lead_ns)), _AGAIN_S
            elif waited_s > wait_s:
                raise NobodyListensError(
                    f"the model node did not answer on {STATUS_TOPIC} within {wait_s:g} s whether it takes the sequence"
                )
            if unanswered_s >= _AGAIN_S:
                self._send(trajectory)  # the robot takes each stamp once
                unanswered_s = 0.0

    def _watch(self, player: Player, on_progress: Callable[[float], None]) -> None:
        silent_s = unconfirmed_s = 0.0
        turn_began_s = self._monotonic_s()
        while player.state is PlayState.RUNNING:
            before_ns, was_under_way = self._latest_ns, player.is_under_way
            elapsed_s = self._spin()
            turn_began_s, before_s = self._monotonic_s(), turn_began_s
            if was_under_way:
                turn_s = turn_began_s - before_s
                self.took_s += turn_s if turn_s < _STOPPED_S else elapsed_s
            self._check_alone()
            silent_s = silent_s + elapsed_s if self._latest_ns == before_ns else 0.0
            on_progress(player.fraction)
            if self.mode not in ACTIVE:
                raise RobotLostError(f"the robot went to {self.mode}: {self.reason}")
            if silent_s > _SILENCE_S:
                text = f"the model node has published no odometry for {_SILENCE_S:g} s; is it still running?"
                raise RobotLostError(text)
            unconfirmed_s += elapsed_s if player.has_reached_end else 0.0
            if unconfirmed_s > _CONFIRMED_WITHIN_S:
                raise SequenceError("the robot did not confirm that it played the sequence to its end")
        if player.state is not PlayState.DONE and player.status is not None:
            raise RobotLostError(player.status.reason)

    def _cancel(self, player: Player) -> str:
        """Cancel the trajectory, if it is not over, until the robot confirms that; what came of it, for a message."""
        self._stopped = lambda: None
        waited_s, again_s = 0.0, 0.0
        while player.state in (PlayState.WAITING, PlayState.RUNNING):
            if waited_s > _ANSWER_S:
                return "the robot did not confirm that it stopped"
            if waited_s >= again_s:
                self._send(CANCEL)
                again_s += _AGAIN_S
            waited_s += self._spin()
        return "the robot was stopped"

    def _look_around(self) -> None:
        """Where several publish odometry, wait until it shows whether all of them still do; see `_check_alone`."""
        looked_s = 0.0
        while self._node.count_publishers("odom") > 1 and looked_s < _LOOK_S:
            looked_s += self._spin()
            self._check_alone()

    def _check_alone(self) -> None:
        """Make sure that one robot answers, not several; one whose process was replaced is still seen for 20 s."""
        count = self._node.count_publishers("odom")
        if count > 1 and self._turns > _TURNS:
            raise NobodyListensError(
                f"{count} robots are in namespace {self._node.get_namespace()}, and which one answers is not known: "
                "give each its own with --namespace"
            )

    def _spin(self) -> float:
        """Handle what arrives; return how long that took, s, in which this process could have handled more.

        Raises:
            AbandonedError: A signal came.
        """
        before_s = self._monotonic_s()
        self._executor.spin_once(timeout_sec=_SPIN_S)
        if self._stopped() is not None:
            raise AbandonedError(f"abandoned by {self._stopped()}")
        return min(self._monotonic_s() - before_s, _SPIN_S)

    def _spin_until(self, done: Callable[[], bool], wait_s: float) -> None:
        waited_s = 0.0
        while not done():
            if waited_s > wait_s:
                namespace, topic = self._node.get_namespace(), self._publisher.topic_name
                nodes = [f"{space.rstrip('/')}/{name}" for name, space in self._node.get_node_names_and_namespaces()]
                others = sorted(set(nodes) - {self._node.get_fully_qualified_name()})
                seen = f"nodes seen: {', '.join(others)}" if others else f"no node is seen at all ({discovery_text()})"
                raise NobodyListensError(
                    f"no model node subscribed to {topic} and published odom and diagnostics within {wait_s:g} s in "
                    f"namespace {namespace}; {seen}. Start one with: segway-ecc run ROBOT, or name its own with "
                    "--namespace"
                )
            try:
                waited_s += self._spin()
            except AbandonedError as error:
                raise AbandonedError(f"{error} while waiting for the robot") from None

    def _send(self, trajectory: Trajectory) -> None:
        self._publisher.publish(trajectory_message(trajectory))

    def _receive_odometry(self, message: RosObject, info: Mapping[str, int]) -> None:
        number = info["publication_sequence_number"]
        self._turns += number <= self._number
        self._number = number
        pose, twist = message.pose.pose, message.twist.twist
        heading = math.remainder(2.0 * math.atan2(pose.orientation.z, pose.orientation.w), math.tau)
        self._latest_ns = stamp_ns(message.header)
        if self._player is not None:
            numbers = pose.position.x, pose.position.y, heading, twist.linear.x, twist.angular.z
            self._player.receive_odometry(Odometry(self._latest_ns, *numbers))

    def _receive_status(self, message: RosObject) -> None:
        status = read_status(message)
        if status is not None:
            self._has_status = True
            if self._player is not None:
                self._player.receive_status(status)

    def _receive_diagnostics(self, message: RosObject) -> None:
        if stamp_ns(message.header) <= self._armed_ns:
            return  # from before the robot answered that it is armed
        for status in message.status:
            if status.name.endswith(MODE_SUFFIX) and "/" not in status.name:  # else of a robot in another namespace
                values = {pair.key: pair.value for pair in status.values}
                mode = values.get("mode", "")
                if mode in Mode.__members__:  # others in this namespace may have modes of their own
                    self.mode, self.reason = Mode(mode), values.get("reason", "")
