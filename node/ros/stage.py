# SPDX-License-Identifier: MIT
"""The robot in ROS: takes messages from its own handles, publishes, serves the model's parameters; no executor runs."""

import importlib
import logging
import re
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Final

from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, Report, Request, SetValue, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.ros.messages import RosObject, diagnostic_array, message_type, newest_only, stamp_ns
from segway_ecc.node.ros.protocol import RosSettings
from segway_ecc.node.ros.publishers import AHEAD_DEPTH, Topic, make_topics
from segway_ecc.node.ros.runtime import mismatches
from segway_ecc.node.ros.trajectories import TRAJECTORY_TOPIC, TRAJECTORY_TYPE, read_trajectory
from segway_ecc.node.safety.modes import Action, Answer

_TAKEN_AT_ONCE: Final = 100
"""Messages taken from one topic at once at most, so that a flood delays none of the others."""
_COMMAND_DEPTH: Final = 10
LONGEST_NAME: Final = 80
"""Of a base station, in characters: it is echoed ten times a second."""
_WARNINGS_AT_MOST: Final = 100
_EFFECT: Final = {
    Write.NOW: "a write takes effect at the next step",
    Write.STATIC: "a write takes effect at the next step, through the static equations",
    Write.RESET: "a write takes effect when the model is initialized again",
    Write.NEVER: "cannot be written while the robot runs",
}
_logger = logging.getLogger(__name__)


class RosStage:
    """Publishes what the loop reports, and takes what arrives for it; each may be done by a thread of its own.

    Attributes:
        subscriptions: Where something may arrive for `take_messages`.
        services: Where something may arrive for `take_messages`, or for `serve_parameters`.
    """

    def __init__(self, node: RosObject, settings: RosSettings, write: Callable[[str, float], None]) -> None:
        """Offer a robot's topics, services and parameters; `write` writes one of the model or raises `ModelError`."""
        self._node = node
        self._topics = make_topics(node, settings)
        self._subscribed: list[Topic] = []
        self._takers: dict[int, Callable[[Inbox], None]] = {}
        self.subscriptions: list[RosObject] = []
        self._subscribe_inputs(settings.set_names)
        self._watched = tuple(self.subscriptions[:2])  # the set-points
        own_services = [self._serve(action) for action in Action]
        self._parameters = ModelParameters(node, settings.parameters, write, own_services)
        self.services = [*own_services, *self._parameters.services]
        kind = message_type("diagnostic_msgs/msg/DiagnosticArray")
        self._diagnostics = node.create_publisher(kind, "diagnostics", _COMMAND_DEPTH)
        self._looks = 0
        self._warnings: set[str] = set()

    def take_messages(self, ready: Collection[int]) -> Inbox:
        """What has arrived, but for parameter requests, where the handle is at one of these pointers."""
        inbox = Inbox()
        for pointer in ready:
            if pointer in self._takers:
                self._guarded(self._takers[pointer], inbox)
        return inbox

    def update_subscribed_topics(self) -> bool:
        """Look which topics of cycles are subscribed to: until the next look only those are published.

        Returns:
            Whether any is.
        """

        def look() -> None:
            self._subscribed = [topic for topic in self._topics if topic.has_subscribers()]

        self._guarded(look)
        return bool(self._subscribed)

    def publish(self, report: Report) -> None:
        """Publish a cycle's report on the topics that are subscribed to."""
        for topic in self._subscribed:
            self._guarded(topic.publish, report)

    def publish_diagnostics(self, stamp_ns: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Publish a diagnostic_msgs/DiagnosticArray."""
        self._guarded(self._diagnostics.publish, diagnostic_array(statuses, stamp_ns))

    def serve_parameters(self, ready: Collection[int]) -> None:
        """Answer the parameter requests that have arrived where the handle is at one of these pointers."""
        if ready:
            self._guarded(self._parameters.serve, ready)

    def do_background_work(self) -> None:
        """Look for publishers that never reach us, on another topic each time, and warn of each once."""
        self._looks += 1
        subscription = self._watched[self._looks % len(self._watched)]

        def look() -> None:
            for text in mismatches(self._node, subscription):
                self._warn_once(text)

        self._guarded(look)

    def _guarded(self, function: Callable[..., None], *arguments: object) -> None:
        """Call into ROS; what fails there is logged, and the robot goes on without it."""
        try:
            function(*arguments)
        except RuntimeError as error:  # the root of what rclpy's C++ core raises
            self._warn_once(f"ROS failed: {error}; the robot goes on without this message")

    def _warn_once(self, text: str) -> None:
        if text not in self._warnings and len(self._warnings) < _WARNINGS_AT_MOST:
            self._warnings.add(text)
            _logger.warning(text)

    def _subscribe_inputs(self, set_names: Sequence[str]) -> None:
        def take_twist(inbox: Inbox, message: RosObject) -> None:
            inbox.setpoints.append(StampedSetpoint(Setpoint(message.linear.x, message.angular.z), None))

        def take_twist_stamped(inbox: Inbox, message: RosObject) -> None:
            setpoint = Setpoint(message.twist.linear.x, message.twist.angular.z)
            inbox.setpoints.append(StampedSetpoint(setpoint, stamp_ns(message.header)))

        def take_value(place: int, inbox: Inbox, message: RosObject) -> None:
            inbox.values.append(SetValue(place, message.data))

        def take_heartbeat(inbox: Inbox, message: RosObject) -> None:
            inbox.stations.append(Heartbeat(message.frame_id[:LONGEST_NAME], stamp_ns(message)))

        def take_trajectory(inbox: Inbox, message: RosObject) -> None:
            inbox.trajectories.append(read_trajectory(message))

        self._subscribe("cmd_vel", "geometry_msgs/msg/Twist", _COMMAND_DEPTH, take_twist)
        self._subscribe("cmd_vel_stamped", "geometry_msgs/msg/TwistStamped", AHEAD_DEPTH, take_twist_stamped)
        # One is taken at once, so that many of them delay nothing.
        self._subscribe(TRAJECTORY_TOPIC, TRAJECTORY_TYPE, _COMMAND_DEPTH, take_trajectory, at_once=1)
        for place, name in enumerate(set_names):
            self._subscribe(f"set/{name}", "std_msgs/msg/Float64", _COMMAND_DEPTH, partial(take_value, place))
        # Of heartbeats only the newest is kept, and one is taken at once: whoever floods them delays nothing.
        self._subscribe("station", "std_msgs/msg/Header", newest_only(), take_heartbeat, at_once=1)

    def _subscribe(
        self,
        topic: str,
        type_name: str,
        qos: RosObject,
        take: Callable[[Inbox, RosObject], None],
        at_once: int = _TAKEN_AT_ONCE,
    ) -> None:
        kind = message_type(type_name)
        subscription = self._node.create_subscription(kind, topic, _never_called, qos)
        handle = subscription.handle

        def take_all(inbox: Inbox) -> None:
            for _ in range(at_once):
                taken = handle.take_message(kind, False)  # noqa: FBT003 - rclpy's signature: not raw
                if taken is None:
                    return
                take(inbox, taken[0])

        self._takers[handle.pointer] = take_all
        self.subscriptions.append(subscription)

    def _serve(self, action: Action) -> RosObject:
        kind = message_type("std_srvs/srv/Trigger")
        service = self._node.create_service(kind, f"~/{action}", _never_called)

        def take(inbox: Inbox) -> None:
            request, header = service.handle.service_take_request(kind.Request)
            if request is None:
                return

            def send(answer: Answer) -> None:
                response = kind.Response(success=answer.accepted, message=answer.message)
                self._guarded(service.handle.service_send_response, response, header.request_id)

            inbox.requests.append(Request(action, send))

        self._takers[service.handle.pointer] = take
        return service


class ModelParameters:
    """The model's parameters as ROS parameters of a node; it is the loop that writes them, between two steps."""

    def __init__(
        self,
        node: RosObject,
        parameters: Sequence[Variable],
        write: Callable[[str, float], None],
        own_services: Sequence[RosObject],
    ) -> None:
        """Declare them on `node`, each with the value that it has now.

        `write` writes one by its name, or raises `ModelError`; `own_services` are served by somebody else.
        """
        self._write = write
        self._names: dict[str, Variable] = {}
        self._result_type = message_type("rcl_interfaces/msg/SetParametersResult")
        for variable in parameters:
            name = parameter_name(variable.name, self._names)
            self._names[name] = variable
            why = f": {variable.why}" if variable.why else ""
            descriptor = message_type("rcl_interfaces/msg/ParameterDescriptor")(
                description=f"{variable.name}, {variable.unit}; {_EFFECT[variable.write]}{why}",
                read_only=variable.write is Write.NEVER,
            )
            node.declare_parameter(name, variable.value, descriptor)
        node.add_on_set_parameters_callback(self._set)
        self.services = [service for service in node.services if service not in own_services]

    def serve(self, ready: Collection[int]) -> None:
        """Answer a request of each service whose handle is at one of these pointers."""
        for service in self.services:
            if service.handle.pointer not in ready:
                continue
            request, header = service.handle.service_take_request(service.srv_type.Request)
            if request is not None:
                response = service.callback(request, service.srv_type.Response())
                service.handle.service_send_response(response, header.request_id)

    def _set(self, parameters: Sequence[RosObject]) -> RosObject:
        double = importlib.import_module("rclpy").Parameter.Type.DOUBLE
        # What ROS itself declares is let pass.
        ours = [(self._names[p.name], p) for p in parameters if p.name in self._names]
        for variable, parameter in ours:
            if parameter.type_ is not double:
                return self._result_type(successful=False, reason=f"{variable.name} takes a floating-point number")
        try:
            for variable, parameter in ours:
                self._write(variable.name, parameter.value)
        except ModelError as error:
            return self._result_type(successful=False, reason=str(error))
        return self._result_type(successful=True)


def parameter_name(name: str, taken: dict[str, Variable]) -> str:
    """A unique name of a ROS parameter: the variable's hierarchy with dots, and what ROS does not take as `_`."""
    plain = re.sub(r"[^A-Za-z0-9_.]", "_", name.replace("\\", "."))
    unique, count = plain, 1
    while unique in taken:
        count += 1
        unique = f"{plain}_{count}"
    return unique


def _never_called(*_: RosObject) -> None:
    """Stand in for the callbacks that only an executor would call."""
