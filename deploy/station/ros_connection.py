# SPDX-License-Identifier: MIT
"""The ROS side of one robot: its topics and services, taken straight from their handles; no executor runs.

Measured on rclpy 7.1: an idle take costs 3 us, one that makes an Odometry 200 us. So of what arrives at the loop's
rate DDS keeps only the newest, which is taken at the pace of the picture.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple

from segway_ecc.deploy.station.connection import ServiceResponse
from segway_ecc.deploy.station.discovery import MODE_TOPIC, MODE_TYPE, topic
from segway_ecc.deploy.station.odometry import read_odometry
from segway_ecc.deploy.station.robot_messages import (
    Pitch,
    RobotMessage,
    SetpointReport,
    Supply,
    decode_health,
    decode_mode,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.ros.messages import duration, message_type, set_stamp, stamp_ns
from segway_ecc.node.ros.untyped import RosObject
from segway_ecc.node.safety.modes import Action

_NEWEST: Final = 1
_ALL: Final = 10
"""Modes must not be missed; a robot that keeps to its rate publishes no more between two polls."""
_SENT_DEPTH: Final = 10
_AHEAD_DEPTH: Final = 500


class ReceivedMessage(NamedTuple):
    """A message and when it reached this machine, ns since the Unix epoch."""

    message: RobotMessage
    wall_ns: int


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
        self._drive_stamped = self._publisher("geometry_msgs/msg/TwistStamped", "cmd_vel_stamped", _AHEAD_DEPTH)
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

    def take_modes(self) -> Iterator[ReceivedMessage]:
        """Every message on the topic `mode` that has arrived."""
        for _ in range(_ALL):
            taken = self._mode.handle.take_message(self._mode.msg_type, False)  # noqa: FBT003 - rclpy's form: not raw
            if taken is None:
                return
            yield from self._received(decode_mode(taken[0].name, _values(taken[0])), taken)

    def take_others(self) -> Iterator[ReceivedMessage]:
        """The newest of everything else that has arrived."""
        taken = self._odometry.handle.take_message(self._odometry.msg_type, True)  # noqa: FBT003 - rclpy's form: raw
        if taken is not None:
            yield from self._received(read_odometry(taken[0]), taken)
        for subscription, decode in self._others:
            taken = subscription.handle.take_message(subscription.msg_type, False)  # noqa: FBT003 - rclpy's form
            if taken is not None:
                yield from self._received(decode(taken[0]), taken)

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

    def drive(self, setpoint: Setpoint, stamp_ns: int | None = None) -> None:
        """See `RobotConnection.drive`."""
        publisher = self._drive if stamp_ns is None else self._drive_stamped
        message = publisher.msg_type()
        twist = message if stamp_ns is None else message.twist
        if stamp_ns is not None:
            set_stamp(message.header, stamp_ns)
        twist.linear.x, twist.angular.z = setpoint
        publisher.publish(message)

    def flush(self, within_ns: int) -> None:
        """Wait until the robot has acknowledged the set-points that were sent, ns at most for each topic."""
        for publisher in (self._drive, self._drive_stamped):
            publisher.wait_for_all_acked(duration(within_ns * 1e-9))

    def stand(self, *, up: bool) -> None:
        """See `RobotConnection.stand`."""
        self._stand.publish(self._stand.msg_type(data=1.0 if up else 0.0))

    def _received(self, message: RobotMessage | None, taken: RosObject) -> Iterator[ReceivedMessage]:
        if message is None:
            self.refused += 1
        else:
            yield ReceivedMessage(message, taken[1]["received_timestamp"] or time.time_ns())

    def _subscribe(self, type_name: str, name: str, depth: int) -> RosObject:
        # No callback is ever called: that would take an executor.
        return self._node.create_subscription(message_type(type_name), topic(self._robot, name), lambda *_: None, depth)

    def _publisher(self, type_name: str, name: str, depth: int) -> RosObject:
        return self._node.create_publisher(message_type(type_name), topic(self._robot, name), depth)


def _values(message: RosObject) -> Mapping[str, str]:
    return {pair.key: pair.value for pair in message.values}
