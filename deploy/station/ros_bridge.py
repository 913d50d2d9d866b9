# SPDX-License-Identifier: MIT
"""All robots over ROS: discovers them, receives their messages, and sends them heartbeats."""

import itertools
from collections.abc import Callable, Mapping
from typing import Final

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.discovery import MODE_TOPIC, MOST_ROBOTS, robots_in, topic
from segway_ecc.deploy.station.events import EventLog
from segway_ecc.deploy.station.heartbeats import Heartbeats
from segway_ecc.deploy.station.ros_connection import RosRobotConnection
from segway_ecc.node.ros.untyped import RosObject

_DISCOVER_EVERY_NS: Final = 500_000_000
_FLUSH_NS: Final = 500_000_000
_UNKNOWN: Final = "_NODE_NAME_UNKNOWN_"
"""The graph's name of a node of which only a topic was discovered yet."""


class RosBridge:
    """Belongs to the ROS thread.

    Attributes:
        connections: The connection to each robot, by namespace.
    """

    def __init__(
        self,
        handler: CommandHandler,
        beats: Heartbeats | None,
        clock_ns: Callable[[], int],
        wall_ns: Callable[[], int],
        events: EventLog,
    ) -> None:
        """Pass what is received to `handler`; send `beats`, or none where it only watches."""
        self.connections: dict[str, RosRobotConnection] = {}
        self._handler = handler
        self._beats = beats
        self._clock_ns = clock_ns
        self._wall_ns = wall_ns
        self._events = events
        self._node: RosObject = None
        self._polled_ns = clock_ns()
        self._discovered_ns = -_DISCOVER_EVERY_NS
        self._turns = itertools.count()
        self._shared: set[str] = set()
        self._is_full = False

    @property
    def is_waiting(self) -> bool:
        """Whether a report or a response of some robot is awaited."""
        return any(map(self._handler.is_waiting_for, self.connections))

    def use(self, node: RosObject) -> None:
        """Use `node` from now on."""
        self._node = node

    def poll(self, *, everything: bool) -> None:
        """Pass on everything that has arrived; or only responses and modes of the robots that are waited for."""
        now_ns, wall_ns = self._clock_ns(), self._wall_ns()
        since_ns = now_ns - self._polled_ns
        for name, connection in self.connections.items():
            if not (everything or self._handler.is_waiting_for(name)):
                continue
            self._handler.receive_responses(name)
            others = connection.take_others() if everything else ()
            for received in itertools.chain(connection.take_modes(), others):
                # It arrived after the last poll, whatever the wall clock did.
                at_ns = now_ns - min(max(wall_ns - received.wall_ns, 0), since_ns)
                self._handler.on_message(name, received.message, at_ns)
        if everything:
            self._polled_ns = now_ns

    def flush(self) -> None:
        """Wait until what was sent has arrived, before the node that sent it ends; for half a second at most."""
        deadline_ns = self._clock_ns() + _FLUSH_NS
        for connection in self.connections.values():
            connection.flush(max(deadline_ns - self._clock_ns(), 0))

    def beat(self, now_ns: int) -> None:
        """Send a heartbeat to every robot, where one is due."""
        stamp_ns = None if self._beats is None else self._beats.due(now_ns)
        if self._beats is not None and stamp_ns is not None:
            for connection in self.connections.values():
                connection.beat(self._beats.name, stamp_ns)

    def discover(self, now_ns: int) -> None:
        """Follow robots that come and go in the graph; of those that are alive, one is checked each time."""
        if now_ns - self._discovered_ns < _DISCOVER_EVERY_NS:
            return
        self._discovered_ns = now_ns
        names = robots_in(self._node.get_topic_names_and_types())
        turn = names[next(self._turns) % len(names)] if names else ""
        for name in names:
            robot = self._handler.fleet.robots.get(name)
            if robot is None or not robot.is_alive or name == turn:
                self._follow(name)

    def refused(self) -> Mapping[str, int]:
        """How many messages of robots were not valid."""
        count = sum(connection.refused for connection in self.connections.values())
        return {"message: malformed": count} if count else {}

    def _follow(self, name: str) -> None:
        """Connect to a robot, or to the node that publishes its `mode` now."""
        peers = self._node.get_publishers_info_by_topic(topic(name, MODE_TOPIC))
        nodes = sorted({peer.node_name for peer in peers} - {_UNKNOWN, ""})
        if not nodes:
            return
        if len(peers) == 1:
            self._shared.discard(name)
        elif name not in self._shared:
            self._shared.add(name)
            text = f"{len(peers)} robots share this namespace: give each its own with --namespace"
            self._events.add(name, text, level="error")
        connection = self.connections.get(name)
        if connection is not None:
            if connection.model_node not in nodes:
                connection.serve_by(nodes[0])
        elif len(self.connections) < MOST_ROBOTS:
            self.connections[name] = connection = RosRobotConnection(self._node, name, nodes[0])
            self._handler.add(name, connection)
        elif not self._is_full:
            self._is_full = True
            self._events.add("", f"more than {MOST_ROBOTS} robots: {name} is not followed", level="error")
