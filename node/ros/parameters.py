# SPDX-License-Identifier: MIT
"""The model's parameters as ROS parameters; it is the loop that writes them, between two steps."""

import importlib
import re
from collections.abc import Callable, Collection, Sequence

from segway_ecc.node.errors import ModelError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.ros.messages import RosObject, message_type

_EFFECT = {
    Write.NOW: "a write takes effect at the next step",
    Write.STATIC: "a write takes effect at the next step, through the static equations",
    Write.RESET: "a write takes effect when the model is initialized again",
    Write.NEVER: "cannot be written while the robot runs",
}


class ModelParameters:
    """Declares a model's parameters on a node and serves the node's parameter `services` without an executor."""

    def __init__(
        self,
        node: RosObject,
        parameters: Sequence[Variable],
        write: Callable[[str, float], None],
        own_services: Sequence[RosObject],
    ) -> None:
        """Declare them.

        Args:
            node: Whose parameters they are to be.
            parameters: Each with the value that it has now.
            write: Writes one by its name, or raises `ModelError`.
            own_services: Those of the node that are served by somebody else.
        """
        self._write = write
        self._names: dict[str, Variable] = {}
        self._result_type = message_type("rcl_interfaces/msg/SetParametersResult")
        for variable in parameters:
            name = parameter_name(variable.name, self._names)
            self._names[name] = variable
            why = f": {variable.why}" if variable.why else ""
            descriptor = message_type("rcl_interfaces/msg/ParameterDescriptor")(
                description=f"{variable.name}, {variable.unit}; {_EFFECT[variable.write]}{why}",
                read_only=variable.write is Write.NEVER,
            )
            node.declare_parameter(name, variable.value, descriptor)
        node.add_on_set_parameters_callback(self._set)
        self.services = [service for service in node.services if service not in own_services]

    def serve(self, ready: Collection[int]) -> None:
        """Answer a request of each service whose handle is at one of these pointers."""
        for service in self.services:
            if service.handle.pointer not in ready:
                continue
            request, header = service.handle.service_take_request(service.srv_type.Request)
            if request is not None:
                response = service.callback(request, service.srv_type.Response())
                service.handle.service_send_response(response, header.request_id)

    def _set(self, parameters: Sequence[RosObject]) -> RosObject:
        double = importlib.import_module("rclpy").Parameter.Type.DOUBLE
        # What ROS itself declares is let pass.
        ours = [(self._names[p.name], p) for p in parameters if p.name in self._names]
        for variable, parameter in ours:
            if parameter.type_ is not double:
                return self._result_type(successful=False, reason=f"{variable.name} takes a floating-point number")
        try:
            for variable, parameter in ours:
                self._write(variable.name, parameter.value)
        except ModelError as error:
            return self._result_type(successful=False, reason=str(error))
        return self._result_type(successful=True)


def parameter_name(name: str, taken: dict[str, Variable]) -> str:
    """A unique name of a ROS parameter: the variable's hierarchy with dots, and what ROS does not take as `_`."""
    plain = re.sub(r"[^A-Za-z0-9_.]", "_", name.replace("\\", "."))
    unique, count = plain, 1
    while unique in taken:
        count += 1
        unique = f"{plain}_{count}"
    return unique
