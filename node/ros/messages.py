# SPDX-License-Identifier: MIT
"""Filling standard messages from plain values."""

import importlib
from collections.abc import Sequence
from typing import Final

from segway_ecc.node.cycle.status import DiagnosticStatus
from segway_ecc.node.ros.untyped import RosObject

NS_PER_S: Final = 1_000_000_000


def message_type(name: str) -> RosObject:
    """The class of a message or service type such as `geometry_msgs/msg/Twist`."""
    package, kind, type_name = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), type_name)


def newest_only() -> RosObject:
    """Quality of service for what only the newest of matters: a lost message is not sent again."""
    qos = importlib.import_module("rclpy.qos")
    return qos.QoSProfile(depth=1, reliability=qos.ReliabilityPolicy.BEST_EFFORT)


def set_stamp(header: RosObject, stamp_ns: int) -> None:
    """Write a stamp, ns since the Unix epoch, into a std_msgs/Header."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)


def stamp_ns(header: RosObject) -> int:
    """The stamp of a std_msgs/Header, ns since the Unix epoch."""
    return int(header.stamp.sec) * NS_PER_S + int(header.stamp.nanosec)


def diagnostic_array(statuses: Sequence[DiagnosticStatus], stamp_ns: int) -> RosObject:
    """A diagnostic_msgs/DiagnosticArray."""
    array = message_type("diagnostic_msgs/msg/DiagnosticArray")()
    set_stamp(array.header, stamp_ns)
    key_value, kind = message_type("diagnostic_msgs/msg/KeyValue"), message_type("diagnostic_msgs/msg/DiagnosticStatus")
    for status in statuses:
        values = [key_value(key=key, value=value) for key, value in status.values.items()]
        level = bytes((status.level,))
        array.status.append(kind(level=level, name=status.name, message=status.message, values=values))
    return array


def duration(seconds: float) -> RosObject:
    """An rclpy Duration."""
    return importlib.import_module("rclpy.duration").Duration(seconds=seconds)
