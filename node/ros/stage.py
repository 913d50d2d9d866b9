"""The ROS stage of the model node: takes from its own handles and publishes; no executor runs in the loop."""

import logging
from collections.abc import Callable, Sequence
from typing import Final

from node.config import RosSection
from node.cycle.seams import Inbox, Report, Request, StampedSetpoint
from node.cycle.setpoints import Setpoint
from node.diagnostics.status import Status
from node.ros.graph import mismatch
from node.ros.messages import diagnostic_array, message_type, stamp_ns
from node.ros.publishers import make_publishers
from node.ros.untyped import RosObject
from node.safety.modes import Action, Answer

_TAKEN_PER_CYCLE: Final = 100
"""Messages taken from one topic in one cycle at most, so that a flood cannot hold up the loop."""
_COMMAND_DEPTH: Final = 10
_AHEAD_DEPTH: Final = 500
"""Set-points stamped ahead come in bunches, and each of them counts."""
_LOOK_EVERY: Final = 25
_logger = logging.getLogger(__name__)


class RosStage:
    """See `node.cycle.seams.Stage`."""

    def __init__(self, node: RosObject, ros: RosSection, signals: Sequence[str]) -> None:
        """Offer the robot's topics and services on `node`; `signals` names the values of each report."""
        self._node = node
        self._publishers = make_publishers(node, ros, signals)
        self._subscriptions = [
            self._subscribe("cmd_vel", "geometry_msgs/msg/Twist", _COMMAND_DEPTH, _from_twist),
            self._subscribe("cmd_vel_stamped", "geometry_msgs/msg/TwistStamped", _AHEAD_DEPTH, _from_twist_stamped),
        ]
        trigger = message_type("std_srvs/srv/Trigger")
        self._request_type, self._response_type = trigger.Request, trigger.Response
        self._services = [(action, node.create_service(trigger, f"~/{action}", _never_called)) for action in Action]
        kind = message_type("diagnostic_msgs/msg/DiagnosticArray")
        self._diagnostics = node.create_publisher(kind, "diagnostics", _COMMAND_DEPTH)
        self._looks = 0
        self._told: set[str] = set()

    @property
    def over(self) -> str | None:
        """Whether the ROS context has shut down."""
        return None if self._node.context.ok() else "ROS has shut down"

    def take(self) -> Inbox:
        """Everything that has arrived; see `Stage.take`."""
        inbox = Inbox()
        for subscription, convert in self._subscriptions:
            handle, kind = subscription.handle, subscription.msg_type
            for _ in range(_TAKEN_PER_CYCLE):
                taken = handle.take_message(kind, False)  # noqa: FBT003 - rclpy's signature: not raw
                if taken is None:
                    break
                inbox.setpoints.append(convert(taken[0]))
        for action, service in self._services:
            request, header = service.handle.service_take_request(self._request_type)
            if request is not None:
                inbox.requests.append(Request(action, self._answer(service, header)))
        return inbox

    def publish(self, report: Report) -> None:
        """Publish every topic of the cycle."""
        for publish in self._publishers:
            publish(report.stamp_ns, report.values)

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[Status]) -> None:
        """Publish a diagnostic_msgs/DiagnosticArray."""
        self._diagnostics.publish(diagnostic_array(statuses, stamp_ns))

    def look_around(self) -> None:
        """Now and then look at one topic for publishers that never reach us, and say each once."""
        self._looks += 1
        turn, rest = divmod(self._looks, _LOOK_EVERY)
        if rest:
            return
        subscription, _ = self._subscriptions[turn % len(self._subscriptions)]
        for peer in self._node.get_publishers_info_by_topic(subscription.topic_name):
            text = mismatch(subscription.topic_name, _type_name(subscription.msg_type), peer)
            if text is not None and text not in self._told:
                self._told.add(text)
                _logger.warning(text)

    def close(self) -> None:
        """Nothing to do: who made the node destroys it."""

    def _subscribe(
        self, topic: str, type_name: str, depth: int, convert: Callable[[RosObject], StampedSetpoint]
    ) -> tuple[RosObject, Callable[[RosObject], StampedSetpoint]]:
        return self._node.create_subscription(message_type(type_name), topic, _never_called, depth), convert

    def _answer(self, service: RosObject, header: RosObject) -> Callable[[Answer], None]:
        def send(answer: Answer) -> None:
            response = self._response_type(success=answer.accepted, message=answer.message)
            service.handle.service_send_response(response, header)

        return send


def _never_called(*_: RosObject) -> None:
    """Stand in for the callbacks that only an executor would call."""


def _type_name(kind: RosObject) -> str:
    package = kind.__module__.split(".", maxsplit=1)[0]
    return f"{package}/msg/{kind.__name__}"


def _from_twist(message: RosObject) -> StampedSetpoint:
    return StampedSetpoint(Setpoint(message.linear.x, message.angular.z), None)


def _from_twist_stamped(message: RosObject) -> StampedSetpoint:
    setpoint = Setpoint(message.twist.linear.x, message.twist.angular.z)
    return StampedSetpoint(setpoint, stamp_ns(message.header))
