# SPDX-License-Identifier: MIT
"""The ROS side of a robot's archive: hands out pieces when they are asked for, and no faster than is good for others.

The parameters are described in `segway_ecc.deploy.support.pieces`.
"""

import importlib
import time
from collections.abc import Callable
from typing import Final

from segway_ecc.deploy.support.pieces import Value, piece_of, words_of
from segway_ecc.node.ros.messages import RosObject, message_type

SERVICE: Final = "get_parameters"
_MOST_NAMES: Final = 4
_LONGEST_NAME: Final = 300
_LOOK_S: Final = 0.1
_STRING: Final = 4
_INTEGERS: Final = 7
_STRINGS: Final = 9
"""rcl_interfaces/msg/ParameterType."""


class ArchiveServer:
    """Answers requests for parameters, in a loop of its own."""

    def __init__(self, node: RosObject, answer: Callable[[str], Value], bytes_per_s: float) -> None:
        """Answer through `node`, which has no parameter services of its own.

        Args:
            node: Who answers.
            answer: What the value of a parameter is.
            bytes_per_s: How much may leave in a second.
        """
        executors = importlib.import_module("rclpy.executors")
        self._answer = answer
        self._bytes_per_s = bytes_per_s
        self._owed_s = 0.0
        self._value_type = message_type("rcl_interfaces/msg/ParameterValue")
        service_type = message_type("rcl_interfaces/srv/GetParameters")
        node.create_service(service_type, f"~/{SERVICE}", self._serve)
        self._executor = executors.SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Answer until `stopped`, which is asked often, is true."""
        while not stopped():
            self._executor.spin_once(timeout_sec=_LOOK_S)
            # Whatever was sent is waited for before the next request is even looked at, whoever's it is.
            while self._owed_s > 0.0 and not stopped():
                pause_s = min(self._owed_s, _LOOK_S)
                time.sleep(pause_s)
                self._owed_s -= pause_s
        self._executor.shutdown()

    def _serve(self, request: RosObject, response: RosObject) -> RosObject:
        response.values = [self._value_type() for _ in request.names]
        for name, value in zip(request.names[:_MOST_NAMES], response.values, strict=False):
            answer = self._answer(name) if len(name) <= _LONGEST_NAME else None
            if isinstance(answer, bytes):
                self._owed_s += len(answer) / self._bytes_per_s
                value.type, value.integer_array_value = _INTEGERS, words_of(answer)
            elif isinstance(answer, str):
                value.type, value.string_value = _STRING, answer
            elif answer is not None:
                value.type, value.string_array_value = _STRINGS, [str(line) for line in answer]
                self._owed_s += sum(len(line) for line in value.string_array_value) / self._bytes_per_s
        return response


def value_of(value: RosObject) -> Value:
    """What a `rcl_interfaces/msg/ParameterValue` holds; None for a type that no archive sends."""
    if value.type == _STRING:
        return str(value.string_value)
    if value.type == _STRINGS:
        return list(value.string_array_value)
    return piece_of(value.integer_array_value) if value.type == _INTEGERS else None
