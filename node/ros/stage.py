# SPDX-License-Identifier: MIT
"""The robot in ROS: takes messages from its own handles, publishes, serves the model's parameters; no executor runs."""

import contextlib
import importlib
import logging
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence, Sized
from functools import partial
from typing import Final

from msgspec import structs

from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, Report, Request, SetValue, StampedSetpoint
from segway_ecc.node.cycle.report import SETPOINTS_SUFFIX
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write, refusal_of
from segway_ecc.node.model.writer import Values
from segway_ecc.node.ros.messages import (
    TWIST_STAMPED_TYPE,
    TWIST_TYPE,
    RosObject,
    diagnostic_array,
    kept_for_latecomers,
    message_type,
    newest_only,
    stamp_ns,
)
from segway_ecc.node.ros.protocol import (
    NO_SIM_TIME,
    SIM_TIME,
    USE_SIM_TIME,
    WATCH_TOPIC,
    WATCH_TYPE,
    RosSettings,
)
from segway_ecc.node.ros.publishers import AHEAD_DEPTH, Topic, make_clock, make_topics
from segway_ecc.node.ros.ros_log import RosLog
from segway_ecc.node.ros.runtime import mismatches, namesakes, strangers, unreached
from segway_ecc.node.ros.trajectories import TRAJECTORY_TOPIC, TRAJECTORY_TYPE, read_trajectory
from segway_ecc.node.safety.modes import POSTURES, Action, Answer

_TAKEN_AT_ONCE: Final = 100
"""Messages taken from one topic at once at most, so that a flood delays none of the others."""
_COMMAND_DEPTH: Final = 10
LONGEST_NAME: Final = 80
"""Of a base station, in characters: it is echoed ten times a second."""
_WARNINGS_AT_MOST: Final = 100
_DECIDED_BY: Final = ("mode", "odom", "setpoint", "trajectory_status")
_NAMESAKE_LOOKS: Final = 2
_LEFT_OVER_LOOKS: Final = 10
"""One comes each 3 s for each topic."""
_MOST_STRANGERS: Final = 20
_MOST_ENTRIES: Final = 1000
"""Of a request for parameters, beside as many as there are: what is longer delays a stop by seconds."""
_REPORTED: Final = 10
"""Of the parameters of one request that ROS refused."""
_EFFECT: Final = {
    Write.NOW: "a write takes effect at the next step",
    Write.STATIC: "a write takes effect at the next step, through the static equations",
    Write.RESET: "a write takes effect when the model is initialized again",
    Write.NEVER: "cannot be written while the robot runs",
}
_ROS_OWN: Final = re.compile(r"use_sim_time|start_type_description_service|qos_overrides\..*")
"""Parameters that ROS itself declares."""
_logger = logging.getLogger(__name__)


class RosStage:
    """Publishes what the loop reports, and takes what arrives for it; each may be done by a thread of its own.

    Attributes:
        subscriptions: Where something may arrive for `take_messages`.
        services: Where something may arrive for `take_messages`, or for `serve_parameters`.
        overrides: See `ModelParameters`.
        strangers: Who else publishes our topics, each with the topic; of those that were ever seen, 20 at most.
    """

    def __init__(self, node: RosObject, settings: RosSettings, write: Callable[[Values], None]) -> None:
        """Offer a robot's topics, services and parameters; `write` writes some of the model or raises `ModelError`."""
        settings = structs.replace(settings, ros=settings.ros.in_namespace(node.get_namespace()))
        self._node = node
        self._looks = self._doubles = 0
        self._is_again, self._has_namesake = settings.is_again, False
        self.strangers: list[str] = []
        self._warnings: set[str] = set()
        self._robot_name = settings.robot
        self._log = RosLog(node)
        self._topics = [*make_topics(node, settings), Topic(self._log.publisher, self._log.log_mode)]
        self._subscribed: list[Topic] = []
        self._takers: dict[int, Callable[[Inbox], None]] = {}
        self.subscriptions: list[RosObject] = []
        self._subscribe_inputs(settings)
        self._watched = tuple(self.subscriptions[:2])  # the set-points
        # Of what stations and players decide by; others may publish joint_states or diagnostics beside us.
        self._own_topics = tuple(node.resolve_topic_name(name) for name in _DECIDED_BY)
        self._doubled: Counter[str] = Counter()
        self._describe(settings.description)
        self._clock = make_clock(node) if settings.is_simulated else None
        own_services = [self._serve(each) for each in Action if settings.stand is not None or each not in POSTURES]
        self._parameters = ModelParameters(node, settings.parameters, write, own_services, is_again=settings.is_again)
        self.services = [*own_services, *self._parameters.services]
        self.overrides = self._parameters.overrides
        if not settings.is_simulated and node.get_parameter(USE_SIM_TIME).value is True:
            self.overrides[USE_SIM_TIME] = None  # refused by the loop, which then ends
        kind = message_type("diagnostic_msgs/msg/DiagnosticArray")
        self._diagnostics = node.create_publisher(kind, "diagnostics", _COMMAND_DEPTH)
        # The tools of ROS look there alone, whatever the namespace (REP-107).
        self._prefix = f"{node.get_namespace()}/".lstrip("/")
        self._all_diagnostics = node.create_publisher(kind, "/diagnostics", _COMMAND_DEPTH) if self._prefix else None

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
        """Publish a diagnostic_msgs/DiagnosticArray, and in a namespace also on `/diagnostics`, with its name."""
        name, prefix = self._robot_name, self._prefix
        self._guarded(self._diagnostics.publish, diagnostic_array(statuses, stamp_ns, name))
        if self._all_diagnostics is not None:
            array = diagnostic_array(statuses, stamp_ns, f"{prefix}{name}", prefix)
            self._guarded(self._all_diagnostics.publish, array)
        for status in statuses:
            if status.name.endswith(SETPOINTS_SUFFIX) and status.level is not Level.OK:
                causes = [
                    f"{key} {value}" for key, value in status.values.items() if key.startswith(("refused.", "cl"))
                ]
                text = f"set-points: {status.message} (in all {', '.join(causes)})"
                self._guarded(self._log.write, status.level, text, stamp_ns)

    def publish_clock(self, stamp_ns: int) -> None:
        """Publish simulated time, ns since the Unix epoch."""
        if self._clock is not None:
            self._guarded(self._clock, stamp_ns)

    def serve_parameters(self, ready: Collection[int]) -> None:
        """Answer the parameter requests that have arrived where the handle is at one of these pointers."""
        if ready:
            self._guarded(self._parameters.serve, ready)

    def do_background_work(self) -> None:
        """Look for publishers that never reach us, or that publish what is ours; another topic each time."""
        self._looks += 1
        self._guarded(self._look_for_namesakes)
        looks = (
            *(partial(self._look_for_mismatches, each) for each in self._watched),
            *(partial(self._look_for_strangers, each) for each in self._own_topics),
        )
        self._guarded(looks[self._looks % len(looks)])

    def _describe(self, urdf: str) -> None:
        """Publish the robot's description, for whoever subscribes at any time."""
        if urdf:
            kind = message_type("std_msgs/msg/String")
            self._description = self._node.create_publisher(kind, "robot_description", kept_for_latecomers())
            self._guarded(self._description.publish, kind(data=urdf))

    def _look_for_namesakes(self) -> None:
        """Log at once that another robot has this one's name; `strangers` have it once it cannot be one that died."""
        self._doubles = self._doubles + 1 if namesakes(self._node) else 0
        if self._doubles < _NAMESAKE_LOOKS or self._is_again or self._has_namesake:
            return
        self._has_namesake = True
        own = self._node.get_fully_qualified_name()
        self._warn_once(
            f"another {own} is in this ROS domain, and topics, services and commands of the two are mixed up (a run "
            "that died is still seen for 20 s): "
            "name each robot with --namespace /NAME, or give it another ROS_DOMAIN_ID"
        )

    def _look_for_mismatches(self, subscription: RosObject) -> None:
        for text in mismatches(self._node, subscription):
            self._warn_once(text)

    def _look_for_strangers(self, topic: str) -> None:
        """Report each other publisher of a topic of ours once."""
        for text in unreached(self._node, topic):
            self._warn_once(text)
        others, doubles = strangers(self._node, topic)
        # One of our own name may be the process that we have replaced, which others see for 20 s.
        self._doubled[topic] = self._doubled[topic] + 1 if doubles else 0
        if self._doubled[topic] > _LEFT_OVER_LOOKS:
            others.append(f"another {self._node.get_fully_qualified_name()}")
        for other in others:
            text = f"{other} publishes {topic}, too"
            if text not in self.strangers and len(self.strangers) < _MOST_STRANGERS:
                self.strangers.append(text)
                self._warn_once(f"{text}: who subscribes to it cannot know which is this robot's")

    def _guarded(self, function: Callable[..., None], *arguments: object) -> None:
        """Call into ROS; what fails there is logged, and the robot goes on without it."""
        try:
            function(*arguments)
        except Exception as error:  # noqa: BLE001 - whatever fails in ROS, or in what others send, ends nothing here
            self._warn_once(f"ROS failed: {error}; the robot goes on without this message")

    def _warn_once(self, text: str) -> None:
        if text not in self._warnings and len(self._warnings) < _WARNINGS_AT_MOST:
            self._warnings.add(text)
            _logger.warning(text)
            with contextlib.suppress(Exception):  # where even that fails, the line above has been logged
                self._log.write(Level.WARN, text)

    def _subscribe_inputs(self, settings: RosSettings) -> None:
        def take_twist(inbox: Inbox, message: RosObject) -> None:
            inbox.setpoints.append(StampedSetpoint(Setpoint(message.linear.x, message.angular.z), None))

        def take_twist_stamped(inbox: Inbox, message: RosObject) -> None:
            setpoint = Setpoint(message.twist.linear.x, message.twist.angular.z)
            # A stamp of zero is none, as tools leave it: now.
            inbox.setpoints.append(StampedSetpoint(setpoint, stamp_ns(message.header) or None))

        def take_value(place: int, inbox: Inbox, message: RosObject) -> None:
            inbox.values.append(SetValue(place, message.data))

        def take_heartbeat(inbox: Inbox, message: RosObject) -> None:
            inbox.stations.append(Heartbeat(message.frame_id[:LONGEST_NAME], stamp_ns(message)))

        def take_introduction(inbox: Inbox, message: RosObject) -> None:
            name = message.data[:LONGEST_NAME]
            if name and name.isprintable():  # it is logged
                inbox.introductions.append(name)

        def take_trajectory(inbox: Inbox, data: bytes) -> None:
            inbox.trajectories.append(read_trajectory(data, settings.ros.base_frame))

        if settings.ros.cmd_vel == "Twist":
            self._subscribe("cmd_vel", TWIST_TYPE, _COMMAND_DEPTH, take_twist)
        else:
            self._subscribe("cmd_vel", TWIST_STAMPED_TYPE, _COMMAND_DEPTH, take_twist_stamped)
        self._subscribe("cmd_vel_stamped", TWIST_STAMPED_TYPE, AHEAD_DEPTH, take_twist_stamped)
        # One is taken at once, so that many of them delay nothing.
        self._subscribe(TRAJECTORY_TOPIC, TRAJECTORY_TYPE, _COMMAND_DEPTH, take_trajectory, at_once=1)
        for place, name in enumerate(settings.set_names):
            self._subscribe(f"set/{name}", "std_msgs/msg/Float64", _COMMAND_DEPTH, partial(take_value, place))
        # Of heartbeats only the newest is kept, and one is taken at once: whoever floods them delays nothing.
        self._subscribe("station", "std_msgs/msg/Header", newest_only(), take_heartbeat, at_once=1)
        self._subscribe(WATCH_TOPIC, WATCH_TYPE, _COMMAND_DEPTH, take_introduction, at_once=1)

    def _subscribe(
        self,
        topic: str,
        type_name: str,
        qos: RosObject,
        take: Callable[[Inbox, RosObject], None],
        at_once: int = _TAKEN_AT_ONCE,
    ) -> None:
        raw = type_name == TRAJECTORY_TYPE  # the only one with arrays, which take long to decode where they are long
        kind = message_type(type_name)
        subscription = self._node.create_subscription(kind, topic, _never_called, qos)
        handle = subscription.handle

        def take_all(inbox: Inbox) -> None:
            for _ in range(at_once):
                taken = handle.take_message(kind, raw)
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
                if not answer.accepted:
                    self._guarded(self._log.write, Level.WARN, f"{action} is refused: {answer.message}")

            inbox.requests.append(Request(action, send))

        self._takers[service.handle.pointer] = take
        return service


class ModelParameters:
    """The model's parameters as ROS parameters of a node; it is the loop that writes them, between two steps.

    Attributes:
        overrides: What the command line has of parameters, by the model's names: values, and None where it is no
            floating-point number. The loop is to write them, or to end where it cannot.
        services: Where requests arrive.
    """

    def __init__(
        self,
        node: RosObject,
        parameters: Sequence[Variable],
        write: Callable[[Values], None],
        own_services: Sequence[RosObject],
        *,
        is_again: bool = False,
    ) -> None:
        """Declare them on `node`, each with the value that it has now, or on the command line unless `is_again`.

        `write` writes some, all or none, or raises `ModelError`; `own_services` are served by somebody else.
        `use_sim_time` stays what it is.
        """
        self._is_simulated = node.get_parameter(USE_SIM_TIME).value
        self._write = write
        self._asked: set[str] = set()
        self._names: dict[str, Variable] = {}
        self._result_type = message_type("rcl_interfaces/msg/SetParametersResult")
        ours = {name: each for name, each in node.get_parameters_by_prefix("").items() if not _ROS_OWN.fullmatch(name)}
        given = {name: each.value if type(each.value) is float else None for name, each in ours.items()}
        given = {} if is_again else given
        self.overrides: dict[str, float | None] = {}
        for variable in parameters:
            name = parameter_name(variable.name, self._names)
            self._names[name] = variable
            why = f": {variable.why}" if variable.why else ""
            descriptor = message_type("rcl_interfaces/msg/ParameterDescriptor")(
                description=f"{variable.name}, {variable.unit}; {_EFFECT[variable.write]}{why}",
                read_only=variable.write is Write.NEVER,
            )
            if variable.write is not Write.NEVER:
                bounds = {"from_value": variable.minimum, "to_value": variable.maximum}
                descriptor.floating_point_range = [message_type("rcl_interfaces/msg/FloatingPointRange")(**bounds)]
                when = "also while the robot is armed" if variable.tunable else "only while the robot is not armed"
                descriptor.additional_constraints = f"taken {when}"
            if node.has_parameter(name):
                node.undeclare_parameter(name)  # it was declared as it was given
            if name in given:
                self.overrides[variable.name] = given.pop(name)
            value = self.overrides.get(variable.name)
            is_refused = value is None or bool(refusal_of(variable, value))  # by the loop, which then ends
            shown = variable.value if is_refused else value
            node.declare_parameter(name, shown, descriptor, ignore_override=True)
        self.overrides |= given
        node.add_on_set_parameters_callback(self._set)
        self.services = [service for service in node.services if service not in own_services]

    def serve(self, ready: Collection[int]) -> None:
        """Answer a request of each service whose handle is at one of these pointers."""
        for service in self.services:
            if service.handle.pointer not in ready:
                continue
            request, header = service.handle.service_take_request(service.srv_type.Request)
            if request is None:
                continue
            response, most = service.srv_type.Response(), _MOST_ENTRIES + len(self._names)
            fields = [getattr(request, name) for name in request.get_fields_and_field_types()]
            is_too_long = any(len(field) > most for field in fields if isinstance(field, Sized))
            if not is_too_long:
                self._asked.clear()
                response = service.callback(request, response)
                self._report_refused(request)
            service.handle.service_send_response(response, header.request_id)
            if is_too_long:
                raise RuntimeError(f"a request to {service.srv_name} has more than {most} entries: answered with none")

    def _report_refused(self, request: RosObject) -> None:
        """Pass on what ROS refused by itself, by range or type: the loop refuses it too, counts it and records it."""
        double = importlib.import_module("rclpy").Parameter.Type.DOUBLE.value
        values = [
            (self._names[each.name].name, each.value.double_value if each.value.type == double else math.nan)
            for each in getattr(request, "parameters", ())
            if each.name in self._names and each.name not in self._asked and hasattr(each, "value")
        ]
        if values:
            with contextlib.suppress(ModelError):
                self._write(values[:_REPORTED])

    def _set(self, parameters: Sequence[RosObject]) -> RosObject:
        double = importlib.import_module("rclpy").Parameter.Type.DOUBLE
        # What ROS itself declares is let pass.
        ours = [(self._names[p.name], p) for p in parameters if p.name in self._names]
        if any(p.name == USE_SIM_TIME and p.value is not self._is_simulated for p in parameters):
            return self._result_type(successful=False, reason=SIM_TIME if self._is_simulated else NO_SIM_TIME)
        for variable, parameter in ours:
            if parameter.type_ is not double:
                return self._result_type(successful=False, reason=f"{variable.name} takes a floating-point number")
        self._asked.update(parameter.name for parameter in parameters)
        try:
            if ours:
                self._write([(variable.name, parameter.value) for variable, parameter in ours])
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
