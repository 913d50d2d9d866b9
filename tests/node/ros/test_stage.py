# SPDX-License-Identifier: MIT
"""What the stage publishes of a cycle and when, with a node that only remembers."""

import importlib
import math
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from segway_ecc.node.config import RosSection
from segway_ecc.node.cycle.interfaces import Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST
from segway_ecc.node.cycle.signals import published_signals
from segway_ecc.node.cycle.trajectory import MOST_POINTS
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.ros.protocol import RosSettings
from segway_ecc.node.ros.stage import ModelParameters, RosStage
from segway_ecc.node.safety.modes import Mode

pytestmark = pytest.mark.ros

TOPICS = ["mode", "setpoint", "linear_velocity", "angular_velocity", "position", "odom", "joint_states", "imu/data"]
TOPICS += ["battery_state", "track"]
PUBLISHED = published_signals(())
SETTINGS = RosSettings(
    robot="alice",
    ros=RosSection(),
    namespace="",
    ros_arguments=(),
    period_ns=10_000_000,
    published=PUBLISHED,
    topics=("track",),
    set_names=(),
    stand=None,
    parameters=(),
    reports=-1,
    inboxes=-1,
)


class Graph:
    """Who subscribes to what, and on which topics was published since it was asked last."""

    def __init__(self) -> None:
        self.subscribers: set[str] = set()
        self._published: list[str] = []
        node = MagicMock()
        node.create_publisher = self._create_publisher
        self.stage = RosStage(node, SETTINGS, lambda _values: None)

    def _create_publisher(self, _kind: type, topic: str, _depth: int) -> SimpleNamespace:
        return SimpleNamespace(
            publish=lambda _: self._published.extend([topic] if topic != "/rosout" else ()),
            get_subscription_count=lambda: int(topic in self.subscribers),
        )

    def topics_published_in(self, cycle: int) -> list[str]:
        """The topics on which this cycle is published."""
        applied = StampedSetpoint(REST, cycle)
        values = [1.0] * len(PUBLISHED)
        self.stage.publish(Report(cycle * 10**9, Mode.ARMED, values, applied, topics=(0.3,), cycle=cycle))
        published, self._published = self._published, []
        return published


def test_topics_without_subscribers_are_not_published() -> None:
    graph = Graph()
    assert not graph.stage.update_subscribed_topics()
    assert graph.topics_published_in(1) == []


@pytest.mark.parametrize("topic", TOPICS)
def test_a_topic_is_published_between_the_looks_that_find_its_subscriber(topic: str) -> None:
    graph = Graph()
    graph.stage.update_subscribed_topics()
    graph.subscribers.add(topic)
    assert graph.topics_published_in(1) == []
    assert graph.stage.update_subscribed_topics()
    assert graph.topics_published_in(2) == [topic]
    graph.subscribers.clear()
    assert not graph.stage.update_subscribed_topics()
    assert graph.topics_published_in(3) == []


def test_mode_is_published_first() -> None:
    graph = Graph()
    graph.subscribers = set(TOPICS)
    graph.stage.update_subscribed_topics()
    assert graph.topics_published_in(1) == TOPICS


@pytest.mark.parametrize("kind", [RuntimeError, ValueError, UnicodeError, AttributeError])
def test_what_fails_in_ros_is_logged_once_and_ends_nothing(
    caplog: pytest.LogCaptureFixture, kind: type[Exception]
) -> None:
    graph = Graph()
    graph.subscribers = set(TOPICS)
    graph.stage.update_subscribed_topics()
    failing = MagicMock(publish=MagicMock(side_effect=kind("out of order")))
    graph.stage._subscribed.insert(1, failing)
    with caplog.at_level("WARNING"):
        assert graph.topics_published_in(1) == graph.topics_published_in(2) == TOPICS
    assert failing.publish.call_count == 2
    assert [record.getMessage() for record in caplog.records] == [
        "ROS failed: out of order; the robot goes on without this message"
    ]


class Handle:
    """A subscription's handle with one message, which hands out bytes only where they are asked for."""

    pointer = 1

    def __init__(self, data: bytes) -> None:
        self._data = [data]

    def take_message(self, _kind: type, raw: bool) -> tuple[bytes, None] | None:  # noqa: FBT001 - rclpy's signature
        assert raw, "rclpy decodes all of it before anybody sees how large it is"
        return (self._data.pop(), None) if self._data else None


def test_a_trajectory_that_is_too_large_is_not_decoded_and_the_loop_is_to_refuse_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    too_large = b"\0\1\0\0" + (1_700_000_000).to_bytes(4, "little") + b"\5\0\0\0" + bytes(7_200_000)
    node = MagicMock()

    def subscribe(_kind: type, topic: str, *_: Any) -> SimpleNamespace:
        handle = Handle(too_large) if topic == "cmd_trajectory" else SimpleNamespace(pointer=0)
        return SimpleNamespace(handle=handle)

    node.create_subscription = subscribe
    stage = RosStage(node, SETTINGS, lambda _values: None)
    monkeypatch.setattr("rclpy.serialization.deserialize_message", None)
    (trajectory,) = stage.take_messages([Handle.pointer]).trajectories
    assert trajectory.stamp_ns == 1_700_000_000_000_000_005
    assert len(trajectory.points) == MOST_POINTS + 1


@pytest.mark.parametrize(("count", "is_served"), [(1000, True), (1001, False)])
def test_a_request_for_more_parameters_than_there_can_be_has_an_empty_answer(count: int, *, is_served: bool) -> None:
    kind = importlib.import_module("rcl_interfaces.srv").GetParameters
    served: list[Any] = []
    handle, node = MagicMock(pointer=1), MagicMock()
    handle.service_take_request.return_value = kind.Request(names=["a"] * count), MagicMock()
    node.services = [MagicMock(handle=handle, srv_type=kind, callback=lambda request, _: served.append(request))]
    parameters = ModelParameters(node, (), lambda _values: None, own_services=())
    if is_served:
        parameters.serve([1])
    else:
        with pytest.raises(RuntimeError, match="more than 1000 entries"):
            parameters.serve([1])
        assert handle.service_send_response.call_args.args[0] == kind.Response()
    assert handle.service_send_response.call_count == 1
    assert bool(served) is is_served


TUNABLE = Variable("Track", "m", 0.3, Write.NOW, minimum=0.2, maximum=0.5, tunable=True)


def parameters_with(values: dict[str, float], asked: list[Any]) -> tuple[ModelParameters, MagicMock]:
    """The parameters of a node that got these overrides, and that node."""
    node = MagicMock()
    node.get_parameters_by_prefix.return_value = {name: MagicMock(value=value) for name, value in values.items()}
    return ModelParameters(node, (TUNABLE,), asked.append, own_services=()), node


@pytest.mark.parametrize(("value", "shown"), [(0.4, 0.4), (0.9, 0.3), (math.nan, 0.3)])
def test_an_override_beyond_the_range_is_left_to_the_loop_to_refuse(value: float, shown: float) -> None:
    parameters, node = parameters_with({"Track": value}, [])
    assert parameters.overrides.keys() == {"Track"}
    name, declared, descriptor = node.declare_parameter.call_args.args
    assert (name, declared) == ("Track", shown)
    (bounds,) = descriptor.floating_point_range
    assert (bounds.from_value, bounds.to_value, bounds.step) == (0.2, 0.5, 0.0)
    assert descriptor.additional_constraints == "taken also while the robot is armed"


def test_what_ros_refuses_by_itself_is_passed_on_once_to_be_counted_and_recorded() -> None:
    asked: list[Any] = []
    parameters, _ = parameters_with({}, asked)
    rclpy = importlib.import_module("rclpy")
    given = [("Track", 0.9), ("Track", "wide"), ("Mass", 1.0)]
    request = MagicMock(parameters=[rclpy.Parameter(name, value=value).to_parameter_msg() for name, value in given])
    parameters._report_refused(request)
    ((first, second),) = asked
    assert (first, second[0], math.isnan(second[1])) == (("Track", 0.9), "Track", True)

    parameters._set([rclpy.Parameter("Track", value=0.4)])
    parameters._report_refused(request)
    assert asked[1:] == [[("Track", 0.4)]]


def test_others_that_publish_the_robots_topics_are_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    def peer(namespace: str, name: str) -> SimpleNamespace:
        return SimpleNamespace(node_namespace=namespace, node_name=name, topic_type="", qos_profile=MagicMock())

    ours, other = peer("/a", "model"), peer("/", "cat")
    published = {"/a/mode": [ours, other], "/a/odom": [ours], "/a/setpoint": [ours, ours], "/a/trajectory_status": []}
    node = MagicMock()
    node.get_fully_qualified_name.return_value = "/a/model"
    node.resolve_topic_name = lambda name: f"/a/{name}"
    node.create_subscription.return_value.msg_type = Report  # any class
    node.get_publishers_info_by_topic = lambda topic: published.get(topic, [])
    stage = RosStage(node, SETTINGS, lambda _values: None)
    for _ in range(6):
        stage.do_background_work()
    assert stage.strangers == ["/cat publishes /a/mode, too"]
    for _ in range(54):
        stage.do_background_work()
    assert len(stage.strangers) == 1, "the process before us is still seen for 20 s"
    for _ in range(6):
        stage.do_background_work()
    assert stage.strangers[1:] == ["another /a/model publishes /a/setpoint, too"]
    assert len([each for each in caplog.records if ", too" in each.getMessage()]) == 2


def test_station_introduces_itself_by_a_name_that_can_be_logged() -> None:
    node, taken = MagicMock(), []
    handles: dict[str, MagicMock] = {}

    def create_subscription(_kind: type, topic: str, *_: object) -> MagicMock:
        handles[topic] = MagicMock(pointer=len(handles))
        return MagicMock(handle=handles[topic])

    node.create_subscription = create_subscription
    stage = RosStage(node, SETTINGS, lambda _values: None)
    for name in ("workshop", "", "two\nlines", "x" * 1000):
        handles["watch"].take_message.return_value = (SimpleNamespace(data=name), {})
        taken += stage.take_messages([handles["watch"].pointer]).introductions
    assert taken == ["workshop", "x" * 80]
