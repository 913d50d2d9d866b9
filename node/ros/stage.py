"""The ROS stage of the model node: takes from its own handles and publishes; no executor runs in the loop."""

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from node.config import RosSection
from node.cycle.seams import Heartbeat, Inbox, Report, Request, SetValue, StampedSetpoint
from node.cycle.setpoints import Setpoint
from node.cycle.status import Status
from node.cycle.wiring import Wiring
from node.model.model import Model
from node.ros.graph import mismatch
from node.ros.messages import diagnostic_array, message_type, newest_only, set_stamp, stamp_ns
from node.ros.mode import make_mode_publisher
from node.ros.parameters import ModelParameters
from node.ros.publishers import make_publishers, make_scalar_publishers
from node.ros.untyped import RosObject
from node.safety.modes import Action, Answer

_TAKEN_PER_CYCLE: Final = 100
"""Messages taken from one topic in one cycle at most, so that a flood cannot hold up the loop."""
_COMMAND_DEPTH: Final = 10
_AHEAD_DEPTH: Final = 500
"""Set-points stamped ahead come in bunches, and each of them counts."""
_LONGEST_NAME: Final = 80
"""Of a base station, in characters: it is echoed ten times a second."""
_STAND: Final = "stand"
"""The value that makes a robot stand up, or sit down."""
_LOOK_EVERY: Final = 25
_TOLD_AT_MOST: Final = 100
_logger = logging.getLogger(__name__)


class RosStage:
    """See `node.cycle.seams.Stage`."""

    def __init__(self, node: RosObject, ros: RosSection, wiring: Wiring, model: Model, robot_name: str) -> None:
        """Offer the robot's topics, services and parameters on `node`; `robot_name` is what its file calls it."""
        self._node = node
        stand = wiring.set_names.index(_STAND) if _STAND in wiring.set_names else None
        self._publish_mode = make_mode_publisher(node, robot_name, stand=stand)
        self._publishers = make_publishers(node, ros, list(wiring.published))
        self._topics = make_scalar_publishers(node, list(wiring.topics))
        self._subscriptions = [
            self._subscribe("cmd_vel", "geometry_msgs/msg/Twist", _COMMAND_DEPTH, _from_twist),
            self._subscribe("cmd_vel_stamped", "geometry_msgs/msg/TwistStamped", _AHEAD_DEPTH, _from_twist_stamped),
        ]
        trigger = message_type("std_srvs/srv/Trigger")
        self._request_type, self._response_type = trigger.Request, trigger.Response
        self._services = [(action, node.create_service(trigger, f"~/{action}", _never_called)) for action in Action]
        self._values = [
            node.create_subscription(message_type("std_msgs/msg/Float64"), f"set/{name}", _never_called, _COMMAND_DEPTH)
            for name in wiring.set_names
        ]
        self._station = node.create_subscription(
            message_type("std_msgs/msg/Header"), "station", _never_called, newest_only()
        )
        self._parameters = ModelParameters(node, model, [service for _, service in self._services])
        kind = message_type("diagnostic_msgs/msg/DiagnosticArray")
        self._diagnostics = node.create_publisher(kind, "diagnostics", _COMMAND_DEPTH)
        self._setpoint = node.create_publisher(message_type("geometry_msgs/msg/TwistStamped"), "setpoint", _AHEAD_DEPTH)
        self._base_frame = ros.base_frame
        self._looks = 0
        self._told: set[str] = set()

    @property
    def over(self) -> str | None:
        """Whether the ROS context has shut down."""
        return None if self._node.context.ok() else "ROS has shut down"

    def take(self) -> Inbox:
        """Everything that has arrived; see `Stage.take`."""
        inbox = Inbox()
        self._guarded(self._take, inbox)
        return inbox

    def publish(self, report: Report) -> None:
        """Publish every topic of the cycle, the mode first: a stop is confirmed by it."""
        self._guarded(self._publish_mode, report)
        for publish in self._publishers:
            self._guarded(publish, report.stamp_ns, report.values)
        for tell, value in zip(self._topics, report.topics, strict=True):
            self._guarded(tell, value)
        if report.applied is not None:
            self._guarded(self._publish_setpoint, report.applied)

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[Status]) -> None:
        """Publish a diagnostic_msgs/DiagnosticArray."""
        self._guarded(self._diagnostics.publish, diagnostic_array(statuses, stamp_ns))

    def look_around(self) -> None:
        """Serve a parameter request; now and then look for publishers that never reach us, and say each once."""
        self._guarded(self._parameters.serve_one)
        self._looks += 1
        turn, rest = divmod(self._looks, _LOOK_EVERY)
        if rest == 0:
            self._guarded(self._look_at, self._subscriptions[turn % len(self._subscriptions)][0])

    def close(self) -> None:
        """Nothing to do: who made the node destroys it."""

    def _take(self, inbox: Inbox) -> None:
        inbox.written, self._parameters.written = self._parameters.written, []
        for subscription, convert in self._subscriptions:
            inbox.setpoints += [convert(message) for message in _taken(subscription)]
        for index, subscription in enumerate(self._values):
            inbox.values += [SetValue(index, message.data) for message in _taken(subscription)]
        # Of heartbeats only the newest is kept, and one is taken a cycle: whoever floods them holds nothing up.
        inbox.stations += [_heartbeat(message) for message in itertools.islice(_taken(self._station), 1)]
        for action, service in self._services:
            request, header = service.handle.service_take_request(self._request_type)
            if request is not None:
                inbox.requests.append(Request(action, self._answer(service, header)))

    def _publish_setpoint(self, applied: StampedSetpoint) -> None:
        """Tell which set-point came into force, and when: whoever sent it can check that it did."""
        message = self._setpoint.msg_type()
        set_stamp(message.header, applied.stamp_ns or 0)
        message.header.frame_id = self._base_frame
        message.twist.linear.x, message.twist.angular.z = applied.setpoint
        self._setpoint.publish(message)

    def _look_at(self, subscription: RosObject) -> None:
        for peer in self._node.get_publishers_info_by_topic(subscription.topic_name):
            text = mismatch(subscription.topic_name, _type_name(subscription.msg_type), peer)
            if text is not None:
                self._tell_once(text)

    def _guarded(self, function: Callable[..., None], *arguments: object) -> None:
        """Call into ROS; what goes wrong there is told, and the robot goes on without it."""
        try:
            function(*arguments)
        except RuntimeError as error:  # the root of what rclpy's C++ core raises
            self._tell_once(f"ROS failed: {error}; the robot goes on without this message")

    def _tell_once(self, text: str) -> None:
        if text not in self._told and len(self._told) < _TOLD_AT_MOST:
            self._told.add(text)
            _logger.warning(text)

    def _subscribe(
        self, topic: str, type_name: str, depth: int, convert: Callable[[RosObject], StampedSetpoint]
    ) -> tuple[RosObject, Callable[[RosObject], StampedSetpoint]]:
        return self._node.create_subscription(message_type(type_name), topic, _never_called, depth), convert

    def _answer(self, service: RosObject, header: RosObject) -> Callable[[Answer], None]:
        def send(answer: Answer) -> None:
            response = self._response_type(success=answer.accepted, message=answer.message)
            self._guarded(service.handle.service_send_response, response, header.request_id)

        return send


def _taken(subscription: RosObject) -> Iterator[RosObject]:
    """The messages that wait, oldest first."""
    handle, kind = subscription.handle, subscription.msg_type
    for _ in range(_TAKEN_PER_CYCLE):
        taken = handle.take_message(kind, False)  # noqa: FBT003 - rclpy's signature: not raw
        if taken is None:
            return
        yield taken[0]


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


def _heartbeat(message: RosObject) -> Heartbeat:
    return Heartbeat(message.frame_id[:_LONGEST_NAME], stamp_ns(message))
