# SPDX-License-Identifier: MIT
"""What the robot logs in ROS: rosout, where rqt_console, Foxglove and `ros2 topic echo /rosout` show it."""

import importlib
import time
from typing import Final

from segway_ecc.node.cycle.interfaces import Report
from segway_ecc.node.cycle.report import MODE_LEVELS, state_text
from segway_ecc.node.cycle.status import Level
from segway_ecc.node.ros.messages import NS_PER_S, RosObject, duration, message_type

_TOPIC: Final = "/rosout"
_DEPTH: Final = 1000
_KEPT_S: Final = 10.0
"""As rcl has it."""
_LEVELS: Final = {Level.OK: 20, Level.WARN: 30, Level.ERROR: 40, Level.STALE: 30}
"""INFO, WARN and ERROR of rcl_interfaces/msg/Log."""
_PERIOD_NS: Final = 100_000_000
"""Modes that change faster are logged no more often: no flicker floods the log."""


class RosLog:
    """Publishes lines on `/rosout`; not the node's own logger, which would print them on the console, too.

    Attributes:
        publisher: What publishes them.
    """

    def __init__(self, node: RosObject) -> None:
        """Log as `node`."""
        qos = importlib.import_module("rclpy.qos")
        profile = qos.QoSProfile(
            depth=_DEPTH, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL, lifespan=duration(_KEPT_S)
        )
        self._kind = message_type("rcl_interfaces/msg/Log")
        self.publisher = node.create_publisher(self._kind, _TOPIC, profile)
        self._name = f"{node.get_namespace()}/{node.get_name()}".strip("/").replace("/", ".")
        self._state: tuple[object, ...] = ()
        self._turn = -1

    def write(self, level: Level, text: str, stamp_ns: int | None = None) -> None:
        """Log a line, now or at a stamp, ns since the Unix epoch."""
        message = self._kind(level=_LEVELS[level], name=self._name, msg=text)
        message.stamp.sec, message.stamp.nanosec = divmod(time.time_ns() if stamp_ns is None else stamp_ns, NS_PER_S)
        self.publisher.publish(message)

    def log_mode(self, report: Report) -> None:
        """Log the mode and the posture, with the reason, where they have changed."""
        state = report.mode, report.posture, report.reason
        turn = report.stamp_ns // _PERIOD_NS
        if state == self._state or turn == self._turn:
            return
        self._state, self._turn = state, turn
        level = MODE_LEVELS.get(report.mode, Level.OK)
        self.write(level, f"{state_text(report.mode, report.posture)}: {report.reason}", report.stamp_ns)
