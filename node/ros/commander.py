"""The other end of the model node's topics: sends stamped set-points and hears the odometry."""

import importlib
import math
import time
from collections.abc import Callable, Iterable
from typing import Final

from node.cycle.setpoints import REST
from node.errors import NobodyListensError, RobotLostError
from node.ros.graph import Connection, connections
from node.ros.messages import message_type, set_stamp, stamp_ns
from node.ros.runtime import discovery_text
from node.ros.untyped import RosObject
from node.sequence.manoeuvre import Said
from node.sequence.player import LEAD_NS, Odometry, Player, Progress

_DEPTH: Final = 10
_HEARD_DEPTH: Final = 1000
"""Odometry of ten seconds at 100 Hz may wait for us without loss."""
_SPIN_S: Final = 0.1
_LOST_SPINS: Final = 20
_ACKNOWLEDGE_S: Final = 0.4


class Commander:
    """Plays manoeuvres to the model node in one namespace."""

    def __init__(self, node: RosObject) -> None:
        """Speak through `node`, an rclpy node of the robot's namespace."""
        executors = importlib.import_module("rclpy.executors")
        self._node = node
        self._executor = executors.SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        self._twist_type = message_type("geometry_msgs/msg/TwistStamped")
        self._publisher = node.create_publisher(self._twist_type, "cmd_vel_stamped", _HEARD_DEPTH)
        odometry_type = message_type("nav_msgs/msg/Odometry")
        self._heard: list[Odometry] = []
        node.create_subscription(odometry_type, "odom", self._hear, _HEARD_DEPTH)

    def wait_for_robot(self, wait_s: float) -> None:
        """Wait until we have heard the model node and it has acknowledged a set-point of ours.

        That we see its subscription does not mean that it sees us: discovery goes each way on its own. So the robot is
        told to rest, from a lead ahead, until it has acknowledged that.

        Raises:
            NobodyListensError: Nobody did within `wait_s`.
        """
        told = False
        deadline_s = time.monotonic() + wait_s
        while time.monotonic() < deadline_s:
            self._executor.spin_once(timeout_sec=_SPIN_S)
            if told and self._publisher.wait_for_all_acked(_duration(0.0)):
                return
            if self._publisher.get_subscription_count() and self._heard:
                self._send(self._heard[-1].stamp_ns + LEAD_NS, [Said(0, REST)])
                told = True
        raise NobodyListensError(self._why_nobody(wait_s))

    def play(self, player: Player, on_progress: Callable[[float], None]) -> None:
        """Play a manoeuvre to its end.

        Args:
            player: The manoeuvre.
            on_progress: Called with the fraction that has passed, 0 to 1.

        Raises:
            RobotLostError: The model node fell silent.
        """
        self._heard = self._heard[-1:]
        silent = 0
        while True:
            progress = Progress.RUNNING
            for odometry in self._heard:
                progress = player.hear(odometry)
            silent = 0 if self._heard else silent + 1
            self._heard.clear()
            self._send(player.start_ns, player.say())
            on_progress(player.fraction)
            if progress is Progress.DONE:
                return
            if silent > _LOST_SPINS:
                raise RobotLostError(
                    f"the model node has published no odometry for {_LOST_SPINS * _SPIN_S:g} s; is it still running?"
                )
            self._executor.spin_once(timeout_sec=_SPIN_S)

    def abandon(self, player: Player) -> None:
        """Tell the robot to rest at once."""
        self._send(player.start_ns, player.abandon())
        self._publisher.wait_for_all_acked(_duration(_ACKNOWLEDGE_S))

    def graph(self) -> list[Connection]:
        """The topics of this namespace with their ends."""
        return connections(self._node, self._node.get_namespace())

    def _send(self, start_ns: int | None, said: Iterable[Said]) -> None:
        for offset_ns, setpoint in said:
            message = self._twist_type()
            set_stamp(message.header, (start_ns or 0) + offset_ns)
            message.twist.linear.x = setpoint.linear_velocity
            message.twist.angular.z = setpoint.angular_velocity
            self._publisher.publish(message)

    def _hear(self, message: RosObject) -> None:
        pose, twist = message.pose.pose, message.twist.twist
        heading = math.remainder(2.0 * math.atan2(pose.orientation.z, pose.orientation.w), math.tau)
        self._heard.append(
            Odometry(
                stamp_ns(message.header), pose.position.x, pose.position.y, heading, twist.linear.x, twist.angular.z
            )
        )

    def _why_nobody(self, wait_s: float) -> str:
        namespace = self._node.get_namespace()
        topic = self._publisher.topic_name
        nodes = [f"{space.rstrip('/')}/{name}" for name, space in self._node.get_node_names_and_namespaces()]
        others = sorted(set(nodes) - {self._node.get_fully_qualified_name()})
        seen = f"nodes seen: {', '.join(others)}" if others else f"no node is seen at all ({discovery_text()})"
        return (
            f"nobody listens: no model node took {topic} and published odom within {wait_s:g} s in namespace "
            f"{namespace}; {seen}. Start one with: segway-ecc run ROBOT, or name its namespace with --namespace"
        )


def _duration(seconds: float) -> RosObject:
    return importlib.import_module("rclpy.duration").Duration(seconds=seconds)
