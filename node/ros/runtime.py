# SPDX-License-Identifier: MIT
"""Starting and leaving ROS 2, and reporting where it is not there."""

import contextlib
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from typing import Final

from segway_ecc.node.errors import RosUnavailableError
from segway_ecc.node.ros.transports import udp_only
from segway_ecc.node.ros.untyped import RosObject

_MODULES: Final = (
    "rclpy.node",
    "geometry_msgs.msg",
    "nav_msgs.msg",
    "sensor_msgs.msg",
    "std_msgs.msg",
    "std_srvs.srv",
    "diagnostic_msgs.msg",
)
_GENERATORS: Final = "rosidl_generator_py.generate_py_impl"
"""Makes Python of message definitions, for which a package that every message needs imports parsers: 6 MB, 50 ms."""
_NEEDED: Final = tuple(name.partition(".")[0] for name in _MODULES)


def missing_packages() -> list[str]:
    """The ROS packages that cannot be found here; empty where ROS is usable."""
    return [name for name in _NEEDED if importlib.util.find_spec(name) is None]


def require_ros() -> None:
    """Make sure that ROS is there.

    Raises:
        RosUnavailableError: With what is missing and how to get it.
    """
    missing = missing_packages()
    if missing:
        raise RosUnavailableError(
            f"ROS 2 is not available here (no {', '.join(missing)}): source an installation "
            "(. /opt/ros/jazzy/setup.sh), or on x86_64 install 'segway-ecc[ros]'. Everything but the ROS stage "
            "works without it: run with --no-ros"
        )


def preload() -> None:
    """Import ROS, which takes longer than all else that starts.

    Raises:
        RosUnavailableError: ROS is not there or cannot be imported.
    """
    require_ros()
    try:
        for name in _MODULES:
            importlib.import_module(name)
    except ImportError as error:
        raise RosUnavailableError(f"ROS 2 does not start: {error}") from error


@contextlib.contextmanager
def ros_node(
    name: str, namespace: str, ros_arguments: Sequence[str] = (), *, parameters: bool = False
) -> Iterator[RosObject]:
    """A ROS node of its own context, without signal handlers of ROS' own.

    Args:
        name: Name of the node.
        namespace: Its namespace; relative topic names live in it.
        ros_arguments: What followed `--ros-args` on the command line, that flag included.
        parameters: Whether it offers the parameter services; the caller has to serve them.

    Raises:
        RosUnavailableError: ROS is not there or does not start.
    """
    require_ros()
    rclpy = importlib.import_module("rclpy")
    signals = importlib.import_module("rclpy.signals")
    context = rclpy.context.Context()
    no_signals = signals.SignalHandlerOptions.NO
    sys.modules.setdefault(_GENERATORS, None)  # type: ignore[arg-type]  # is not to be had; the package goes on without
    try:
        with udp_only():
            rclpy.init(args=list(ros_arguments), context=context, signal_handler_options=no_signals)
            node = rclpy.create_node(
                name,
                namespace=namespace or None,
                context=context,
                start_parameter_services=parameters,
                enable_rosout=False,
                # No executor would ever answer it.
                parameter_overrides=[rclpy.Parameter("start_type_description_service", value=False)],
            )
    except Exception as error:  # rclpy raises whatever its C++ core does
        raise RosUnavailableError(f"ROS 2 does not start: {error}") from error
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def discovery_text() -> str:
    """The settings that decide whom ROS finds, for error messages."""
    names = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
    found = [f"{name}={os.environ[name]}" for name in names if name in os.environ]
    return ", ".join(found) or "no discovery setting in the environment: domain 0, the whole subnet"
