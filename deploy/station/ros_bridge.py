# SPDX-License-Identifier: MIT
"""All robots over ROS: discovers them, receives their messages, and sends them heartbeats, set-points and requests.

Topics and services are taken straight from their handles; no executor runs. Measured on rclpy 7.1: an idle take costs
3 us, one that makes an Odometry 200 us. So of what arrives at the loop's rate DDS keeps only the newest, which is taken
at the pace of the picture.
"""

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import MOST_ROBOTS, EventLog, Heartbeats
from segway_ecc.deploy.station.requests import ServiceResponse
from segway_ecc.deploy.station.robot_messages import (
    Pitch,
    RobotMessage,
    SetpointReport,
    Supply,
    decode_health,
    decode_mode,
    read_odometry,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import Trajectory
from segway_ecc.node.ros.messages import RosObject, duration, message_type, stamp_ns
from segway_ecc.node.ros.trajectories import (
    STATUS_TOPIC,
    STATUS_TYPE,
    TRAJECTORY_TOPIC,
    TRAJECTORY_TYPE,
    read_status,
    trajectory_message,
)
from segway_ecc.node.safety.modes import Action

MODE_TOPIC: Final = "mode"
MODE_TYPE: Final = "diagnostic_msgs/msg/DiagnosticStatus"
_DISCOVER_EVERY_NS: Final = 500_000_000
_FLUSH_NS: Final = 500_000_000
_UNKNOWN: Final = "_NODE_NAME_UNKNOWN_"
"""The graph's name of a node of which only a topic was discovered yet."""
_NEWEST: Final = 1
_ALL: Final = 10
"""Modes must not be missed; a robot that keeps to its rate publishes no more between two polls."""
_SENT_DEPTH: Final = 10


def robots_in(topics: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """The namespaces of the robots among topics with their types, sorted: `/` or `/alice`."""
    ending = f"/{MODE_TOPIC}"
    return sorted(
        name.removesuffix(ending) or "/" for name, types in topics if name.endswith(ending) and MODE_TYPE in types
    )


def topic(robot: str, name: str) -> str:
    """The full name of a robot's topic."""
    return f"{robot.rstrip('/')}/{name}"


class RosRobotConnection:
    """A `RobotConnection` that receives the robot's topics, too.

    Attributes:
        model_node: The name of the robot's node, whose services are called.
        refused: How many of its messages were not valid.
    """

    def __init__(self, node: RosObject, robot: str, model_node: str) -> None:
        """Connect to the robot in namespace `robot`."""
        self.model_node = model_node
        self.refused = 0
        self._node = node
        self._robot = robot
        self._mode = self._subscribe(MODE_TYPE, MODE_TOPIC, _ALL)
        self._trajectory = self._subscribe(STATUS_TYPE, STATUS_TOPIC, _ALL)
        self._odometry = self._subscribe("nav_msgs/msg/Odometry", "odom", _NEWEST)
        decoders: Mapping[tuple[str, str], Callable[[RosObject], RobotMessage]] = {
            ("geometry_msgs/msg/TwistStamped", "setpoint"): lambda message: SetpointReport(
                stamp_ns(message.header), message.twist.linear.x, message.twist.angular.z
            ),
            ("std_msgs/msg/Float64", "pitch"): lambda message: Pitch(message.data),
            ("sensor_msgs/msg/BatteryState", "battery_state"): lambda message: Supply(message.voltage),
            ("diagnostic_msgs/msg/DiagnosticArray", "diagnostics"): lambda message: decode_health(
                (status.name, _values(status)) for status in message.status
            ),
        }
        self._others = [(self._subscribe(*of, _NEWEST), decode) for of, decode in decoders.items()]
        self._drive = self._publisher("geometry_msgs/msg/Twist", "cmd_vel", _SENT_DEPTH)
        self._follow = self._publisher(TRAJECTORY_TYPE, TRAJECTORY_TOPIC, _SENT_DEPTH)
        self._stand = self._publisher("std_msgs/msg/Float64", "set/stand", _SENT_DEPTH)
        self._beat = self._publisher("std_msgs/msg/Header", "station", _NEWEST)
        self._trigger = message_type("std_srvs/srv/Trigger")
        self._request, self._response = self._trigger.Request(), self._trigger.Response
        self._clients: dict[Action, RosObject] = {}
        self.serve_by(model_node)

    def serve_by(self, model_node: str) -> None:
        """Call the services of this node from now on; pending requests to an earlier one are not answered any more."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        self.model_node = model_node
        self._clients = {
            action: self._node.create_client(self._trigger, topic(self._robot, f"{model_node}/{action}"))
            for action in Action
        }

    def received(self, *, everything: bool) -> Iterator[tuple[RobotMessage, int]]:
        """What arrived on `mode` and `trajectory_status`, the newest of `everything` else, and when (Unix, ns)."""
        decoders: tuple[tuple[RosObject, Callable[[RosObject], RobotMessage | None]], ...] = (
            (self._mode, lambda message: decode_mode(message.name, _values(message))),
            (self._trajectory, read_status),
        )
        for subscription, decode in decoders:
            for _ in range(_ALL):
                taken = subscription.handle.take_message(subscription.msg_type, False)  # noqa: FBT003 - rclpy's form
                if taken is None:
                    break
                yield from self._valid(decode(taken[0]), taken)
        if not everything:
            return
        taken = self._odometry.handle.take_message(self._odometry.msg_type, True)  # noqa: FBT003 - rclpy's form: raw
        if taken is not None:
            yield from self._valid(read_odometry(taken[0]), taken)
        for subscription, decode in self._others:
            taken = subscription.handle.take_message(subscription.msg_type, False)  # noqa: FBT003 - rclpy's form
            if taken is not None:
                yield from self._valid(decode(taken[0]), taken)

    def beat(self, station: str, stamp_ns: int) -> None:
        """Send a heartbeat."""
        message = self._beat.msg_type()
        message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        message.frame_id = station
        self._beat.publish(message)

    def is_ready(self, action: Action) -> bool:
        """See `RobotConnection.is_ready`."""
        return bool(self._clients[action].service_is_ready())

    def call(self, action: Action) -> int:
        """See `RobotConnection.call`."""
        return int(self._clients[action].handle.send_request(self._request))

    def responses(self) -> Iterable[ServiceResponse]:
        """See `RobotConnection.responses`."""
        for action, client in self._clients.items():
            for _ in range(_ALL):
                header, response = client.handle.take_response(self._response)
                if header is None:
                    break
                yield ServiceResponse(action, header.request_id.sequence_number, response.success, response.message)

    def drive(self, setpoint: Setpoint) -> None:
        """See `RobotConnection.drive`."""
        message = self._drive.msg_type()
        message.linear.x, message.angular.z = setpoint
        self._drive.publish(message)

    def follow(self, trajectory: Trajectory) -> None:
        """See `RobotConnection.follow`."""
        self._follow.publish(trajectory_message(trajectory))

    def flush(self, within_ns: int) -> None:
        """Wait until the robot has acknowledged what moves it, ns at most for each topic."""
        for publisher in (self._drive, self._follow):
            publisher.wait_for_all_acked(duration(within_ns * 1e-9))

    def stand(self, *, up: bool) -> None:
        """See `RobotConnection.stand`."""
        self._stand.publish(self._stand.msg_type(data=1.0 if up else 0.0))

    def _valid(self, message: RobotMessage | None, taken: RosObject) -> Iterator[tuple[RobotMessage, int]]:
        if message is None:
            self.refused += 1
        else:
            yield message, taken[1]["received_timestamp"] or time.time_ns()

    def _subscribe(self, type_name: str, name: str, depth: int) -> RosObject:
        # No callback is ever called: that would take an executor.
        return self._node.create_subscription(message_type(type_name), topic(self._robot, name), lambda *_: None, depth)

    def _publisher(self, type_name: str, name: str, depth: int) -> RosObject:
        return self._node.create_publisher(message_type(type_name), topic(self._robot, name), depth)


class RosBridge:
    """Belongs to the ROS thread; has the connection to each robot, by namespace."""

    def __init__(self, handler: CommandHandler, beats: Heartbeats | None, events: EventLog) -> None:
        """Pass what is received to `handler`; send `beats`, or none where it only watches."""
        self.connections: dict[str, RosRobotConnection] = {}
        self._handler = handler
        self._beats = beats
        self._events = events
        self._node: RosObject = None
        self._polled_ns = time.monotonic_ns()
        self._discovered_ns = -_DISCOVER_EVERY_NS
        self._turns = itertools.count()
        self._shared: set[str] = set()
        self._is_full = False

    @property
    def is_waiting(self) -> bool:
        """Whether a report or a response of some robot is awaited."""
        return any(map(self._handler.is_waiting_for, self.connections))

    def use(self, node: RosObject) -> None:
        """Use `node` from now on."""
        self._node = node

    def poll(self, *, everything: bool) -> None:
        """Pass on everything that has arrived; or only responses and modes of the robots that are waited for."""
        now_ns, wall_ns = time.monotonic_ns(), time.time_ns()
        since_ns = now_ns - self._polled_ns
        for name, connection in self.connections.items():
            if not (everything or self._handler.is_waiting_for(name)):
                continue
            self._handler.receive_responses(name)
            for message, received_ns in connection.received(everything=everything):
                # It arrived after the last poll, whatever the wall clock did.
                at_ns = now_ns - min(max(wall_ns - received_ns, 0), since_ns)
                self._handler.on_message(name, message, at_ns)
        if everything:
            self._polled_ns = now_ns

    def flush(self) -> None:
        """Wait until what was sent has arrived, before the node that sent it ends; for half a second at most."""
        deadline_ns = time.monotonic_ns() + _FLUSH_NS
        for connection in self.connections.values():
            connection.flush(max(deadline_ns - time.monotonic_ns(), 0))

    def beat(self, now_ns: int) -> None:
        """Send a heartbeat to every robot, where one is due."""
        stamp_ns = None if self._beats is None else self._beats.due(now_ns)
        if self._beats is not None and stamp_ns is not None:
            for connection in self.connections.values():
                connection.beat(self._beats.name, stamp_ns)

    def discover(self, now_ns: int) -> None:
        """Follow robots that come and go in the graph; of those that are alive, one is checked each time."""
        if now_ns - self._discovered_ns < _DISCOVER_EVERY_NS:
            return
        self._discovered_ns = now_ns
        names = robots_in(self._node.get_topic_names_and_types())
        turn = names[next(self._turns) % len(names)] if names else ""
        for name in names:
            robot = self._handler.fleet.robots.get(name)
            if robot is None or not robot.is_alive or name == turn:
                self._follow(name)

    def refused(self) -> Mapping[str, int]:
        """How many messages of robots were not valid."""
        count = sum(connection.refused for connection in self.connections.values())
        return {"message: malformed": count} if count else {}

    def _follow(self, name: str) -> None:
        peers = self._node.get_publishers_info_by_topic(topic(name, MODE_TOPIC))
        nodes = sorted({peer.node_name for peer in peers} - {_UNKNOWN, ""})
        if not nodes:
            return
        if len(peers) == 1:
            self._shared.discard(name)
        elif name not in self._shared:
            self._shared.add(name)
            text = f"{len(peers)} robots share this namespace: give each its own with --namespace"
            self._events.add(name, text, level="error")
        connection = self.connections.get(name)
        if connection is not None:
            if connection.model_node not in nodes:
                connection.serve_by(nodes[0])
        elif len(self.connections) < MOST_ROBOTS:
            self.connections[name] = connection = RosRobotConnection(self._node, name, nodes[0])
            self._handler.add(name, connection)
        elif not self._is_full:
            self._is_full = True
            self._events.add("", f"more than {MOST_ROBOTS} robots: {name} is not followed", level="error")


def _values(message: RosObject) -> Mapping[str, str]:
    return {pair.key: pair.value for pair in message.values}
