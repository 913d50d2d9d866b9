"""All robots over ROS: finds them, listens to them, and sends them heartbeats."""

import itertools
from collections.abc import Callable, Mapping
from typing import Final

from segway_ecc.deploy.station.command_handler import CommandHandler
from segway_ecc.deploy.station.discovery import MODE_TOPIC, MOST_ROBOTS, robots_in, topic
from segway_ecc.deploy.station.events import EventLog
from segway_ecc.deploy.station.heartbeats import Heartbeats
from segway_ecc.deploy.station.ros_connection import ReceivedMessage, RosRobotConnection
from segway_ecc.node.ros.untyped import RosObject

_LOOK_EVERY_NS: Final = 500_000_000
_FLUSH_NS: Final = 500_000_000
_UNKNOWN: Final = "_NODE_NAME_UNKNOWN_"
"""What the graph says of a node of which only a topic was discovered yet."""


class RosBridge:
    """Belongs to the thread that speaks ROS.

    Attributes:
        lines: The connection to each robot, by namespace.
    """

    def __init__(
        self,
        desk: CommandHandler,
        beats: Heartbeats | None,
        clock_ns: Callable[[], int],
        wall_ns: Callable[[], int],
        events: EventLog,
    ) -> None:
        """Bring what is heard to `desk`; send `beats`, or none where it only looks."""
        self.lines: dict[str, RosRobotConnection] = {}
        self._desk = desk
        self._beats = beats
        self._clock_ns = clock_ns
        self._wall_ns = wall_ns
        self._events = events
        self._node: RosObject = None
        self._listened_ns = clock_ns()
        self._looked_ns = -_LOOK_EVERY_NS
        self._turns = itertools.count()
        self._shared: set[str] = set()
        self._is_full = False

    @property
    def is_waiting(self) -> bool:
        """Whether some robot's word is waited for."""
        return any(self._desk.is_waiting_for(name) for name in self.lines)

    def use(self, node: RosObject) -> None:
        """Speak through `node`."""
        self._node = node

    def listen(self, *, to_all: bool) -> None:
        """Hear all robots; or of those whose word is waited for only what is waited for."""
        now_ns, wall_ns = self._clock_ns(), self._wall_ns()
        for name, line in self.lines.items():
            if not (to_all or self._desk.is_waiting_for(name)):
                continue
            self._desk.hear_answers(name)
            for taken in line.hear_mode():
                self._desk.hear(name, taken.heard, self._heard_ns(taken, now_ns, wall_ns))
            if to_all:
                for taken in line.hear():
                    self._desk.hear(name, taken.heard, self._heard_ns(taken, now_ns, wall_ns))
        if to_all:
            self._listened_ns = now_ns

    def flush(self) -> None:
        """Wait until what was sent has arrived, before the node that sent it ends; for half a second at most."""
        deadline_ns = self._clock_ns() + _FLUSH_NS
        for line in self.lines.values():
            line.flush(max(deadline_ns - self._clock_ns(), 0))

    def beat(self, now_ns: int) -> None:
        """Send a heartbeat to every robot, where one is due."""
        stamp_ns = None if self._beats is None else self._beats.due(now_ns)
        if self._beats is not None and stamp_ns is not None:
            for line in self.lines.values():
                line.beat(self._beats.name, stamp_ns)

    def discover(self, now_ns: int) -> None:
        """Look at the graph now and then: robots come and go."""
        if now_ns - self._looked_ns < _LOOK_EVERY_NS:
            return
        self._looked_ns = now_ns
        names = robots_in(self._node.get_topic_names_and_types())
        turn = names[next(self._turns) % len(names)] if names else ""
        for name in names:
            robot = self._desk.fleet.robots.get(name)
            if robot is None or not robot.is_alive or name == turn:
                self._look_at(name)

    def refused(self) -> Mapping[str, int]:
        """Messages of robots that were not as they must be."""
        count = sum(line.refused for line in self.lines.values())
        return {"message: malformed": count} if count else {}

    def _look_at(self, name: str) -> None:
        peers = self._node.get_publishers_info_by_topic(topic(name, MODE_TOPIC))
        nodes = sorted({peer.node_name for peer in peers} - {_UNKNOWN, ""})
        if not nodes:
            return
        self._tell_shared(name, len(peers))
        line = self.lines.get(name)
        if line is not None:
            if line.model_node not in nodes:
                line.serve_by(nodes[0])
        elif len(self.lines) < MOST_ROBOTS:
            self.lines[name] = line = RosRobotConnection(self._node, name, nodes[0])
            self._desk.add(name, line)
        elif not self._is_full:
            self._is_full = True
            self._events.add("", f"more than {MOST_ROBOTS} robots: {name} is not followed", level="error")

    def _tell_shared(self, name: str, count: int) -> None:
        if count > 1 and name not in self._shared:
            self._events.add(
                name, f"{count} robots share this namespace: give each its own with --namespace", level="error"
            )
            self._shared.add(name)
        elif count == 1:
            self._shared.discard(name)

    def _heard_ns(self, taken: ReceivedMessage, now_ns: int, wall_ns: int) -> int:
        """When a message reached us by the monotonic clock: after we last listened, whatever the wall clock did."""
        return now_ns - min(max(wall_ns - taken.wall_ns, 0), now_ns - self._listened_ns)
