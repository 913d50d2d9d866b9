# SPDX-License-Identifier: MIT
"""All robots over ROS: discovers them, receives their messages, and sends them heartbeats, set-points and requests.

Topics and services are taken straight from their handles; no executor runs. Measured on rclpy 7.1: an idle take costs
3 us, one that makes an Odometry 200 us. So of what arrives at the loop's rate DDS keeps only the newest, which is taken
at the pace of the picture.
"""

import contextlib
import itertools
import logging
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import MOST_ROBOTS, EventLog, Heartbeats
from segway_ecc.deploy.station.requests import ServiceResponse
from segway_ecc.deploy.station.robot_messages import (
    ModeReport,
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
from segway_ecc.node.errors import exception_text, shortened
from segway_ecc.node.ros.messages import (
    TWIST_STAMPED_TYPE,
    TWIST_TYPE,
    RosObject,
    decode_message,
    duration,
    message_type,
    stamp_ns,
)
from segway_ecc.node.ros.protocol import WATCH_TOPIC, WATCH_TYPE
from segway_ecc.node.ros.runtime import UNKNOWN_NODE, ros_node
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
_LOOKS_WITHOUT_STOP: Final = 20
"""DDS may discover the services of a robot that starts later than its topics; so many looks are 10 s."""
_MOST_REPORTED: Final = 4
"""Of the nodes that publish `mode` in a namespace, and are not followed."""
_NEWEST: Final = 1
_ALL: Final = 10
"""Modes must not be missed; a robot that keeps to its rate publishes no more between two polls."""
_SENT_DEPTH: Final = 10
_NOT_COUNTED: Final = 2**64 - 1
"""The number of a message where a middleware does not count them (rmw.h)."""
_LARGEST_BYTES: Final = 65_536
"""Of any message of a robot; its diagnostics are the largest, some 10 KiB. rclpy decodes so many within 4 ms."""
_NODE_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
_LONGEST_NAME: Final = 247
"""Of a topic or a service, in characters (rmw/validate_full_topic_name.h)."""
_logger: Final = logging.getLogger(__name__)


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
        self._always = [
            (self._subscribe(MODE_TYPE, MODE_TOPIC, _ALL), _decoder(MODE_TYPE, _read_mode)),
            (self._subscribe(STATUS_TYPE, STATUS_TOPIC, _ALL), _decoder(STATUS_TYPE, read_status)),
        ]
        readers: Mapping[tuple[str, str], Callable[[RosObject], RobotMessage | None]] = {
            ("geometry_msgs/msg/TwistStamped", "setpoint"): lambda message: SetpointReport(
                stamp_ns(message.header), message.twist.linear.x, message.twist.angular.z
            ),
            ("std_msgs/msg/Float64", "pitch"): lambda message: Pitch(message.data),
            ("sensor_msgs/msg/BatteryState", "battery_state"): lambda message: Supply(message.voltage),
            ("diagnostic_msgs/msg/DiagnosticArray", "diagnostics"): lambda message: decode_health(
                (status.name, _values(status))
                for status in message.status
                if "/" not in status.name  # else of a robot in another namespace, on /diagnostics
            ),
        }
        self._others = [
            (self._subscribe("nav_msgs/msg/Odometry", "odom", _NEWEST), read_odometry),
            *((self._subscribe(*of, _NEWEST), _decoder(of[0], read)) for of, read in readers.items()),
        ]
        self._drive = self._publisher(self._type_of_drive(), "cmd_vel", _SENT_DEPTH)
        self._follow = self._publisher(TRAJECTORY_TYPE, TRAJECTORY_TOPIC, _SENT_DEPTH)
        self._beat = self._publisher("std_msgs/msg/Header", "station", _NEWEST)
        self._watch = self._publisher(WATCH_TYPE, WATCH_TOPIC, _SENT_DEPTH)
        self._trigger = message_type("std_srvs/srv/Trigger")
        self._request, self._response = self._trigger.Request(), self._trigger.Response
        self._clients: dict[Action, RosObject] = {}
        self._mode_number = 0
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
        for subscription, decode in self._always:
            yield from self._taken(subscription, decode, _ALL)
        if not everything:
            return
        for subscription, decode in self._others:
            yield from self._taken(subscription, decode, _NEWEST)

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
                text = shortened(response.message)
                yield ServiceResponse(action, header.request_id.sequence_number, response.success, text)

    def drive(self, setpoint: Setpoint) -> None:
        """See `RobotConnection.drive`."""
        if not self._drive.get_subscription_count():
            self._match_drive()
        message = self._drive.msg_type()
        twist = message.twist if hasattr(message, "twist") else message  # a stamp of zero means now
        twist.linear.x, twist.angular.z = setpoint
        self._drive.publish(message)

    def _match_drive(self) -> None:
        """Publish the type that the robot takes, which need not have been known when it was found."""
        wanted = self._type_of_drive()
        if self._drive.msg_type is not message_type(wanted):
            self._node.destroy_publisher(self._drive)
            self._drive = self._publisher(wanted, "cmd_vel", _SENT_DEPTH)

    def _type_of_drive(self) -> str:
        """What the robot takes on `cmd_vel`, by its setting `ros.cmd_vel`."""
        takers = self._node.get_subscriptions_info_by_topic(topic(self._robot, "cmd_vel"))
        is_stamped = any(taker.topic_type == TWIST_STAMPED_TYPE for taker in takers)
        return TWIST_STAMPED_TYPE if is_stamped else TWIST_TYPE

    def follow(self, trajectory: Trajectory) -> None:
        """See `RobotConnection.follow`."""
        self._follow.publish(trajectory_message(trajectory))

    def flush(self, within_ns: int) -> None:
        """Wait until the robot has acknowledged what moves it, ns at most for each topic."""
        for publisher in (self._drive, self._follow):
            publisher.wait_for_all_acked(duration(within_ns * 1e-9))

    def introduce(self, station: str) -> None:
        """See `RobotConnection.introduce`."""
        self._watch.publish(self._watch.msg_type(data=station))

    def _taken(
        self, subscription: RosObject, decode: Callable[[bytes], RobotMessage | None], at_most: int
    ) -> Iterator[tuple[RobotMessage, int]]:
        """Take messages as bytes, so that one that is too large is refused before rclpy makes objects of it."""
        for _ in range(at_most):
            taken = subscription.handle.take_message(subscription.msg_type, True)  # noqa: FBT003 - rclpy's form: raw
            if taken is None:
                return
            data, message = taken[0], None
            if len(data) <= _LARGEST_BYTES:
                with contextlib.suppress(RuntimeError, ValueError):
                    message = decode(data)
            if isinstance(message, ModeReport):
                message = self._in_turn(message, taken[1])
            if message is None:
                self.refused += 1
            else:
                yield message, taken[1]["received_timestamp"] or time.time_ns()

    def _in_turn(self, mode: ModeReport, info: Mapping[str, int]) -> ModeReport:
        """Each publisher counts its messages: where two publish, the count goes back all the time."""
        number, before = info.get("publication_sequence_number") or 0, self._mode_number
        if not 0 < number < _NOT_COUNTED:
            return mode
        self._mode_number = number
        return mode._replace(is_out_of_turn=number <= before)

    def _subscribe(self, type_name: str, name: str, depth: int) -> RosObject:
        # No callback is ever called: that would take an executor.
        return self._node.create_subscription(message_type(type_name), topic(self._robot, name), lambda *_: None, depth)

    def _publisher(self, type_name: str, name: str, depth: int) -> RosObject:
        return self._node.create_publisher(message_type(type_name), topic(self._robot, name), depth)


def _decoder(
    type_name: str, read: Callable[[RosObject], RobotMessage | None]
) -> Callable[[bytes], RobotMessage | None]:
    """What reads a message of a type from its bytes."""
    kind = message_type(type_name)
    return lambda data: read(decode_message(data, kind))


def _read_mode(message: RosObject) -> RobotMessage | None:
    return decode_mode(message.name, _values(message))


class RosBridge:
    """Has the connection to each robot, by namespace; see `deploy.station.network.RobotNetwork`."""

    def __init__(self, node: RosObject, handler: CommandHandler, beats: Heartbeats | None, events: EventLog) -> None:
        """Pass what `node` receives to `handler`; send `beats`, or none where it only watches."""
        self.connections: dict[str, RosRobotConnection] = {}
        self._handler = handler
        self._beats = beats
        self._events = events
        self._node = node
        self._polled_ns = time.monotonic_ns()
        self._discovered_ns = -_DISCOVER_EVERY_NS
        self._turns = itertools.count()
        self._others: dict[str, tuple[int, list[str]]] = {}
        self._failing: set[str] = set()
        self._is_full = False

    @property
    def is_waiting(self) -> bool:
        """Whether a report or a response of some robot is awaited."""
        return any(map(self._handler.is_waiting_for, self.connections))

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
        """Follow robots that come and go in the graph; of those that are alive, one is checked each time.

        Those that a report or a response is awaited of are checked too: the request may have gone to a node that left.
        """
        if now_ns - self._discovered_ns < _DISCOVER_EVERY_NS:
            return
        self._discovered_ns = now_ns
        names = robots_in(self._node.get_topic_names_and_types())
        self._others = {name: self._others.get(name, (0, [])) for name in names}
        self._failing.intersection_update(names)
        turn = names[next(self._turns) % len(names)] if names else ""
        for name in names:
            robot = self._handler.fleet.robots.get(name)
            if robot is None or not robot.is_alive or name == turn or self._handler.is_waiting_for(name):
                self._look_at(name)

    def refused(self) -> Mapping[str, int]:
        """How many messages of robots were not valid."""
        count = sum(connection.refused for connection in self.connections.values())
        return {"message: malformed": count} if count else {}

    def _look_at(self, name: str) -> None:
        """Follow whoever is to be followed in a namespace; where ROS fails at it, report that once."""
        try:
            self._follow(name)
        except Exception as error:  # whatever it is, the other namespaces are looked at
            if name not in self._failing:
                self._failing.add(name)
                text = f"it is not known who is to be followed in this namespace: {exception_text(error)}"
                self._events.add(name, text, level="error")
                _logger.exception("a namespace could not be looked at, and the station goes on")

    def _follow(self, name: str) -> None:
        """Follow a node that publishes `mode` and offers `~/stop`; one that is followed stays while it does both."""
        infos = self._node.get_publishers_info_by_topic(topic(name, MODE_TOPIC))
        publishers = sorted(info.node_name for info in infos if info.node_name not in {UNKNOWN_NODE, ""})
        serving = [node for node in publishers if self._offers_stop(name, node)]
        connection = self.connections.get(name)
        if connection is not None:
            if serving and connection.model_node not in serving:
                text = f"{connection.model_node} no longer publishes mode and offers ~/{Action.STOP}"
                self._events.add(name, f"{text}: {serving[0]} is followed", level="warning")
                connection.serve_by(serving[0])
        elif serving and len(self.connections) < MOST_ROBOTS:
            self.connections[name] = connection = RosRobotConnection(self._node, name, serving[0])
            self._handler.add(name, connection)
        elif serving and not self._is_full:
            self._is_full = True
            self._events.add("", f"more than {MOST_ROBOTS} robots: {name} is not followed", level="error")
        self._report_others(name, publishers, serving)

    def _offers_stop(self, name: str, node: str) -> bool:
        """Whether it does; one whose name leaves no room for all that a robot has is no robot."""
        names = [topic(name, STATUS_TOPIC), *(topic(name, f"{node}/{action}") for action in Action)]
        if not _NODE_NAME.fullmatch(node) or max(map(len, names)) > _LONGEST_NAME:
            return False
        return bool(self._node.count_services(topic(name, f"{node}/{Action.STOP}")))

    def _report_others(self, name: str, publishers: Sequence[str], serving: Sequence[str]) -> None:
        """Report once who else publishes `mode` in a namespace, and again where that has changed."""
        looks, reported = self._others[name]
        looks = 0 if serving else looks + 1
        texts = []
        if len(serving) > 1:
            followed = self.connections[name].model_node if name in self.connections else "none"
            advice = f"give each its own with --namespace; {followed} is followed"
            texts.append(f"{len(serving)} robots share this namespace: {advice}")
        if serving or looks > _LOOKS_WITHOUT_STOP:
            texts += [
                f"{node} publishes mode in this namespace and offers no ~/{Action.STOP}: it is not followed; end it"
                for node in sorted(set(publishers) - set(serving))[:_MOST_REPORTED]
            ]
        for text in texts:
            if text not in reported:
                self._events.add(name, text, level="error")
        self._others[name] = looks, texts


@contextlib.contextmanager
def ros_network(
    ros_arguments: Sequence[str], handler: CommandHandler, beats: Heartbeats | None, events: EventLog
) -> Iterator[RosBridge]:
    """The robots over ROS; see `deploy.station.network.Connect`.

    Raises:
        RosUnavailableError: ROS is not there or does not start.
    """
    with ros_node("base_station", "", ros_arguments) as node:
        yield RosBridge(node, handler, beats, events)


def _values(message: RosObject) -> Mapping[str, str]:
    return {pair.key: pair.value for pair in message.values}
