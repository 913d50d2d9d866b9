# SPDX-License-Identifier: MIT
"""Somebody in ROS beside a robot: calls its services, writes its parameters, publishes what may be wrong.

Messages and answers are taken straight from their handles, as the base station does; no executor runs.
"""

import contextlib
import time
from collections.abc import Iterator, Mapping
from typing import Final

from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.node.ros.messages import RosObject, message_type
from segway_ecc.node.ros.runtime import ros_node

_NODE: Final = "model"
_ANSWERS_WITHIN_S: Final = 10.0
_POLL_S: Final = 0.002
_DEPTH: Final = 10
_DOUBLE: Final = 3
"""The type of a floating-point parameter (rcl_interfaces/msg/ParameterType)."""


class RosClient:
    """A node of its own in the robot's namespace.

    Attributes:
        mode: The values of the newest message on `mode`.
    """

    def __init__(self, node: RosObject) -> None:
        """Use `node`."""
        self.mode: Mapping[str, str] = {}
        self._node = node
        kind = message_type("diagnostic_msgs/msg/DiagnosticStatus")
        self._modes = node.create_subscription(kind, "mode", lambda *_: None, _DEPTH)

    def wait_for_robot(self, within_s: float) -> None:
        """Wait until the robot publishes its mode, and its services are there.

        Raises:
            ProcessFailedError: They were not.
        """
        deadline = time.monotonic() + within_s
        while not self.mode:
            if time.monotonic() > deadline:
                raise ProcessFailedError("the robot is not in ROS")
            self.spin(0.1)

    def spin(self, for_s: float) -> None:
        """Receive for a while."""
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            taken = self._modes.handle.take_message(self._modes.msg_type, False)  # noqa: FBT003 - rclpy's form: not raw
            if taken is None:
                time.sleep(_POLL_S)
            else:
                self.mode = {pair.key: pair.value for pair in taken[0].values}

    def call(self, action: str) -> str:
        """Call a service of the robot's; its answer."""
        answer = self._ask("std_srvs/srv/Trigger", action, {})
        return f"{action}: {'done' if answer.success else 'refused'}: {answer.message}"

    def set_parameter(self, name: str, value: float) -> str:
        """Write a parameter; the answer."""
        parameter = message_type("rcl_interfaces/msg/Parameter")(name=name)
        parameter.value.type, parameter.value.double_value = _DOUBLE, value
        answer = self._ask("rcl_interfaces/srv/SetParameters", "set_parameters", {"parameters": [parameter]})
        (result,) = answer.results
        return f"{name}: {'done' if result.successful else 'refused'}: {result.reason}"

    def publish(self, type_name: str, topic: str, times: int, **fields: object) -> int:
        """Publish a message some times, a tenth of a second apart; when the first left, monotonic, ns."""
        publisher = self._node.create_publisher(message_type(type_name), topic, _DEPTH)
        self.spin(1.0)  # until it is discovered
        message = publisher.msg_type(**fields)
        now_ns = time.monotonic_ns()
        for _ in range(times):
            publisher.publish(message)
            self.spin(0.1)
        self._node.destroy_publisher(publisher)
        return now_ns

    def _ask(self, type_name: str, service: str, fields: Mapping[str, object]) -> RosObject:
        kind, number = message_type(type_name), None
        client = self._node.create_client(kind, f"{_NODE}/{service}")
        deadline = time.monotonic() + _ANSWERS_WITHIN_S
        try:
            while time.monotonic() < deadline:
                if number is None and client.service_is_ready():
                    number = client.handle.send_request(kind.Request(**fields))
                header, response = (None, None) if number is None else client.handle.take_response(kind.Response)
                if header is not None:
                    return response
                time.sleep(_POLL_S)
        finally:
            self._node.destroy_client(client)
        raise ProcessFailedError(f"the robot's service {service} did not answer within {_ANSWERS_WITHIN_S:g} s")


@contextlib.contextmanager
def ros_client(namespace: str) -> Iterator[RosClient]:
    """One that lives as long as the context."""
    with ros_node("somebody", namespace) as node:
        yield RosClient(node)
