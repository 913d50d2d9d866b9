# SPDX-License-Identifier: MIT
"""Which parts a machine's support bundle has."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.deploy.support.bundle import Collected, Part
from segway_ecc.deploy.support.parts.files import audit_log, newest_logs, robot_file
from segway_ecc.deploy.support.parts.machine import can_interfaces, disks, journal, real_time, variables, versions

MOST_LOG_BYTES: Final = 200 * 1024 * 1024


class BundleOptions(NamedTuple):
    """What a bundle is to have.

    Attributes:
        logs: The folder of logs.
        log_count: How many of them, newest first.
        most_bytes: Of logs, together.
        robot: The text of the robot file, or None where there is none.
        station: A station's folder, or None where there is none.
        robots: Collects the state of the robots on the ROS network, or None to leave it out.
    """

    logs: Path
    log_count: int = 1
    most_bytes: int = MOST_LOG_BYTES
    robot: str | None = None
    station: Path | None = None
    robots: Callable[[], Collected] | None = None


def machine_parts(options: BundleOptions) -> list[Part]:
    """The parts, the quick ones first."""
    folders = [options.logs, *([] if options.station is None else [options.station])]
    parts = [
        Part("versions", versions),
        Part("environment", variables),
        Part("machine", real_time),
        Part("disk space", functools.partial(disks, folders)),
        Part("interfaces", can_interfaces),
        Part("messages", journal),
    ]
    if options.robots is not None:
        parts.append(Part("robots", options.robots))
    if options.robot is not None:
        parts.insert(2, Part("robot file", functools.partial(robot_file, options.robot)))
    if options.station is not None:
        parts.append(Part("audit log", functools.partial(audit_log, options.station)))
    if options.log_count:
        parts.append(Part("logs", functools.partial(newest_logs, options.logs, options.log_count, options.most_bytes)))
    return parts
