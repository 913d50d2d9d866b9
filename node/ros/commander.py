# SPDX-License-Identifier: MIT
"""The other end of the model node's topics: sends stamped set-points and receives the odometry."""

import importlib
import math
import time
from collections.abc import Callable, Iterable
from typing import Final

from segway_ecc.firmware_io.clock import NS_PER_S
from segway_ecc.node.cycle.report import MODE_SUFFIX
from segway_ecc.node.cycle.setpoints import REST
from segway_ecc.node.errors import AbandonedError, NobodyListensError, RobotLostError
from segway_ecc.node.ros.messages import RosObject, duration, message_type, set_stamp, stamp_ns
from segway_ecc.node.ros.runtime import discovery_text
from segway_ecc.node.safety.modes import ACTIVE, Action, Mode
from segway_ecc.node.sequence.manoeuvre import LEAD_NS, Odometry, Player, PlayState, TimedSetpoint

_DEPTH: Final = 10
_ODOMETRY_DEPTH: Final = 1000
"""Odometry of ten seconds at 100 Hz may wait for us without loss."""
_SPIN_S: Final = 0.1
_REST_S: Final = 0.2
_REST_AHEAD_NS: Final = 100_000_000
_SILENCE_S: Final = 2.0
_ANSWER_S: Final = 2.0


class Commander:
    """Plays manoeuvres to the model node in one namespace.

    Attributes:
        mode: The robot's mode in its newest diagnostics; None before the first.
        reason: Why it is in that mode.
        confirmed: Stamps of the cycles in which the robot brought a set-point into force.
    """

    def __init__(self, node: RosObject, robot_node: str, stopped: Callable[[], str | None]) -> None:
        """Use `node`, an rclpy node of the robot's namespace, to command the model node named `robot_node`.

        Args:
            node: Publishes the set-points.
            robot_node: Name of the model node.
            stopped: Polled often; returns the signal that is to end what goes on, or None. (An exception raised in a
                signal handler would be lost where it hits rclpy's C++ code.)
        """
        executors = importlib.import_module("rclpy.executors")
        self.mode: Mode | None = None
        self.reason = ""
        self.confirmed: set[int] = set()
        self._stopped = stopped
        self._node = node
        self._executor = executors.SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._twist_type = message_type("geometry_msgs/msg/TwistStamped")
        self._publisher = node.create_publisher(self._twist_type, "cmd_vel_stamped", _ODOMETRY_DEPTH)
        self._arm_type = message_type("std_srvs/srv/Trigger")
        self._arm = node.create_client(self._arm_type, f"{robot_node}/{Action.ARM}")
        self._odometry: list[Odometry] = []
        self._armed_ns = 0
        node.create_subscription(message_type("nav_msgs/msg/Odometry"), "odom", self._receive_odometry, _ODOMETRY_DEPTH)
        node.create_subscription(
            self._twist_type, "setpoint", lambda message: self.confirmed.add(stamp_ns(message.header)), _ODOMETRY_DEPTH
        )
        diagnostics_type = message_type("diagnostic_msgs/msg/DiagnosticArray")
        node.create_subscription(diagnostics_type, "diagnostics", self._receive_diagnostics, _DEPTH)

    def wait_for_robot(self, wait_s: float, *, arm: bool = False) -> None:
        """Wait until the model node's topics are received and it has confirmed a set-point of ours.

        That we see its subscription does not mean that it sees us: discovery goes each way on its own. So set-points of
        zero are sent, for a moment ahead, until the robot confirms one. With `arm` it is armed, should it not be.

        Raises:
            NobodyListensError: Nobody did within `wait_s`, or the robot is not armed.
            AbandonedError: A signal came.
        """
        deadline_s = time.monotonic() + wait_s
        self._spin_until(lambda: self.mode is not None and bool(self._odometry), deadline_s, wait_s)
        if arm and self.mode not in ACTIVE:
            self._arm.wait_for_service(_ANSWER_S)
            answer = self._arm.call_async(self._arm_type.Request())
            self._executor.spin_until_future_complete(answer, _ANSWER_S)
            if not answer.done():
                raise NobodyListensError(f"the model node did not answer {self._arm.srv_name} within {_ANSWER_S:g} s")
            if not answer.result().success:
                raise NobodyListensError(f"the robot refuses to arm: {answer.result().message}")
            self.mode, self.reason = Mode.ARMED, answer.result().message
            self._armed_ns = self._odometry[-1].stamp_ns
        elif self.mode not in ACTIVE:
            raise NobodyListensError(
                f"the robot is {self.mode} ({self.reason}) and takes no set-points: arm it first, or add --arm"
            )
        sent: list[int] = []

        def is_confirmed() -> bool:
            now_ns = self._odometry[-1].stamp_ns
            if not sent or now_ns > sent[-1] + round(_REST_S * NS_PER_S):
                sent.append(now_ns + self._on_grid(_REST_AHEAD_NS))
                self._send(sent[-1], [TimedSetpoint(0, REST)])
            return not self.confirmed.isdisjoint(sent)

        self._spin_until(is_confirmed, deadline_s, wait_s)

    def play(self, player: Player, on_progress: Callable[[float], None]) -> None:
        """Play a manoeuvre to its end; `on_progress` is called with the fraction that has passed, 0 to 1.

        Raises:
            RobotLostError: The model node fell silent, or is no longer armed.
            AbandonedError: A signal came; set-points of zero were sent.
        """
        player.lead_ns = self._on_grid(LEAD_NS)
        del self._odometry[:-1]
        progress, received_s = PlayState.RUNNING, time.monotonic()
        while progress is PlayState.RUNNING:
            if self._odometry:
                received_s = time.monotonic()
            for odometry in self._odometry:
                progress = player.update(odometry)
            self._odometry.clear()
            self._send(player.start_ns, player.due_setpoints())
            on_progress(player.fraction)
            if time.monotonic() - received_s > _SILENCE_S:
                text = f"the model node has published no odometry for {_SILENCE_S:g} s; is it still running?"
                raise RobotLostError(text)
            if self.mode not in ACTIVE:
                raise RobotLostError(f"the robot went to {self.mode}: {self.reason}")
            if self._stopped() is not None:
                self._send(player.start_ns, player.abandon())
                self._publisher.wait_for_all_acked(duration(_ANSWER_S))
                raise AbandonedError(f"abandoned by {self._stopped()}; zero set-points were sent")
            self._executor.spin_once(timeout_sec=_SPIN_S)
        # The last set-points are confirmed a cycle after they came into force.
        deadline_s = time.monotonic() + _ANSWER_S
        while player.unconfirmed(self.confirmed) and time.monotonic() < deadline_s:
            self._executor.spin_once(timeout_sec=_SPIN_S)

    def _spin_until(self, done: Callable[[], bool], deadline_s: float, wait_s: float) -> None:
        while not done():
            if time.monotonic() > deadline_s:
                namespace, topic = self._node.get_namespace(), self._publisher.topic_name
                nodes = [f"{space.rstrip('/')}/{name}" for name, space in self._node.get_node_names_and_namespaces()]
                others = sorted(set(nodes) - {self._node.get_fully_qualified_name()})
                seen = f"nodes seen: {', '.join(others)}" if others else f"no node is seen at all ({discovery_text()})"
                raise NobodyListensError(
                    f"no model node subscribed to {topic} and published odom and diagnostics within {wait_s:g} s in "
                    f"namespace {namespace}; {seen}. Start one with: segway-ecc run ROBOT, or name its own with "
                    "--namespace"
                )
            self._executor.spin_once(timeout_sec=_SPIN_S)
            if self._stopped() is not None:
                raise AbandonedError(f"abandoned by {self._stopped()} while waiting for the robot")

    def _on_grid(self, duration_ns: int) -> int:
        """A duration rounded up to the robot's periods, as far as they were seen."""
        stamps = [odometry.stamp_ns for odometry in self._odometry[-2:]]
        period_ns = stamps[-1] - stamps[0]
        return -(-duration_ns // period_ns) * period_ns if period_ns else duration_ns

    def _send(self, start_ns: int | None, setpoints: Iterable[TimedSetpoint]) -> None:
        for offset_ns, setpoint in setpoints:
            message = self._twist_type()
            set_stamp(message.header, (start_ns or 0) + offset_ns)
            message.twist.linear.x = setpoint.linear_velocity
            message.twist.angular.z = setpoint.angular_velocity
            self._publisher.publish(message)

    def _receive_odometry(self, message: RosObject) -> None:
        pose, twist = message.pose.pose, message.twist.twist
        heading = math.remainder(2.0 * math.atan2(pose.orientation.z, pose.orientation.w), math.tau)
        self._odometry.append(
            Odometry(
                stamp_ns(message.header), pose.position.x, pose.position.y, heading, twist.linear.x, twist.angular.z
            )
        )

    def _receive_diagnostics(self, message: RosObject) -> None:
        if stamp_ns(message.header) <= self._armed_ns:
            return  # from before the robot answered that it is armed
        for status in message.status:
            if status.name.endswith(MODE_SUFFIX):
                values = {pair.key: pair.value for pair in status.values}
                self.mode, self.reason = Mode(values["mode"]), values["reason"]
