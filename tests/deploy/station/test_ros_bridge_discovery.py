# SPDX-License-Identifier: MIT
"""Which robots the station finds in the graph, and whose services it calls, with a graph that a test makes."""

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


class Graph:
    """Who publishes `mode` of the robot `/a`, and who offers `~/stop` there, as the bridge sees it in 0.5 s steps."""

    def __init__(self, events: EventLog) -> None:
        self.publishers: list[str] = []
        self.serving: set[str] = set()
        node = MagicMock()
        node.get_topic_names_and_types = lambda: [("/a/mode", [MODE_TYPE])] if self.publishers else []
        node.get_publishers_info_by_topic = lambda _: [SimpleNamespace(node_name=name) for name in self.publishers]
        node.count_services = lambda name: sum(name == f"/a/{node}/stop" for node in self.serving)
        self.bridge = RosBridge(CommandHandler(events, Heartbeats("base"), Setpoint(3.0, 6.0)), None, events)
        self.bridge.use(node)
        self._now_ns = 0

    def look(self, *publishers: str, serving: str, times: int = 1) -> str:
        """Who is followed after some looks; empty where nobody is."""
        self.publishers, self.serving = list(publishers), set(serving.split())
        for _ in range(times):
            self._now_ns += 500_000_000
            self.bridge.discover(self._now_ns)
        connection = self.bridge.connections.get("/a")
        return "" if connection is None else connection.model_node


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
