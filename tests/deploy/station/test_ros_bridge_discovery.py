# SPDX-License-Identifier: MIT
"""Which robots the station finds in the graph, and whose services it calls, with a graph that a test makes."""

import importlib
from collections.abc import Callable
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.fleet import EventLog, Heartbeats
from segway_ecc.deploy.station.ros_bridge import MODE_TYPE, RosBridge, robots_in, topic
from segway_ecc.node.cycle.setpoints import Setpoint

over_ros = pytest.mark.ros
STOP = "~/stop"


def checked(name: str, *, is_service: bool = False) -> str:
    """A name that ROS takes; it raises for others, as rclpy's node does."""
    name = importlib.import_module("rclpy.expand_topic_name").expand_topic_name(name, "base_station", "/")
    importlib.import_module("rclpy.validate_full_topic_name").validate_full_topic_name(name, is_service=is_service)
    return name


class Graph:
    """Who publishes `mode` of the robot `/a`, and who offers `~/stop` there, as the bridge sees it in 0.5 s steps.

    Attributes:
        failing: Namespaces beside it that ROS fails at.
    """

    def __init__(self, events: EventLog) -> None:
        self.failing: list[str] = []
        self.publishers: list[str] = []
        self.serving: set[str] = set()
        node = MagicMock()
        node.get_topic_names_and_types = lambda: [
            (f"{name}/mode", [MODE_TYPE]) for name in (*self.failing, *(["/a"] if self.publishers else []))
        ]
        node.get_publishers_info_by_topic = self._publishers
        node.count_services = lambda name: checked(name, is_service=True) in {f"/a/{n}/stop" for n in self.serving}
        node.create_client = lambda _, name: MagicMock(srv_name=checked(name, is_service=True))
        node.create_subscription = lambda _, name, *__: MagicMock(topic_name=checked(name))
        self.bridge = RosBridge(node, CommandHandler(events, Heartbeats("base"), Setpoint(3.0, 6.0)), None, events)
        self._now_ns = 0

    def look(self, *publishers: str, serving: str, times: int = 1) -> str:
        """Who is followed after some looks; empty where nobody is."""
        self.publishers, self.serving = list(publishers), set(serving.split())
        for _ in range(times):
            self._now_ns += 500_000_000
            self.bridge.discover(self._now_ns)
        connection = self.bridge.connections.get("/a")
        return "" if connection is None else connection.model_node

    def _publishers(self, topic: str) -> list[SimpleNamespace]:
        if topic != "/a/mode":
            raise RuntimeError("DDS failed")
        return [SimpleNamespace(node_name=name) for name in self.publishers]


@pytest.fixture
def graph(events: EventLog) -> Graph:
    return Graph(events)


def test_a_robot_is_a_mode_of_the_right_type() -> None:
    topics = [
        ("/zoe/mode", [MODE_TYPE]),
        ("/mode", ["std_msgs/msg/String", MODE_TYPE]),
        ("/lab/amy/mode", [MODE_TYPE]),
        ("/bob/mode", ["std_msgs/msg/String"]),
        ("/eve/commode", [MODE_TYPE]),
        ("/eve/mode/other", [MODE_TYPE]),
    ]
    assert robots_in(topics) == ["/", "/lab/amy", "/zoe"]


def test_topics_of_a_robot() -> None:
    assert topic("/", "odom") == "/odom"
    assert topic("/lab/amy", "set/stand") == "/lab/amy/set/stand"


@over_ros
@pytest.mark.parametrize("stranger", ["another", "somebody"])
def test_node_that_offers_stop_is_followed_and_the_other_is_reported_once(
    graph: Graph, stranger: str, texts: Callable[[], list[str]]
) -> None:
    assert graph.look("model", stranger, serving="model", times=3) == "model"
    assert texts() == [f"{stranger} publishes mode in this namespace and offers no {STOP}: it is not followed; end it"]


@over_ros
def test_node_without_stop_is_never_followed_and_is_reported_after_10_s(
    graph: Graph, texts: Callable[[], list[str]]
) -> None:
    assert graph.look("another", serving="", times=20) == ""
    assert texts() == [], "the services of a robot that starts may be discovered after its topics"
    assert graph.look("another", serving="", times=20) == ""
    assert texts() == [f"another publishes mode in this namespace and offers no {STOP}: it is not followed; end it"]
    assert graph.look("another", "model", serving="model") == "model"


@over_ros
def test_robot_whose_services_are_discovered_later_is_followed_then_without_a_report(
    graph: Graph, texts: Callable[[], list[str]]
) -> None:
    assert graph.look("model", serving="", times=3) == ""
    assert graph.look("model", serving="model", times=30) == "model"
    assert texts() == []


@over_ros
def test_of_several_robots_the_one_already_followed_stays(graph: Graph, texts: Callable[[], list[str]]) -> None:
    assert graph.look("model", serving="model") == "model"
    assert graph.look("another", "model", serving="another model", times=3) == "model"
    assert texts() == ["2 robots share this namespace: give each its own with --namespace; model is followed"]


@over_ros
@pytest.mark.parametrize("still_publishes", [True, False])
def test_another_robot_is_followed_when_the_first_is_gone(
    graph: Graph, texts: Callable[[], list[str]], *, still_publishes: bool
) -> None:
    graph.look("another", "model", serving="another model")
    publishers = ("another", "model") if still_publishes else ("model",)
    assert graph.look(*publishers, serving="model") == "model"
    assert "another no longer publishes mode and offers ~/stop: model is followed" in texts()


@over_ros
def test_one_that_is_gone_stays_followed_where_nobody_else_offers_stop(graph: Graph) -> None:
    graph.look("model", serving="model")
    assert graph.look("another", serving="", times=3) == "model"
    assert graph.look(serving="", times=3) == "model"


@over_ros
def test_second_publisher_is_reported_again_when_it_comes_back(graph: Graph, texts: Callable[[], list[str]]) -> None:
    for publishers in [("model", "another"), ("model",), ("model", "another")]:
        graph.look(*publishers, serving="model")
    assert len(texts()) == 2


@over_ros
@pytest.mark.parametrize("name", ["n" * 255, "n" * 240, "n" * 239, "0n", "n n", "n\u00e9", "{n}", "n\n"])
def test_a_name_that_no_robot_can_have_offers_no_stop_and_keeps_none_from_being_followed(
    graph: Graph, texts: Callable[[], list[str]], name: str
) -> None:
    assert graph.look("model", name, serving="model", times=3) == "model"
    assert texts() == [f"{name} publishes mode in this namespace and offers no {STOP}: it is not followed; end it"]


@over_ros
def test_a_node_with_room_for_stop_alone_in_its_name_is_not_followed(graph: Graph) -> None:
    name = "n" * 239
    assert checked(f"/a/{name}/stop", is_service=True)
    assert graph.look(name, serving=name) == ""
    assert graph.look(name[:232], serving=name[:232]) == name[:232]


@over_ros
def test_a_namespace_that_fails_is_reported_once_and_the_others_are_followed(
    graph: Graph, texts: Callable[[], list[str]]
) -> None:
    graph.failing = ["/Z", "/b"]
    assert graph.look("model", serving="model", times=5) == "model"
    failed = "it is not known who is to be followed in this namespace: RuntimeError: DDS failed"
    assert texts() == [failed, failed]
    graph.failing = []
    graph.look("model", serving="model")
    graph.failing = ["/b"]
    graph.look("model", serving="model", times=2)
    assert texts() == [failed, failed, failed]
