# SPDX-License-Identifier: MIT
"""What the machine is and how fit it is: software, real-time limits, disk space, load, CAN interfaces, messages."""

import contextlib
import importlib.metadata
import importlib.util
import os
import platform
import resource
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.deploy.support.bundle import Collected, json_text
from segway_ecc.deploy.support.commands import NoAnswerError, answer_of
from segway_ecc.deploy.support.secrets import environment

_LIMITS: Final = {
    "real-time priority": resource.RLIMIT_RTPRIO,
    "locked memory, bytes": resource.RLIMIT_MEMLOCK,
    "niceness": resource.RLIMIT_NICE,
    "open files": resource.RLIMIT_NOFILE,
    "core file, bytes": resource.RLIMIT_CORE,
}
_FACTS: Final = (
    "/sys/kernel/realtime",
    "/proc/sys/kernel/sched_rt_runtime_us",
    "/proc/sys/kernel/sched_rt_period_us",
    "/proc/sys/net/core/rmem_max",
    "/proc/sys/net/core/wmem_max",
    "/sys/devices/system/cpu/isolated",
    "/sys/devices/system/cpu/online",
    "/sys/devices/system/clocksource/clocksource0/current_clocksource",
    "/proc/cmdline",
    "/proc/loadavg",
    "/proc/uptime",
    "/proc/meminfo",
    "/proc/cpuinfo",
)
_MANY_FACTS: Final = (
    "devices/system/cpu/cpu*/cpufreq/scaling_governor",
    "class/thermal/thermal_zone*/temp",
)
_LONGEST_FACT: Final = 64 * 1024
_LINES: Final = 2000
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


def real_time() -> Collected:
    """What this process may ask of the kernel, and how the kernel is set."""
    limits = {
        name: ["unlimited" if value == resource.RLIM_INFINITY else value for value in resource.getrlimit(which)]
        for name, which in _LIMITS.items()
    }
    paths = [Path(path) for path in _FACTS]
    paths += [path for pattern in _MANY_FACTS for path in sorted(Path("/sys").glob(pattern))]
    facts = {}
    for path in paths:
        with contextlib.suppress(OSError), path.open("rb") as stream:
            facts[str(path)] = stream.read(_LONGEST_FACT).decode("utf-8", "replace").strip()
    found = {"limits, soft and hard": limits, "cpus we may use": sorted(os.sched_getaffinity(0)), "facts": facts}
    return Collected({"machine.json": json_text(found)})


def disks(folders: Sequence[Path]) -> Collected:
    """Space where things are kept, bytes."""
    found, missing = {}, []
    for folder in dict.fromkeys([Path("/"), *folders]):
        try:
            usage = shutil.disk_usage(folder)
            found[str(folder)] = {"total": usage.total, "used": usage.used, "free": usage.free}
        except OSError as error:
            missing.append(f"{folder}: {error.strerror}")
    return Collected({"disks.json": json_text(found)}, missing)


def can_interfaces() -> Collected:
    """Every network interface with its state and counters, CAN's among them."""
    return Collected({"interfaces.txt": answer_of(("ip", "-details", "-statistics", "link"))})


def journal(lines: int = _LINES) -> Collected:
    """The newest messages of our services and of the kernel."""
    asked = {
        "messages.txt": ("--unit", "segway-ecc*"),
        "kernel.txt": ("--dmesg",),
    }
    files, missing = {}, []
    for name, words in asked.items():
        try:
            text = answer_of(
                ("journalctl", "--quiet", "--no-pager", f"--lines={lines}", "--output=short-iso-precise", *words)
            )
        except NoAnswerError as error:
            missing.append(f"{name}: {error}")
            continue
        if text.strip():
            files[name] = text
        else:
            missing.append(f"{name}: the journal has none, or does not show them to this user")
    return Collected(files, list(dict.fromkeys(missing)))
