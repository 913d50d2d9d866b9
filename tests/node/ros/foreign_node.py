# SPDX-License-Identifier: MIT
"""A ROS node by somebody who knows this project only from its table of topics: rclpy and message packages, no more.

Reads one JSON object per line from standard input, answers each with one JSON value per line on standard output.
"""

import json
import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64, Header, String
from std_srvs.srv import Trigger

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # on PyPI there is none
    TFMessage = type(None)

OUT = {
    "position": Point,
    "linear_velocity": Float64,
    "angular_velocity": Float64,
    "odom": Odometry,
    "joint_states": JointState,
    "data": Imu,
    "diagnostics": DiagnosticArray,
    "mode": DiagnosticStatus,
    "setpoint": TwistStamped,
    "clock": Clock,
    "tf": TFMessage,
    "rosout": Log,
}
ROS_OWN = (
    "/rosout",
    "/parameter_events",
    "/get_type_description",
    "/describe_parameters",
    "/get_parameters",
    "/get_parameter_types",
    "/list_parameters",
    "/set_parameters",
    "/set_parameters_atomically",
)
KINDS = {"Float64": Float64, "Twist": Twist, "TwistStamped": TwistStamped, "String": String, "Header": Header}
PATIENCE_S = 150.0
LOOKS_EVERY_S = 0.01
NS_PER_S = 1_000_000_000


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)


def plain(message: Any) -> Any:  # noqa: C901, PLR0911 - one for each type
    """A message in plain values."""
    match message:
        case Point():
            return [message.x, message.y, message.z]
        case Float64():
            return message.data
        case Clock():
            return message.clock.sec * NS_PER_S + message.clock.nanosec
        case TFMessage():
            return [
                {
                    "stamp_ns": stamp_ns(each.header),
                    "frames": [each.header.frame_id, each.child_frame_id],
                    "x": each.transform.translation.x,
                    "y": each.transform.translation.y,
                    "z": each.transform.rotation.z,
                    "w": each.transform.rotation.w,
                }
                for each in message.transforms
            ]
        case Log():
            return {"level": message.level, "name": message.name, "text": message.msg}
        case Odometry():
            pose, twist = message.pose.pose, message.twist.twist
            return {
                "stamp_ns": stamp_ns(message.header),
                "frames": [message.header.frame_id, message.child_frame_id],
                "x": pose.position.x,
                "y": pose.position.y,
                "z": pose.orientation.z,
                "w": pose.orientation.w,
                "linear": twist.linear.x,
                "angular": twist.angular.z,
                "variances": [message.pose.covariance[place] for place in (0, 7, 35)],
            }
        case JointState():
            return {
                "stamp_ns": stamp_ns(message.header),
                "name": list(message.name),
                "position": list(message.position),
                "velocity": list(message.velocity),
                "effort": list(message.effort),
            }
        case Imu():
            rate, force = message.angular_velocity, message.linear_acceleration
            return {
                "stamp_ns": stamp_ns(message.header),
                "frame": message.header.frame_id,
                "angular_velocity": [rate.x, rate.y, rate.z],
                "linear_acceleration": [force.x, force.y, force.z],
                "orientation": [getattr(message.orientation, part) for part in "xyzw"],
                "orientation_covariance": list(message.orientation_covariance),
                "other_covariances": [*message.angular_velocity_covariance, *message.linear_acceleration_covariance],
            }
        case TwistStamped():
            return {
                "stamp_ns": stamp_ns(message.header),
                "linear": message.twist.linear.x,
                "angular": message.twist.angular.z,
            }
        case DiagnosticStatus():
            head = {"level": ord(message.level), "name": message.name, "hardware_id": message.hardware_id}
            return {**head, **{pair.key: pair.value for pair in message.values}}
        case DiagnosticArray():
            return {
                status.name: {
                    "level": ord(status.level),
                    "hardware_id": status.hardware_id,
                    **{pair.key: pair.value for pair in status.values},
                }
                for status in message.status
            }


class ForeignNode:
    def __init__(self) -> None:
        self.node = rclpy.create_node("foreign", start_parameter_services=False, enable_rosout=False)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.received: dict[str, list[Any]] = defaultdict(list)
        self.subscriptions: dict[str, Any] = {}
        self.publishers: dict[tuple[str, str], Any] = {}

    def look(self, namespace: str, expected: Any) -> Any:
        """Topics and services of the node called `model`, with type and QoS, once they are as expected or never."""
        self._wait_until(lambda: self._seen(namespace) == expected)
        return self._seen(namespace)

    def _seen(self, namespace: str) -> Any:
        node = self.node
        found: dict[str, Any] = {"in": {}, "out": {}}
        listed = {
            "in": (node.get_subscriber_names_and_types_by_node, node.get_subscriptions_info_by_topic),
            "out": (node.get_publisher_names_and_types_by_node, node.get_publishers_info_by_topic),
        }
        for direction, (names_and_types, infos) in listed.items():
            for topic, types in names_and_types("model", namespace):
                profiles = [
                    info.qos_profile
                    for info in infos(topic)
                    if info.node_name == "model" and info.node_namespace == namespace
                ]
                qos = [(profile.reliability.name, profile.durability.name) for profile in profiles]
                found[direction][topic] = [*types, *(name for names in qos for name in names)]
        found["services"] = dict(node.get_service_names_and_types_by_node("model", namespace))
        # What rclpy gives every node is no part of the table.
        return {
            part: {name: kind for name, kind in rows.items() if not name.endswith(ROS_OWN)}
            for part, rows in found.items()
        }

    def topics_of(self, node: str, namespace: str) -> Any:
        """The topics that a node publishes."""
        return [topic for topic, _ in self.node.get_publisher_names_and_types_by_node(node, namespace)]

    def wait_for(self, node: str, namespace: str) -> Any:
        """Wait until a node is seen."""
        return self._wait_until(lambda: (node, namespace) in self.node.get_node_names_and_namespaces())

    def wait_for_publishers(self, topic: str, count: int) -> Any:
        """Wait until a topic has that many publishers."""
        return self._wait_until(lambda: self.node.count_publishers(topic) == count)

    def listen(self, topic: str) -> Any:
        """Receive a topic from now on."""
        if topic not in self.subscriptions:
            kind = OUT.get(topic.rpartition("/")[2], Float64)
            self.subscriptions[topic] = self.node.create_subscription(
                kind, topic, lambda message: self.received[topic].append(plain(message)), 1000
            )
        return True

    def latched(self, topic: str) -> Any:
        """The text that was published on a topic before we subscribed to it."""
        found: list[Any] = []
        profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        subscription = self.node.create_subscription(String, topic, found.append, profile)
        deadline_s = time.monotonic() + PATIENCE_S
        while not found and time.monotonic() < deadline_s:
            self.executor.spin_once(timeout_sec=LOOKS_EVERY_S)
        self.node.destroy_subscription(subscription)
        return [each.data for each in found]

    def receive(self, topic: str) -> Any:
        """All that came on a topic since it was last asked for, waiting for one where there is none."""
        self.listen(topic)
        self._wait_until(lambda: self._take(topic))
        return self.received.pop(topic, [])

    def _take(self, topic: str) -> bool:
        """Take what is there, without the executor: for each message it looks at all topics, and takes one."""
        subscription = self.subscriptions[topic]
        with subscription.handle:
            while (taken := subscription.handle.take_message(subscription.msg_type, subscription.raw)) is not None:
                self.received[topic].append(plain(taken[0]))
        return bool(self.received[topic])

    def publish(self, topic: str, kind: str, linear: float, angular: float, stamp_ns: int = 0) -> Any:
        """Publish one set-point, when whoever takes it is there."""
        publisher = self._publisher(topic, kind)
        if not self._wait_until(lambda: publisher.get_subscription_count() > 0):
            return False
        message = KINDS[kind]()
        twist = message
        if kind == "TwistStamped":
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
            twist = message.twist
        twist.linear.x, twist.angular.z = linear, angular
        publisher.publish(message)
        return True

    def advertise(self, topic: str, kind: str, *, best_effort: bool) -> Any:
        """Offer a topic without publishing anything."""
        reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
        profile = QoSProfile(depth=10, reliability=reliability)
        self.publishers[topic, f"{kind} {best_effort}"] = self.node.create_publisher(KINDS[kind], topic, profile)
        return True

    def subscribe_transient_local(self, topic: str) -> Any:
        """Subscribe to a topic with a durability that only few publishers offer."""
        profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        kind = OUT[topic.rpartition("/")[2]]
        self.subscriptions[f"{topic} transient local"] = self.node.create_subscription(
            kind, topic, lambda _: None, profile
        )
        return True

    def publish_number(self, topic: str, value: float) -> Any:
        """Publish one number, when whoever takes it is there."""
        publisher = self._publisher(topic, "Float64")
        if not self._wait_until(lambda: publisher.get_subscription_count() > 0):
            return False
        publisher.publish(Float64(data=value))
        return True

    def beat(self, topic: str, station: str, stamp_ns: int) -> Any:
        """Publish one heartbeat of a base station, when whoever takes it is there."""
        publisher = self._publisher(topic, "Header")
        if not self._wait_until(lambda: publisher.get_subscription_count() > 0):
            return False
        message = Header(frame_id=station)
        message.stamp.sec, message.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        publisher.publish(message)
        return True

    def describe_parameter(self, node: str, name: str) -> Any:
        """A parameter's descriptor: its text, whether it is read only, its range and when it is taken."""
        answer = self._ask(DescribeParameters, f"{node}/describe_parameters", DescribeParameters.Request(names=[name]))
        found = answer.descriptors[0]
        bounds = [[each.from_value, each.to_value] for each in found.floating_point_range]
        return [found.description, found.read_only, bounds, found.additional_constraints]

    def get_parameter(self, node: str, name: str) -> Any:
        """A parameter's value."""
        return (
            self._ask(GetParameters, f"{node}/get_parameters", GetParameters.Request(names=[name]))
            .values[0]
            .double_value
        )

    def set_parameter(self, node: str, name: str, value: float) -> Any:
        """Set a parameter; whether that was done, and why not."""
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        answer = self._ask(SetParameters, f"{node}/set_parameters", SetParameters.Request(parameters=parameters))
        return [answer.results[0].successful, answer.results[0].reason]

    def dump_parameters(self, node: str, path: str) -> Any:
        """What `ros2 param dump` does: write all parameters of a node into a file, and return them."""
        client = self._parameters(node)
        names = list(self._result(client.list_parameters()).result.names)
        values = [parameter_value_to_python(value) for value in self._result(client.get_parameters(names)).values]
        found = dict(zip(names, values, strict=True))
        Path(path).write_text(yaml.safe_dump({node: {"ros__parameters": found}}), "utf-8")
        return found

    def load_parameters(self, node: str, path: str) -> Any:
        """What `ros2 param load` does: set all that a file has for a node; why not, of each that is refused."""
        results = self._result(self._parameters(node).load_parameter_file(path)).results
        return [result.reason for result in results if not result.successful]

    def _parameters(self, node: str) -> Any:
        client = AsyncParameterClient(self.node, node)
        client.wait_for_services(PATIENCE_S)
        return client

    def _result(self, future: Any) -> Any:
        self.executor.spin_until_future_complete(future, PATIENCE_S)
        return future.result()

    def _ask(self, kind: Any, service: str, request: Any, within_s: float = PATIENCE_S) -> Any:
        client = self.node.create_client(kind, service)
        client.wait_for_service(PATIENCE_S)
        future = client.call_async(request)
        self.executor.spin_until_future_complete(future, within_s)
        self.node.destroy_client(client)
        return future.result()

    def call(self, service: str, within_s: float = PATIENCE_S) -> Any:
        """Call a Trigger service; None where no answer comes within the time."""
        answer = self._ask(Trigger, service, Trigger.Request(), within_s)
        return answer and [answer.success, answer.message]

    def _publisher(self, topic: str, kind: str) -> Any:
        if (topic, kind) not in self.publishers:
            self.publishers[topic, kind] = self.node.create_publisher(KINDS[kind], topic, 100)
        return self.publishers[topic, kind]

    def _wait_until(self, done: Any) -> bool:
        """Wait for what ROS learns by itself, as messages and who is there."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not done():
            if time.monotonic() > deadline_s:
                return False
            time.sleep(LOOKS_EVERY_S)
        return True


def main() -> None:
    rclpy.init()
    foreign = ForeignNode()
    for line in sys.stdin:
        question = json.loads(line)
        answer = getattr(foreign, question.pop("do"))(**question)
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
