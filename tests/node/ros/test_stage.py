"""What the stage tells of a cycle, and whom it tells nothing, in a node that only remembers."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from segway_ecc.node.config import RosSection
from segway_ecc.node.cycle.seams import Report, StampedSetpoint
from segway_ecc.node.cycle.setpoints import REST
from segway_ecc.node.cycle.wiring import PUBLISHED_SIGNALS
from segway_ecc.node.ros.protocol import RosSettings
from segway_ecc.node.ros.stage import RosStage
from segway_ecc.node.safety.modes import Mode

pytestmark = pytest.mark.ros

TOPICS = ["mode", "setpoint", "linear_velocity", "angular_velocity", "position", "odom", "joint_states", "imu/data"]
TOPICS += ["battery_state", "track"]
JOB = RosSettings(
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
        self._told: list[str] = []
        node = MagicMock()
        node.create_publisher = self._create_publisher
        self.stage = RosStage(node, JOB, lambda _name, _value: None)

    def _create_publisher(self, _kind: type, topic: str, _depth: int) -> SimpleNamespace:
        return SimpleNamespace(
            publish=lambda _: self._told.append(topic), get_subscription_count=lambda: int(topic in self.subscribers)
        )

    def told_of(self, cycle: int) -> list[str]:
        """The topics on which something is told of this cycle."""
        applied = StampedSetpoint(REST, cycle)
        values = [1.0] * len(PUBLISHED_SIGNALS)
        self.stage.publish(Report(cycle * 10**9, Mode.ARMED, values, applied, topics=(0.3,), cycle=cycle))
        told, self._told = self._told, []
        return told


def test_what_nobody_subscribes_to_is_not_told() -> None:
    graph = Graph()
    assert not graph.stage.look_who_listens()
    assert graph.told_of(1) == []


@pytest.mark.parametrize("topic", TOPICS)
def test_who_subscribes_is_told_from_the_next_look_on_until_it_leaves_and_nobody_else_is(topic: str) -> None:
    graph = Graph()
    graph.stage.look_who_listens()
    graph.subscribers.add(topic)
    assert graph.told_of(1) == []
    assert graph.stage.look_who_listens()
    assert graph.told_of(2) == [topic]
    graph.subscribers.clear()
    assert not graph.stage.look_who_listens()
    assert graph.told_of(3) == []


def test_with_all_subscribed_to_the_mode_comes_first() -> None:
    graph = Graph()
    graph.subscribers = set(TOPICS)
    graph.stage.look_who_listens()
    assert graph.told_of(1) == TOPICS
