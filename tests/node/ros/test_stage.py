# SPDX-License-Identifier: MIT
"""What the stage publishes of a cycle and when, with a node that only remembers."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from segway_ecc.node.config import RosSection
from segway_ecc.node.cycle.interfaces import Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST
from segway_ecc.node.cycle.wiring import PUBLISHED_SIGNALS
from segway_ecc.node.ros.protocol import RosSettings
from segway_ecc.node.ros.stage import RosStage
from segway_ecc.node.safety.modes import Mode

pytestmark = pytest.mark.ros

TOPICS = ["mode", "setpoint", "linear_velocity", "angular_velocity", "position", "odom", "joint_states", "imu/data"]
TOPICS += ["battery_state", "track"]
SETTINGS = RosSettings(
    robot="alice",
    ros=RosSection(),
    namespace="",
    ros_arguments=(),
    period_ns=10_000_000,
    published=tuple(PUBLISHED_SIGNALS),
    topics=("track",),
    set_names=(),
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
        self.stage = RosStage(node, SETTINGS, lambda _name, _value: None)

    def _create_publisher(self, _kind: type, topic: str, _depth: int) -> SimpleNamespace:
        return SimpleNamespace(
            publish=lambda _: self._published.append(topic),
            get_subscription_count=lambda: int(topic in self.subscribers),
        )

    def topics_published_in(self, cycle: int) -> list[str]:
        """The topics on which this cycle is published."""
        applied = StampedSetpoint(REST, cycle)
        values = [1.0] * len(PUBLISHED_SIGNALS)
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
