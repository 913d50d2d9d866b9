# SPDX-License-Identifier: MIT
"""The ROS graph: which nodes a topic connects, and which it cannot because types or QoS differ."""

from dataclasses import dataclass
from typing import Final

from segway_ecc.node.ros.untyped import RosObject

_ROS_OWN: Final = ("/rosout", "/parameter_events")


@dataclass(frozen=True, slots=True)
class Connection:
    """A topic with one node at each end; `subscriber` is empty where there is none, so is `publisher`."""

    publisher: str
    topic: str
    type_name: str
    subscriber: str


def connections(node: RosObject, namespace: str) -> list[Connection]:
    """Every topic below `namespace` with its ends, sorted."""
    found = set()
    for topic, type_names in node.get_topic_names_and_types():
        if topic in _ROS_OWN or not topic.startswith(namespace.rstrip("/") + "/"):
            continue
        publishers = [_full_name(info) for info in node.get_publishers_info_by_topic(topic)] or [""]
        subscribers = [_full_name(info) for info in node.get_subscriptions_info_by_topic(topic)] or [""]
        found |= {Connection(p, topic, t, s) for t in type_names for p in publishers for s in subscribers}
    return sorted(found, key=lambda c: (c.topic, c.publisher, c.subscriber, c.type_name))


def mismatch(topic: str, ours: str, peer: RosObject) -> str | None:
    """Why a publisher never reaches our reliable subscription, with the fix; None where it does.

    Args:
        topic: The topic.
        ours: The type we take.
        peer: The publisher's TopicEndpointInfo.
    """
    if peer.topic_type != ours:
        return (
            f"{_full_name(peer)} publishes {peer.topic_type} on {topic}, which takes {ours}: they never meet. "
            f"Publish {ours}, or remap it away"
        )
    if peer.qos_profile.reliability.name == "BEST_EFFORT":
        return (
            f"{_full_name(peer)} publishes {topic} best-effort, and we ask for reliable: they never meet. "
            "Set its reliability to reliable"
        )
    return None


def _full_name(info: RosObject) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"
