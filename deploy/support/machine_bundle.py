# SPDX-License-Identifier: MIT
"""The parts of a machine's support bundle: what it is and how fit it is, its messages, robot file and logs."""

import contextlib
import functools
import importlib.metadata
import importlib.util
import os
import platform
import resource
import shutil
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.deploy.support.archive_files import LogFile, logs_in, open_log
from segway_ecc.deploy.support.bundle import Collected, Content, Parts, Stored, environment, json_text
from segway_ecc.deploy.support.commands import NoAnswerError, answer_of

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
_MANY_FACTS: Final = ("devices/system/cpu/cpu*/cpufreq/scaling_governor", "class/thermal/thermal_zone*/temp")
_LONGEST_FACT: Final = 64 * 1024
_LINES: Final = 2000
_ROS_PACKAGES: Final = ("rclpy", "rmw_fastrtps_cpp", "rmw_cyclonedds_cpp", "std_msgs", "diagnostic_msgs")
_AUDIT: Final = "audit*.jsonl"
_LARGEST_AUDIT: Final = 16 * 1024 * 1024
_MIB: Final = 1024 * 1024
_MOST_LOG_BYTES: Final = 200 * 1024 * 1024


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


def journal() -> Collected:
    """The newest messages of our services and of the kernel."""
    files, missing = {}, []
    command = ("journalctl", "--quiet", "--no-pager", f"--lines={_LINES}", "--output=short-iso-precise")
    for name, words in {"messages.txt": ("--unit", "segway-ecc*"), "kernel.txt": ("--dmesg",)}.items():
        try:
            text = answer_of((*command, *words))
        except NoAnswerError as error:
            missing.append(f"{name}: {error}")
            continue
        if text.strip():
            files[name] = text
        else:
            missing.append(f"{name}: the journal has none, or does not show them to this user")
    return Collected(files, list(dict.fromkeys(missing)))


def newest_logs(folder: Path, count: int, most_bytes: int, robots: Collection[str] | None = None) -> Collected:
    """The newest logs of a folder, at most `count` and together `most_bytes`; what does not fit is named.

    They are of `robots`, by name, or of any for None.
    """
    files: dict[str, Content] = {}
    missing, left = [], most_bytes
    logs = logs_in(folder, robots)
    for log in logs[:count]:
        if log.size > left:
            size, rest = log.size / _MIB, left / _MIB
            missing.append(f"{log.name}: {size:.1f} MiB are more than the {rest:.1f} MiB that are left")
            continue
        left -= log.size
        files[f"logs/{log.name}"] = Stored(functools.partial(_descriptor, folder, log), log.size)
    if not logs and count:
        missing.append(f"there is no log in {folder}")
    return Collected(files, missing)


def audit_log(folder: Path) -> Collected:
    """A station's audit log, the newest part of it; never its tokens, nor their hashes."""
    files: dict[str, Content] = {}
    missing, left = [], _LARGEST_AUDIT
    for path in sorted(folder.glob(_AUDIT), key=lambda each: (len(each.name), each.name)):
        if path.is_symlink() or not path.is_file():
            continue
        text = path.read_text("utf-8", "replace")
        if len(text) > left:
            missing.append(f"{path.name}: more than {_LARGEST_AUDIT // _MIB} MiB together")
            continue
        left -= len(text)
        files[f"audit/{path.name}"] = text
    if not files and not missing:
        missing.append(f"there is no audit log in {folder}")
    return Collected(files, missing)


def _descriptor(folder: Path, log: LogFile) -> int:
    return open_log(folder, log.name)[0]


class BundleOptions(NamedTuple):
    """What a bundle is to have.

    Attributes:
        logs: The folder of logs.
        log_count: How many of them, newest first.
        most_bytes: Of logs, together.
        logs_of: The names of the robots whose logs they are, or None for any.
        robot: The text of the robot file, or None where there is none.
        station: A station's folder, or None where there is none.
        robots: Collects the state of the robots on the ROS network, or None to leave it out.
    """

    logs: Path
    log_count: int = 1
    most_bytes: int = _MOST_LOG_BYTES
    logs_of: Collection[str] | None = None
    robot: str | None = None
    station: Path | None = None
    robots: Callable[[], Collected] | None = None


def machine_parts(options: BundleOptions) -> Parts:
    """The parts, the quick ones first."""
    logs, robot, station = options.logs, options.robot, options.station
    parts = {
        "versions": versions,
        "environment": variables,
        "robot file": None if robot is None else lambda: Collected({"robot.yaml": robot}),
        "machine": real_time,
        "disk space": functools.partial(disks, [logs] if station is None else [logs, station]),
        "interfaces": can_interfaces,
        "messages": journal,
        "robots": options.robots,
        "audit log": None if station is None else functools.partial(audit_log, station),
        "logs": functools.partial(newest_logs, logs, options.log_count, options.most_bytes, options.logs_of),
    }
    if not options.log_count:
        del parts["logs"]
    return {name: collect for name, collect in parts.items() if collect is not None}
