"""Which software this is."""

import importlib.metadata
import importlib.util
import os
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from segway_ecc.deploy.support.bundle import Collected, json_text
from segway_ecc.deploy.support.secrets import environment

_ROS_PACKAGES: Final = ("rclpy", "rmw_fastrtps_cpp", "rmw_cyclonedds_cpp", "std_msgs", "diagnostic_msgs")


def versions() -> Collected:
    """Ours, Python's, the kernel's, every library's and ROS'."""
    try:
        system = platform.freedesktop_os_release().get("PRETTY_NAME", "unknown")
    except OSError:
        system = "unknown"
    found = {
        "segway-ecc": importlib.metadata.version("segway-ecc"),
        "python": sys.version,
        "kernel": f"{platform.system()} {platform.release()} {platform.version()}",
        "machine": platform.machine(),
        "system": system,
        "ros": _ros(os.environ),
        "libraries": dict(sorted({each.name: each.version for each in importlib.metadata.distributions()}.items())),
    }
    return Collected({"versions.json": json_text(found)})


def variables() -> Collected:
    """Of the environment what concerns us."""
    return Collected({"environment.json": json_text(environment(os.environ))})


def _ros(variables: Mapping[str, str]) -> dict[str, str]:
    found = {name: variables[name] for name in ("ROS_DISTRO", "RMW_IMPLEMENTATION") if name in variables}
    for prefix in variables.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        for package in _ROS_PACKAGES:
            path = Path(prefix) / "share" / package / "package.xml"
            if prefix and path.is_file():
                text = path.read_text("utf-8", "replace")
                found.setdefault(package, text.partition("<version>")[2].partition("</version>")[0])
    spec = importlib.util.find_spec("rclpy")
    found["rclpy is"] = "not here" if spec is None else str(spec.origin)
    return found
