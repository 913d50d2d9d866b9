# SPDX-License-Identifier: MIT
"""Which robots the ROS graph shows: every namespace with a topic `mode` of the type that ours has."""

from collections.abc import Iterable, Sequence
from typing import Final

MODE_TOPIC: Final = "mode"
MODE_TYPE: Final = "diagnostic_msgs/msg/DiagnosticStatus"
MOST_ROBOTS: Final = 100
"""More than these are not followed: the graph belongs to whoever is on the network."""


def robots_in(topics: Iterable[tuple[str, Sequence[str]]]) -> list[str]:
    """The namespaces of the robots among topics with their types, sorted: `/` or `/alice`."""
    ending = f"/{MODE_TOPIC}"
    return sorted(
        name.removesuffix(ending) or "/" for name, types in topics if name.endswith(ending) and MODE_TYPE in types
    )


def topic(robot: str, name: str) -> str:
    """The full name of a robot's topic."""
    return f"{robot.rstrip('/')}/{name}"
